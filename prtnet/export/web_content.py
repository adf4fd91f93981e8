"""What a web page knows of a scene: its net as text and features, mesh, textures and test points, packed."""

import json
from collections.abc import Sequence
from dataclasses import replace
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
from prtnet.export import gloss, glsl, grid, hash_grid, limits, packing, texel_grid, weight_texture
from prtnet.export.form import Form
from prtnet.export.packing import Block
from prtnet.export.spelling import quads
from prtnet.netspec import NetSpec

Array = np.ndarray

CHECKED_POINTS = 1024
UNIFORMS = 16  # vectors beside the light and the texture's range
# what a device has less of than this, the page finds out where it runs: see `_needs`
LARGEST = replace(limits.MINIMUM["430"], name="large WebGL 2 devices")


def content(
    net: NetSpec, atlas: Atlas, pages: Sequence[Page], net_uv: Float[Array, "v 2"] | None, storage: str
) -> tuple[dict[str, Any], dict[str, Block]]:
    """What the page knows of net, mesh and textures, and the arrays. Parameters as of `prtnet.export.web.page`."""
    about_mesh, blocks = mesh(atlas)
    textures, texture_blocks = _textures(pages, _slots(net), 4 * net.groups * quads(sh.count(net.bands)))
    about, net_blocks = net_content(net, storage, textures)
    blocks |= texture_blocks | net_blocks
    if net.texels:
        blocks["net_uv"] = _coordinates(_checked_uv(atlas, net_uv))
    firsts = np.searchsorted(np.sort(atlas.page_of_face), np.arange(len(pages) + 1)).tolist()
    for each, first, last in zip(textures, firsts[:-1], firsts[1:], strict=True):
        each |= {"first": first, "count": last - first}
    return about | about_mesh | {"pages": textures}, blocks


def net_content(net: NetSpec, storage: str, textures: list[dict[str, Any]]) -> tuple[dict[str, Any], dict[str, Block]]:
    """What the page knows of the net, whatever it draws and beside which textures, and the arrays."""
    chosen, layers = Form("300 es", storage).of(net), quads(sh.count(net.bands))
    images, blocks = _images(net, chosen)
    blocks |= {"net": packing.pack_text(_function(net, chosen)), "gloss": packing.pack_text(gloss.full(net.bands))}
    blocks["checks"] = _checks(net)
    upright = sh.rotation_matrix(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), net.bands)
    about = {
        "layers": layers,
        "groups": net.groups,
        "slots": _slots(net),
        "images": images,
        "takes_uv": bool(net.texels),
        "upright": numbers(np.where(np.abs(upright) > 1e-12, upright, 0).ravel()),
        "needs": _needs(layers, net.groups, textures, images),
    }
    return about, blocks


def _slots(net: NetSpec) -> list[int]:
    """The channels that coefficients fill, of groups that begin with a vector each."""
    count = sh.count(net.bands)
    return [4 * quads(count) * group + i for group in range(net.groups) for i in range(count)]


def _checked_uv(atlas: Atlas, net_uv: Float[Array, "v 2"] | None) -> Float[Array, "v 2"]:
    found = None if net_uv is None else net_uv.shape
    if net_uv is None or found != atlas.uv.shape:
        raise PrtnetError(
            f"web page: found coordinates {found} for a net with texels, expected {atlas.uv.shape}: the place of each"
            " vertex in the atlas of the net's training"
        )
    return net_uv


def _function(net: NetSpec, chosen: Form) -> str:
    """`prt_transfer` without its comments, which repeat the scene's name."""
    lines = glsl.transfer(net, chosen, LARGEST).split("\n")
    return "\n".join(line for line in lines if not line.startswith("//"))


