"""A scene as one HTML file that opens from disk: mesh, network, transfer texture and lights, drawn with WebGL 2.

The page asks for nothing over the network and says so to the browser (a content security policy). All arrays are base64
of gzip (`prtnet.export.packing`), everything else is JSON or HTML in which nothing of a scene's own words can be code.
"""

import base64
import hashlib
import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError, netspec, sh
from prtnet.data import quantise
from prtnet.data.albedo import albedo
from prtnet.data.atlas import Atlas
from prtnet.data.roughness import part_of_vertices
from prtnet.data.scene import Scene
from prtnet.data.texture import Page
from prtnet.export import gloss, glsl, grid, hash_grid, packing
from prtnet.export.packing import Block
from prtnet.export.spelling import quads
from prtnet.netspec import NetSpec

Array = np.ndarray

FOLDER = Path(__file__).parent / "web"
# each after those it imports from
MODULES = (
    "unpack", "sh", "ball", "camera", "pointer", "device", "shaders", "model", "renderer", "certify", "viewer",
    "controls", "main",
)  # fmt: skip
CHECKED_POINTS = 1024
UNIFORMS = 16  # vectors beside the light and the texture's range


@dataclass(frozen=True, eq=False)
class PageLight:
    """A light that the page offers, and the exposure it is first seen at."""

    name: str
    coefficients: Float32[Array, "k 3"]
    exposure: float


@dataclass(frozen=True)
class Look:
    """What the page shows first. The camera is in unit coordinates, its field of view in degrees."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float = 40.0
    diffuse: float = 1.0
    specular: float = 0.0
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)  # of what is specular
    exponent: float = 20.0


@dataclass(frozen=True)
class Cost:
    """Of a method: multiply-adds per pixel up to the transfer, bytes on the graphics card."""

    macs: int
    bytes: int


@dataclass(frozen=True)
class Certificate:
    """What a browser measured of the page's net, or why none did."""

    measured: Mapping[str, Any] | None = None
    reason: str = "no browser was there"
    notes: Sequence[str] = field(default_factory=tuple)


def page(
    net: NetSpec,
    atlas: Atlas,
    pages: Sequence[Page],
    *,
    lights: Sequence[PageLight],
    look: Look,
    texture_cost: Cost,
    title: str | None = None,
    certificate: Certificate | None = None,
) -> str:
    """The HTML. `atlas` is in unit coordinates, `pages` are its textures in float.

    Raises PrtnetError for a net that is too large for literals or too many bands for the shader.
    """
    certificate = certificate or Certificate()
    about, blocks = _content(net, atlas, pages)
    title = atlas.scene.name if title is None else title
    about |= {
        "lights": [
            {"name": light.name, "coefficients": _numbers(light.coefficients), "exposure": light.exposure}
            for light in lights
        ],
        "camera": {"eye": look.eye, "target": look.target, "fov": look.fov},
        "start": {"diffuse": look.diffuse, "specular": look.specular, "exponent": look.exponent},
        "tint": look.tint,
        "costs": {
            "net": asdict(Cost(netspec.macs(net), netspec.byte_count(net))),
            "texture": asdict(texture_cost),
            "diffuse": 3 * sh.count(net.bands),
            "gloss": gloss.macs(net.bands, "full"),
        },
        "certificate": certificate.measured,
        "unmeasured": certificate.reason,
    }
    return _assembled(
        title=html.escape(title),
        lead=html.escape(_lead(net, pages)),
        notes="".join(f"<li>{html.escape(note)}</li>" for note in [*_notes(atlas, pages), *certificate.notes]),
        about=as_json(about),
        blocks="\n".join(_element(name, block) for name, block in blocks.items()),
        style=_text("page.css"),
        script=_script(),
    )


