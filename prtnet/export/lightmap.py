"""The scene for engines: a GLB with the atlas as its second set of texture coordinates and baked light as a lightmap.

glTF 2.0 has no lightmap. What every reader shows is `occlusionTexture` on TEXCOORD_1: how open each point is to the
sky, of which the standard multiplies ambient light. The irradiance of the run's light is a further texture that
`extras` name: as an occlusion texture it would lose its colours, as an emissive one the albedo (docs/deploying.md).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Float64

from prtnet import store
from prtnet.data.atlas import Atlas
from prtnet.data.scene import Frame, Scene
from prtnet.export import glb
from prtnet.export.glb import EXTRAS_KEY, INDICES, VERTICES, Binary, Json
from prtnet.export.texture_file import write_exr

Array = np.ndarray

FORMAT = 1
GLB, EXR = "lightmap.glb", "lightmap.exr"
POSITION = "prt_transfer takes (world position - centre) * scale, which is POSITION * scale"
SHORT_INDICES = 65_535  # the greatest 16-bit number is none: it restarts primitives


@dataclass(frozen=True, eq=False)
class Lightmap:
    """Of one texture over the atlas, dilated; row 0 is v = 1."""

    # linear RGB, sum t_i L_i, 0 or more: without albedo and without 1/pi
    irradiance: Float32[Array, "s s 3"]
    # share of the cosine-weighted hemisphere that is free
    openness: Float32[Array, "s s"]


@dataclass(frozen=True, eq=False)
class View:
    """Where to look from, in unit coordinates: rows of `basis` are right, up and backward."""

    eye: tuple[float, float, float]
    basis: Float64[Array, "3 3"]
    fov_y: float  # degrees
    near: float
    far: float


def names(count: int) -> list[str]:
    """Of the PNG files of so many textures."""
    return ["lightmap.png"] if count == 1 else [f"lightmap_{page:02d}.png" for page in range(count)]


def write(
    folder: Path,
    atlas: Atlas,
    pages: Sequence[Lightmap],
    frame: Frame,
    *,
    fronts: int,
    about: Mapping[str, Any],
    view: View,
) -> None:
    """Write lightmap.glb, the PNG of each page as in it, and lightmap.exr with the irradiance itself, each atomically.

    The atlas has unit coordinates, which `frame` leads back from; its first `fronts` faces are fronts, the rest backs
    of two-sided ones. `about` joins what `asset.extras` say. PNGs hold irradiance / range, sRGB-encoded, with one
    range for all pages, their greatest value.
    """
    highest = max(float(page.irradiance.max()) for page in pages)
    # all dark is a lightmap, too
    span = highest if highest > 0 else 1.0
    images = [glb.srgb_png(page.irradiance / span) for page in pages]
    binary, header = Binary(), _header(atlas.scene, frame, about, span, len(pages))
    _add_parts(header, binary, atlas, frame, fronts)
    _add_materials(header, binary, atlas, pages, images, span)
    _add_camera(header, view, frame)
    for name, image in zip(names(len(pages)), images, strict=True):
        with store.atomic(folder / name) as temporary:
            temporary.write_bytes(image)
    parts = [material.name for material in atlas.scene.materials] if atlas.sides else [""]
    write_exr(folder / EXR, [page.irradiance for page in pages], names=parts, channels=["R", "G", "B"])
    glb.write(folder / GLB, header, binary)


def _header(scene: Scene, frame: Frame, about: Mapping[str, Any], span: float, count: int) -> Json:
    lightmap = {
        "quantity": "irradiance, linear RGB, no albedo, no 1/pi; radiance = base colour / pi * irradiance",
        "encoding": "irradiance / range, sRGB, 8 bits",
        "range": span,
        "png": names(count),
        "exr": EXR,
    }
    own = {"format": FORMAT, "centre": frame.centre.tolist(), "scale": frame.scale, "position": POSITION}
    return {
        "asset": {
            "version": "2.0",
            "generator": "prtnet",
            "extras": {EXTRAS_KEY: own | {"lightmap": lightmap} | dict(about)},
        },
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        # in JSON the centre keeps its digits, as float32 positions could not
        "nodes": [{"name": scene.name, "translation": frame.centre.tolist(), "children": []}],
        "meshes": [],
        "materials": [],
        # mip levels would mix charts
        "samplers": [
            {"minFilter": glb.LINEAR, "magFilter": glb.LINEAR, "wrapS": glb.CLAMP_TO_EDGE, "wrapT": glb.CLAMP_TO_EDGE}
        ],
    }


def _add_child(header: Json, node: Json) -> None:
    header["nodes"].append(node)
    header["nodes"][0]["children"].append(len(header["nodes"]) - 1)


def _add_parts(header: Json, binary: Binary, atlas: Atlas, frame: Frame, fronts: int) -> None:
    """A node and a mesh for each part that has faces, with vertices of their own."""
    scene = atlas.scene
    for part, material in enumerate(scene.materials):
        chosen = np.flatnonzero(scene.part == part)
        if not len(chosen):
            continue
        used, corner = np.unique(scene.faces[chosen], return_inverse=True)
        kind = np.uint16 if len(used) <= SHORT_INDICES else np.uint32
        content = {
            # float32 keeps the distance to the centre, however far from the origin that is
            "POSITION": binary.accessor((scene.vertices[used] / frame.scale).astype(np.float32), VERTICES, bounds=True),
            "NORMAL": binary.accessor(scene.normals[used], VERTICES),
            "TEXCOORD_1": binary.accessor(glb.coordinates(atlas.uv[used]), VERTICES),
        }
        # sets are counted without gaps: where there is no first one, the second stands for it
        first = content["TEXCOORD_1"]
        if material.texture is not None and scene.uv is not None:
            first = binary.accessor(glb.coordinates(scene.uv[used]), VERTICES)
        indices = binary.accessor(corner.ravel().astype(kind), INDICES)
        primitive = {"attributes": content | {"TEXCOORD_0": first}, "indices": indices, "material": part}
        extras = {EXTRAS_KEY: {"backs": int(np.sum(chosen >= fronts))}}
        _add_child(header, {"name": material.name, "mesh": len(header["meshes"])})
        header["meshes"].append({"name": material.name, "primitives": [primitive], "extras": extras})


def _add_materials(
    header: Json, binary: Binary, atlas: Atlas, pages: Sequence[Lightmap], images: Sequence[bytes], span: float
) -> None:
    """The materials of all parts, each with the two textures of its page."""
    lit = [binary.image(header, image, f"irradiance {page}", sampler=0) for page, image in enumerate(images)]
    open_ = [binary.image(header, glb.png(page.openness), f"openness {i}", sampler=0) for i, page in enumerate(pages)]
    for part, material in enumerate(atlas.scene.materials):
        texture = None
        if material.texture is not None and atlas.scene.uv is not None:
            texture = binary.image(header, glb.srgb_png(material.texture), f"{material.name} base colour")
        page = part if atlas.sides else 0
        entry = glb.material(material.name, material.albedo, texture)
        entry["occlusionTexture"] = {"index": open_[page], "texCoord": 1}
        entry["extras"] = {EXTRAS_KEY: {"lightmap": {"index": lit[page], "texCoord": 1, "range": span}}}
        header["materials"].append(entry)


def _add_camera(header: Json, view: View, frame: Frame) -> None:
    """The view as a camera, which in glTF looks down its own -z."""
    lens = {"yfov": float(np.radians(view.fov_y)), "znear": view.near / frame.scale, "zfar": view.far / frame.scale}
    header["cameras"] = [{"type": "perspective", "perspective": lens}]
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = view.basis.T, np.array(view.eye) / frame.scale
    # column by column
    _add_child(header, {"name": "view 1", "camera": 0, "matrix": placed.T.ravel().tolist()})