def mesh(atlas: Atlas) -> tuple[dict[str, Any], dict[str, Block]]:
    """What the page knows of the triangles and their parts, page by page of the atlas, and the arrays."""
    scene = atlas.scene
    box = packing.box_of(scene.vertices)
    faces = scene.faces[np.argsort(atlas.page_of_face, kind="stable")]
    blocks = {
        "positions": packing.pack(packing.to_steps(scene.vertices, box), delta=True),
        "normals": packing.pack(packing.to_octahedron(scene.normals), delta=True),
        "uv": _coordinates(atlas.uv),
        "part": packing.pack(part_of_vertices(scene).astype(np.uint16)[:, None], delta=True),
        "faces": packing.pack(faces.astype(np.uint32), delta=True),
    }
    parts = [{"name": m.name, "albedo": numbers(c)} for m, c in zip(scene.materials, palette(scene), strict=True)]
    return {"box": {"low": numbers(box.low), "span": numbers(box.span)}, "parts": parts}, blocks


def _coordinates(uv: Float[Array, "v 2"]) -> Block:
    """In 16 bits."""
    return packing.pack(np.rint(uv.astype(np.float64) * packing.TOP).astype(np.uint16), delta=True)


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
        abouts.append({"side": len(each.used), "scale": numbers(scale), "offset": numbers(offset)})
        blocks[f"mask{index}"] = packing.pack(np.packbits(each.used.ravel())[:, None])
        blocks[f"texels{index}"] = packing.pack(packing.predicted(stored.levels[0], each.used))
    return abouts, blocks


def _images(net: NetSpec, chosen: Form) -> tuple[list[dict[str, Any]], dict[str, Block]]:
    """Names and sizes of the textures that `prt_transfer` reads, three numbers for a volume, and their texels."""
    images = [(grid.name(i), grid.texels(values)) for i, values in enumerate(net.grids)]
    images += [(hash_grid.name(i), hash_grid.texels(each.table)) for i, each in enumerate(net.hashes)]
    images += [(texel_grid.name(i), texel_grid.texels(values)) for i, values in enumerate(net.texels)]
    if chosen.storage == "texture":
        images += [(weight_texture.NAME, weight_texture.texels(net))]
    abouts = [{"name": name, "size": list(image.shape[-2::-1])} for name, image in images]
    return abouts, {f"image{i}": packing.pack_floats(image) for i, (_, image) in enumerate(images)}


def _checks(net: NetSpec) -> Block:
    """Random points of the whole cube, and of the whole atlas, and what NumPy finds there."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(CHECKED_POINTS, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    positions = rng.uniform(-1, 1, (CHECKED_POINTS, 3)).astype(np.float32)
    uv = rng.random((CHECKED_POINTS, 2), np.float32)
    expected = netspec.evaluate_unit(net, positions.astype(np.float64), normals, uv=uv).astype(np.float32)
    values = (positions, normals, uv, expected)
    return packing.pack_floats(np.concatenate([each.ravel() for each in values]))


def _needs(layers: int, groups: int, textures: list[dict], images: list[dict]) -> dict[str, int]:
    """Limits of WebGL 2 by their names, and what the page asks of them."""
    volumes = [max(each["size"]) for each in images if len(each["size"]) == 3]
    flats = [max(each["size"]) for each in images if len(each["size"]) == 2]
    return {
        "MAX_TEXTURE_SIZE": max([*flats, *(each["side"] for each in textures)], default=0),
        "MAX_3D_TEXTURE_SIZE": max(volumes, default=0),
        "MAX_ARRAY_TEXTURE_LAYERS": layers * groups,
        "MAX_TEXTURE_IMAGE_UNITS": 3 + len(images),
        "MAX_FRAGMENT_UNIFORM_VECTORS": 4 * layers + 2 * layers * groups + UNIFORMS,
    }


def numbers(values: Float[Array, "..."]) -> Any:
    """As lists of numbers that read back as the same float32."""
    return json.loads(json.dumps(np.asarray(values).tolist()), parse_float=lambda text: float(f"{float(text):.9g}"))