def as_json(values: Any) -> str:
    """JSON that may stand in a script element: no `<` can end it, whatever the words are."""
    text = json.dumps(values, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _content(net: NetSpec, atlas: Atlas, pages: Sequence[Page]) -> tuple[dict[str, Any], dict[str, Block]]:
    """What the page knows of net, mesh and textures, and the arrays."""
    layers, count = quads(sh.count(net.bands)), sh.count(net.bands)
    slots = [4 * layers * group + i for group in range(net.groups) for i in range(count)]
    mesh, blocks = _mesh(atlas)
    textures, texture_blocks = _textures(pages, slots, 4 * layers * net.groups)
    features, feature_blocks = _features(net)
    blocks |= texture_blocks | feature_blocks
    blocks |= {"net": packing.pack_text(_function(net)), "gloss": packing.pack_text(gloss.full(net.bands))}
    blocks["checks"] = _checks(net)
    firsts = np.searchsorted(np.sort(atlas.page_of_face), np.arange(len(pages) + 1)).tolist()
    for each, first, last in zip(textures, firsts[:-1], firsts[1:], strict=True):
        each |= {"first": first, "count": last - first}
    upright = sh.rotation_matrix(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), net.bands)
    about = mesh | {
        "layers": layers,
        "groups": net.groups,
        "slots": slots,
        "pages": textures,
        "grids": features,
        "upright": _numbers(np.where(np.abs(upright) > 1e-12, upright, 0).ravel()),
        "needs": _needs(layers, net.groups, textures, features),
        "blocks": {name: block.about() for name, block in blocks.items()},
    }
    return about, blocks


def _function(net: NetSpec) -> str:
    """`prt_transfer` without its comments, which repeat the scene's name."""
    lines = glsl.emit(net, version="300 es", storage="literal").split("\n")
    text = "\n".join(line for line in lines if not line.startswith("//"))
    if not re.search(r"void prt_transfer\(vec3 position, vec3 normal, out", text):
        raise PrtnetError(
            "web page: found a net that takes more than position and normal, expected one without atlas features"
        )
    return text


def _mesh(atlas: Atlas) -> tuple[dict[str, Any], dict[str, Block]]:
    scene = atlas.scene
    box = packing.box_of(scene.vertices)
    faces = scene.faces[np.argsort(atlas.page_of_face, kind="stable")]
    blocks = {
        "positions": packing.pack(packing.to_steps(scene.vertices, box), delta=True),
        "normals": packing.pack(packing.to_octahedron(scene.normals), delta=True),
        "uv": packing.pack(np.rint(atlas.uv.astype(np.float64) * packing.TOP).astype(np.uint16), delta=True),
        "part": packing.pack(part_of_vertices(scene).astype(np.uint16)[:, None], delta=True),
        "faces": packing.pack(faces.astype(np.uint32), delta=True),
    }
    parts = [{"name": m.name, "albedo": _numbers(c)} for m, c in zip(scene.materials, palette(scene), strict=True)]
    return {"box": {"low": _numbers(box.low), "span": _numbers(box.span)}, "parts": parts}, blocks


def palette(scene: Scene) -> Float32[Array, "p 3"]:
    """Linear RGB albedo of each part: where it has a texture, the mean over its surface."""
    found = np.stack([material.albedo for material in scene.materials]).astype(np.float32)
    for index, material in enumerate(scene.materials):
        own = np.flatnonzero(scene.part == index)
        if material.texture is not None and len(own):
            middle = albedo(scene, own, np.full((len(own), 3), 1 / 3))
            found[index] = np.average(middle, axis=0, weights=np.maximum(scene.face_areas[own], 1e-20))
    return found


def _textures(pages: Sequence[Page], slots: list[int], channels: int) -> tuple[list[dict], dict[str, Block]]:
    """Of each page: the side, and how bytes become coefficients; the texels in use, and which they are."""
    abouts, blocks = [], {}
    for index, each in enumerate(pages):
        stored = quantise.encode(each.levels[:1], each.used, "uint8")
        scale, offset = np.zeros(channels, np.float32), np.zeros(channels, np.float32)
        scale[slots], offset[slots] = stored.scale, stored.offset
        abouts.append({"side": len(each.used), "scale": _numbers(scale), "offset": _numbers(offset)})
        blocks[f"mask{index}"] = packing.pack(np.packbits(each.used.ravel())[:, None])
        blocks[f"texels{index}"] = packing.pack(packing.predicted(stored.levels[0], each.used))
    return abouts, blocks


