"""Data-driven transfer as one HTML file that opens from disk: a scene with one lamp to move about.

For every place of the lamp the page draws shadow maps, measures direct light at the measurement points with them,
multiplies by the operator and blends the basis textures, all in WebGL 2 and with the very text of other exports
(`prtnet.export.lamps`, `prtnet.export.data_driven`). Numbers between its passes are integers that hold the bits of
floats, so that no extension is needed. Beside the operator's light stand lightmaps of the database.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32

from prtnet import PrtnetError, data_driven
from prtnet.data import texture
from prtnet.data.atlas import Atlas
from prtnet.data.lighting.lamp import Lamp
from prtnet.data_driven import DataDriven
from prtnet.export import data_driven as driven
from prtnet.export import lamps, packing
from prtnet.export.packing import Block
from prtnet.export.spelling import quads
from prtnet.export.web_content import UNIFORMS, mesh, numbers
from prtnet.export.web_frame import SHARED, Certificate, Look, Words, document

Array = np.ndarray

# each after those it imports from
MODULES = (
    *SHARED, "lamp", "driven_shaders", "shadows", "driven_model", "driven_renderer", "driven_certify", "driven_viewer",
    "bars", "handles", "driven_controls", "driven_main",
)  # fmt: skip
CHECKED_TEXELS = 512
RINGS = 2  # that charts grow by, for bilinear look-ups at their borders
SHADOW_SIZE = 1024  # texels along one side of a shadow map
UNITS = 7


@dataclass(frozen=True, eq=False)
class PageLamp:
    """A lamp that the page offers, and the exposure it is first seen at."""

    name: str
    lamp: Lamp
    exposure: float
    # its lightmap, of the quantity of the basis, in the order of its texels; None: nothing to compare with
    lightmap: Float32[Array, "t 3"] | None = None
    # its direct vector by rays, which the page checks itself against
    direct: Float32[Array, "m 3"] | None = None


def page(
    spec: DataDriven,
    atlas: Atlas,
    *,
    lights: Sequence[PageLamp],
    look: Look,
    title: str | None = None,
    notes: Sequence[str] = (),
    certificate: Certificate | None = None,
) -> str:
    """The HTML. `atlas` is in unit coordinates and that of the texels of `spec`, whose first keyframe is shown.

    `look` says where the camera is, its materials are not asked. Raises PrtnetError where there is no light and for an
    atlas of several textures.
    """
    if not lights:
        raise PrtnetError("web page: found no lamp for its scene, expected at least one")
    if atlas.sides is not None:
        raise PrtnetError(
            f"web page: found an atlas of {len(atlas.sides)} textures, expected one: a basis is of one lightmap"
        )
    certificate = certificate or Certificate()
    about, blocks = _content(spec, atlas, lights)
    about |= {
        "camera": {"eye": look.eye, "target": look.target, "fov": look.fov},
        "certificate": certificate.measured,
        "unmeasured": certificate.reason,
    }
    name = atlas.scene.name if title is None else title
    all_notes = [*_notes(spec, atlas), *notes, *certificate.notes]
    return document("driven", MODULES, Words(name, _lead(spec), "operator", "path-traced", all_notes), about, blocks)


def _lead(spec: DataDriven) -> str:
    return (
        f"Light between surfaces, learned: {spec.elements} basis textures, moved by direct light at"
        f" {spec.matrices.shape[3]} points."
    )


def _notes(spec: DataDriven, atlas: Atlas) -> list[str]:
    notes = [
        f"Basis: {len(spec.texels):,} texels in use, {spec.elements} elements"
        + (" for each colour" if spec.basis.shape[0] > 1 else "")
        + ", floats of 16 bits, bilinear.",
        f"Mesh: {len(atlas.scene.faces):,} triangles, positions in 16 bits; shadow maps of {SHADOW_SIZE}².",
        "The operator knows lights of the kinds it has learned from; others it extrapolates.",
    ]
    if len(spec.measurements) > 1:
        notes.append(f"The first of {len(spec.measurements)} keyframes is shown.")
    if any(material.texture is not None for material in atlas.scene.materials):
        notes.append("Albedo textures are not in this file: each part has the mean of its own.")
    if atlas.scene.tangents is not None:
        notes.append("Normal maps are not in this file: surfaces are smooth.")
    return notes


def _content(spec: DataDriven, atlas: Atlas, lights: Sequence[PageLamp]) -> tuple[dict[str, Any], dict[str, Block]]:
    about, blocks = mesh(atlas)
    measurement, banks = spec.measurements[0], spec.basis.shape[0]
    image = driven.basis_page(spec, dilation=RINGS)
    grown = _grown(image.used)
    compared = [light for light in lights if light.lightmap is not None]
    blocks |= {
        "lamps": packing.pack_text(lamps.functions(1)),
        "indirect": packing.pack_text(driven.indirect(spec)),
        "matrix": packing.pack_floats(driven.matrix_texels(spec)),
        "measured": packing.pack_floats(_measured(spec)),
        "mask": packing.pack(np.packbits(grown.ravel())[:, None]),
        "basis": _halves(image.levels[0][grown]),
    }
    if compared:
        blocks["references"] = _halves(np.concatenate([_lightmap(spec, each, image.used) for each in compared], axis=1))
    checked, blocks["checks"] = _checks(spec, lights)
    return about | {
        "pages": [{"first": 0, "count": len(atlas.scene.faces)}],
        "casters": _casters(atlas),
        "shadows": _shadows(),
        "side": spec.size,
        "channels": image.levels[0].shape[2],
        "references": len(compared),
        "banks": banks,
        "elements": spec.elements,
        "width": driven.width(spec),
        "points": measurement.count,
        "samples": measurement.positions.shape[1],
        "gamma": spec.gamma,
        "scale": driven.scale_of(spec),
        "quantity": spec.quantity,
        "lights": [_about(light, compared) for light in lights],
        "checked": checked,
        "costs": {
            "bytes": data_driven.byte_count(spec, 2),
            "pixel": 3 * spec.elements,
            "lamp": 3 * spec.elements * measurement.count,
        },
        "needs": _needs(spec, len(compared)),
    }, blocks


def _grown(used: Bool[Array, "s s"]) -> Bool[Array, "s s"]:
    """The texels in use, and the rings around them."""
    return texture.dilated(used[..., None].astype(np.float32), used, RINGS)[..., 0] > 0


def _halves(values: Float[Array, "n c"]) -> Block:
    return packing.pack(np.ascontiguousarray(values.astype(np.float16)).view(np.uint16), delta=True)


def _lightmap(spec: DataDriven, light: PageLamp, used: Bool[Array, "s s"]) -> Float32[Array, "g 3"]:
    """Of the texels in use and those around them."""
    found = None if light.lightmap is None else light.lightmap.shape
    if light.lightmap is None or found != (len(spec.texels), 3):
        raise PrtnetError(f"web page: found a lightmap {found} of {light.name}, expected {(len(spec.texels), 3)}")
    return texture.dilated(data_driven.image(spec, light.lightmap), used, RINGS)[_grown(used)]


def _measured(spec: DataDriven) -> Float32[Array, "3 s m 4"]:
    """Textures of s rows, one column for each point: positions, normals, geometric normals; albedo / pi in their w."""
    found = spec.measurements[0]
    albedo = found.albedo / np.float32(np.pi)
    fields = (found.positions, found.normals, found.geometric_normals)
    each = [np.concatenate([values, albedo[..., i : i + 1]], axis=2) for i, values in enumerate(fields)]
    return np.swapaxes(np.stack(each), 1, 2).astype(np.float32)


def _casters(atlas: Atlas) -> dict[str, Any]:
    """Backs of two-sided faces cast the shadows of their fronts, which come first."""
    scene = atlas.scene
    count = len(scene.faces) if scene.face_origin is None else int(scene.face_origin.max()) + 1
    used = scene.vertices[np.unique(scene.faces[:count])]
    return {"count": count, "box": numbers(np.stack([used.min(axis=0), used.max(axis=0)]))}


def _shadows() -> dict[str, float]:
    return {
        "size": SHADOW_SIZE,
        "slope": lamps.SLOPE_BIAS,
        "bias": lamps.DEPTH_BIAS,
        "margin": lamps.MARGIN,
        "near": lamps.NEAR,
        "wide": lamps.WIDE,
    }


def _about(light: PageLamp, compared: Sequence[PageLamp]) -> dict[str, Any]:
    lamp = light.lamp
    own = {name: [float(value) for value in getattr(lamp, name)] for name in ("colour", "position", "aim")}
    own |= {"kind": lamp.kind, "inner": float(lamp.inner), "outer": float(lamp.outer)}
    reference = next((i for i, each in enumerate(compared) if each is light), None)
    return {"name": light.name, "lamp": own, "exposure": float(light.exposure), "reference": reference}


def _checks(spec: DataDriven, lights: Sequence[PageLamp]) -> tuple[dict[str, Any], Block]:
    """Centres of some texels; of each light with a direct vector that, u, and what the quantity is at those texels."""
    rng = np.random.default_rng(0)
    few = np.sort(rng.permutation(len(spec.texels))[:CHECKED_TEXELS])
    row, column = np.divmod(np.asarray(spec.texels)[few], spec.size)
    uv = np.stack([column + 0.5, spec.size - row - 0.5], axis=1) / spec.size
    values = [uv]
    checked = [index for index, light in enumerate(lights) if light.direct is not None]
    for index in checked:
        direct = lights[index].direct
        assert direct is not None
        # the page has no light below 0
        shown = np.maximum(data_driven.indirect(spec, direct)[few], 0)
        values += [direct, data_driven.coefficients(spec, direct), shown]
    flat = np.concatenate([each.astype(np.float32).ravel() for each in values])
    return {"lights": checked, "texels": len(few)}, packing.pack_floats(flat)


def _needs(spec: DataDriven, references: int) -> dict[str, int]:
    """Limits of WebGL 2 by their names, and what the page asks of them."""
    layers, banks = quads(spec.elements), spec.basis.shape[0]
    points = spec.matrices.shape[3]
    return {
        "MAX_TEXTURE_SIZE": max(spec.size, points, banks * driven.width(spec), SHADOW_SIZE, CHECKED_TEXELS),
        "MAX_ARRAY_TEXTURE_LAYERS": max(banks * layers, references, lamps.FACES),
        "MAX_TEXTURE_IMAGE_UNITS": UNITS,
        "MAX_FRAGMENT_UNIFORM_VECTORS": 4 * lamps.FACES + 3 + 4 * layers + UNIFORMS,
    }
