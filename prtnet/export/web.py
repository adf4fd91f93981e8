"""A scene as one HTML file that opens from disk: mesh, network, transfer texture and lights, drawn with WebGL 2; or the
text of an implicit surface and the lobe of open points in place of mesh and texture.

`prtnet.export.web_frame` is what this page has in common with others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from prtnet import netspec, sh
from prtnet.data.atlas import Atlas
from prtnet.data.implicit.surface import Implicit
from prtnet.data.texture import Page
from prtnet.export import gloss, unshadowed, web_content, web_surface
from prtnet.export.packing import Block
from prtnet.export.web_content import numbers
from prtnet.export.web_frame import SHARED, Certificate, Look, Words, document
from prtnet.netspec import NetSpec

Array = np.ndarray

# each after those it imports from
MODULES = (*SHARED, "methods", "implicit", "model", "renderer", "certify", "viewer", "controls", "main")

_EXPOSURES = "Exposures are those of the first view under each light; small bright lights ring in spherical harmonics."
_NO_MESH = "Surface: sphere-traced in each pixel, with no triangles and no texture coordinates."


@dataclass(frozen=True, eq=False)
class PageLight:
    """A light that the page offers, and the exposure it is first seen at."""

    name: str
    coefficients: Float32[Array, "k 3"]
    exposure: float


@dataclass(frozen=True)
class Cost:
    """Of a method: multiply-adds per pixel up to the transfer, bytes on the graphics card."""

    macs: int
    bytes: int


def page(
    net: NetSpec,
    atlas: Atlas,
    pages: Sequence[Page],
    *,
    lights: Sequence[PageLight],
    look: Look,
    texture_cost: Cost,
    net_uv: Float[Array, "v 2"] | None = None,
    storage: str = "auto",
    title: str | None = None,
    certificate: Certificate | None = None,
) -> str:
    """The HTML of triangles. `atlas` is in unit coordinates, `pages` are its textures in float.

    `net_uv`, the place of each vertex in the atlas that the net was trained with, is for nets with texels, which need
    it; `storage` of the weights is `auto`, `literal` or `texture` (`prtnet.export.form`). Raises PrtnetError for too
    many bands for the shader and for what no WebGL 2 has to hold.
    """
    about, blocks = web_content.content(net, atlas, pages, net_uv, storage)
    shown = _Shown("texture", texture_cost, atlas.scene.name if title is None else title, _beside(pages))
    return _page(net, shown, about, blocks, lights, look, _notes(atlas, pages), certificate)


def surface_page(
    net: NetSpec,
    surface: Implicit,
    *,
    lights: Sequence[PageLight],
    look: Look,
    storage: str = "auto",
    title: str | None = None,
    certificate: Certificate | None = None,
) -> str:
    """The HTML of an implicit surface, which the page sphere-traces; the lobe of open points stands in place of a
    texture. Parameters and errors as of `page`; nets with groups or texels are refused."""
    about, blocks = web_surface.content(net, surface, storage)
    cost, words = Cost(unshadowed.macs(net.bands), 0), "the same surface without shadows"
    shown = _Shown("unshadowed", cost, surface.name if title is None else title, words)
    return _page(net, shown, about, blocks, lights, look, [_NO_MESH, _EXPOSURES], certificate)


@dataclass(frozen=True)
class _Shown:
    """The method that stands beside the net, what the page is called, what the net is said to be beside."""

    other: str
    cost: Cost
    title: str
    beside: str


def _page(
    net: NetSpec,
    shown: _Shown,
    about: dict[str, Any],
    blocks: Mapping[str, Block],
    lights: Sequence[PageLight],
    look: Look,
    notes: Sequence[str],
    certificate: Certificate | None,
) -> str:
    certificate = certificate or Certificate()
    about |= {
        "other": shown.other,
        "lights": [
            {"name": light.name, "coefficients": numbers(light.coefficients), "exposure": light.exposure}
            for light in lights
        ],
        "camera": {"eye": look.eye, "target": look.target, "fov": look.fov},
        "start": {"diffuse": look.diffuse, "specular": look.specular, "exponent": look.exponent},
        "tint": look.tint,
        "costs": {
            "net": asdict(Cost(netspec.macs(net), netspec.byte_count(net))),
            shown.other: asdict(shown.cost),
            "diffuse": 3 * sh.count(net.bands),
            "gloss": gloss.macs(net.bands, "full"),
        },
        "certificate": certificate.measured,
        "unmeasured": certificate.reason,
    }
    lead = f"Precomputed light transport in a network of {netspec.macs(net):,} multiply-adds, beside {shown.beside}."
    words = Words(shown.title, lead, "network", shown.other, [*notes, *certificate.notes])
    return document("transfer", MODULES, words, about, blocks)


def _beside(pages: Sequence[Page]) -> str:
    sides = " + ".join(f"{len(each.used)}²" for each in pages[:3]) + (" + …" if len(pages) > 3 else "")
    return f"a {sides} texture"


def _notes(atlas: Atlas, pages: Sequence[Page]) -> list[str]:
    """What a reader should know of how the page differs from the scene."""
    texels, coefficients = sum(int(each.used.sum()) for each in pages), pages[0].levels[0].shape[2]
    notes = [
        f"Texture: {texels:,} texels in use, {coefficients} coefficients of 8 bits each, bilinear.",
        f"Mesh: {len(atlas.scene.faces):,} triangles, positions in 16 bits.",
        _EXPOSURES,
    ]
    if any(material.texture is not None for material in atlas.scene.materials):
        notes.append("Albedo textures are not in this file: each part has the mean of its own.")
    if atlas.scene.tangents is not None:
        notes.append("Normal maps are not in this file: surfaces are smooth.")
    return notes