def _features(net: NetSpec) -> tuple[list[dict[str, Any]], dict[str, Block]]:
    """Names and sizes of the net's feature textures, three numbers for a volume, and their texels."""
    images = [(grid.name(i), grid.texels(values)) for i, values in enumerate(net.grids)]
    images += [(hash_grid.name(i), hash_grid.texels(each.table)) for i, each in enumerate(net.hashes)]
    abouts = [{"name": name, "size": list(image.shape[-2::-1])} for name, image in images]
    return abouts, {f"grid{i}": packing.pack_floats(image) for i, (_, image) in enumerate(images)}


def _checks(net: NetSpec) -> Block:
    """Random points of the whole cube, and what NumPy finds there."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(CHECKED_POINTS, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    positions = rng.uniform(-1, 1, (CHECKED_POINTS, 3)).astype(np.float32)
    expected = netspec.evaluate_unit(net, positions.astype(np.float64), normals).astype(np.float32)
    return packing.pack_floats(np.concatenate([positions.ravel(), normals.ravel(), expected.ravel()]))


def _needs(layers: int, groups: int, textures: list[dict], features: list[dict]) -> dict[str, int]:
    """Limits of WebGL 2 by their names, and what the page asks of them."""
    volumes = [max(each["size"]) for each in features if len(each["size"]) == 3]
    flats = [max(each["size"]) for each in features if len(each["size"]) == 2]
    return {
        "MAX_TEXTURE_SIZE": max([*flats, *(each["side"] for each in textures)]),
        "MAX_3D_TEXTURE_SIZE": max(volumes, default=0),
        "MAX_ARRAY_TEXTURE_LAYERS": layers * groups,
        "MAX_TEXTURE_IMAGE_UNITS": 3 + len(features),
        "MAX_FRAGMENT_UNIFORM_VECTORS": 4 * layers + 2 * layers * groups + UNIFORMS,
    }


def _lead(net: NetSpec, pages: Sequence[Page]) -> str:
    sides = " + ".join(f"{len(each.used)}²" for each in pages[:3]) + (" + …" if len(pages) > 3 else "")
    return f"Precomputed light transport in a network of {netspec.macs(net):,} multiply-adds, beside a {sides} texture."


def _notes(atlas: Atlas, pages: Sequence[Page]) -> list[str]:
    """What a reader should know of how the page differs from the scene."""
    texels, coefficients = sum(int(each.used.sum()) for each in pages), pages[0].levels[0].shape[2]
    notes = [
        f"Texture: {texels:,} texels in use, {coefficients} coefficients of 8 bits each, bilinear.",
        f"Mesh: {len(atlas.scene.faces):,} triangles, positions in 16 bits.",
        "Exposures are those of the first view under each light; small bright lights ring in spherical harmonics.",
    ]
    if any(material.texture is not None for material in atlas.scene.materials):
        notes.append("Albedo textures are not in this file: each part has the mean of its own.")
    if atlas.scene.tangents is not None:
        notes.append("Normal maps are not in this file: surfaces are smooth.")
    return notes


def _numbers(values: Float[Array, "..."]) -> Any:
    """As lists of numbers that read back as the same float32."""
    return json.loads(json.dumps(np.asarray(values).tolist()), parse_float=lambda text: float(f"{float(text):.9g}"))


def _element(name: str, block: Block) -> str:
    return f'<script type="application/octet-stream;base64" id="data-{name}">{block.text()}</script>'


def _text(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def _script() -> str:
    """The modules as one: without their imports and exports, each after those it needs."""
    texts = [_text(f"{name}.js") for name in MODULES]
    whole = "\n".join(re.sub(r"^import [^;]*;\n", "", text, flags=re.MULTILINE) for text in texts)
    return re.sub(r"^export ", "", whole, flags=re.MULTILINE)


def _assembled(**parts: str) -> str:
    """The page with its parts in place; what stands in a part is never looked at again."""
    for name in ("script", "style"):
        parts[f"{name}_hash"] = _policy_hash(parts[name])
    text = _text("page.html")
    unknown = set(re.findall(r"\{\{(\w+)\}\}", text)) ^ parts.keys()
    if unknown:
        raise PrtnetError(
            f"page.html: found {', '.join(sorted(unknown))} on one side only, expected all parts in place"
        )
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], text)


def _policy_hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
