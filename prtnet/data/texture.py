"""Transfer textures: which surface point each texel stands for, and the texture made from the transfer there.

Texture arrays are images: row 0 on top is v = 1, texel centres at half-integers, `index` = row * size + column.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32

from prtnet import gl
from prtnet.data import mipmap
from prtnet.data.atlas import Atlas
from prtnet.data.samples import Samples, at_barycentric

log = logging.getLogger(__name__)
Array = np.ndarray
INSET = 0.25


@dataclass(frozen=True, eq=False)
class Texels:
    """Surface points of the texels that charts touch, in the order of `index`."""

    # scene coordinates of atlas.scene; where a chart only grazes the texel, next to its point nearest to the centre
    positions: Float64[Array, "n 3"]
    # unit shading normals
    normals: Float32[Array, "n 3"]
    # unit normals of the triangles
    geometric_normals: Float32[Array, "n 3"]
    # face of atlas.scene
    face: Int32[Array, " n"]
    # flat texel, ascending
    index: Int[Array, " n"]
    size: int


def gbuffers(atlas: Atlas, size: int) -> list[Texels]:
    """The texels of all textures of an atlas: one of `size`^2, or one for each part."""
    return (
        [gbuffer(atlas, size)]
        if atlas.sides is None
        else [gbuffer(atlas, side, page) for page, side in enumerate(atlas.sides)]
    )


def gbuffer(atlas: Atlas, size: int, page: int = 0) -> Texels:
    """Rasterise one texture of the atlas: a surface point for every texel that a chart touches, be it at a corner.

    The nearest face wins, so a texel whose centre is covered belongs to the face that covers it. The rasteriser names
    face and barycentric coordinates; positions follow in float64 and lie on the surface.
    """
    drawn = np.flatnonzero(atlas.page_of_face == page)
    image = _rasterise(atlas, drawn, size).reshape(-1, 4)
    index = np.flatnonzero(image[:, 0] > 0)
    face = drawn[image[index, 0].astype(np.int64) - 1]
    second, third = image[index, 1].astype(np.float64), image[index, 2].astype(np.float64)
    weights = np.stack([1 - second - third, second, third], axis=1)
    edge = (image[index, 3] > 0) | (weights.min(axis=1) < 1e-5)
    weights[edge] = _inset(weights[edge], size * atlas.uv[atlas.scene.faces[face[edge]]])
    points = at_barycentric(atlas.scene, face, weights)
    log.info(
        "atlas: %d of %d^2 texels used, %d of them along borders", len(index), size, np.count_nonzero(image[index, 3])
    )
    return Texels(points.positions, points.normals, points.geometric_normals, points.face, index, size)


def points(pages: Sequence[Texels]) -> Samples:
    """The surface points of all texels, one texture after the other."""
    positions, normals, geometric, face = (
        np.concatenate([getattr(page, name) for page in pages])
        for name in ("positions", "normals", "geometric_normals", "face")
    )
    return Samples(positions, normals, geometric, face)


def _inset(weights: Float64[Array, "n 3"], corners: Float32[Array, "n 3 2"]) -> Float64[Array, "n 3"]:
    """Points on edges moved into their faces, `INSET` texels towards the middle, at most a tenth of the way.

    On the very edge between a wall and a floor rays would start in both and leave through either.
    """
    away = np.einsum("ni,nij->nj", 1 / 3 - weights, corners)
    step = np.minimum(0.1, INSET / np.maximum(np.linalg.norm(away, axis=1), 1e-9))
    return weights + step[:, None] * (1 / 3 - weights)


def _rasterise(atlas: Atlas, drawn: Int[Array, " d"], size: int) -> Float32[Array, "size size 4"]:
    """(place in `drawn` + 1, b1, b2, distance in texels) of every texel; 0 where no face of those drawn is near."""
    context, target = gl.context(), gl.target(size, size, depth=True)
    shader = gl.program(gl.shader("uv.vert.glsl"), gl.shader("uv_texels.frag.glsl"), gl.shader("uv_texels.geom.glsl"))
    gl.put(shader, size=float(size))
    uv = context.buffer(np.ascontiguousarray(atlas.uv).tobytes())
    faces = context.buffer(np.ascontiguousarray(atlas.scene.faces[drawn]).tobytes())
    target.clear()
    context.disable(moderngl.CULL_FACE | moderngl.BLEND)
    context.enable(moderngl.DEPTH_TEST)
    context.depth_func = "<"
    context.vertex_array(shader, [(uv, "2f", "atlas_uv")], faces).render(moderngl.TRIANGLES)
    context.disable(moderngl.DEPTH_TEST)
    return target.read()


@dataclass(frozen=True, eq=False)
class Page:
    """A transfer texture: of a whole scene or, in a set, of one part."""

    # dilated; only the first without mip levels
    levels: tuple[Float32[Array, "_ _ k"], ...]
    # texels of the first level that have a surface point of their own
    used: Bool[Array, "s s"]


def page_of(image: Float[Array, "s s k"]) -> Page:
    """An image every texel of which is in use."""
    return Page((np.asarray(image, np.float32),), np.ones(image.shape[:2], bool))


def page(texels: Texels, transfer: Float[Array, "n k"], *, dilation: int = 3, levels: int = 1) -> Page:
    """The texture of texels with their transfer; each of its mip levels is dilated by as many texels of its own."""
    bare, used = assemble(texels, transfer, dilation=0), mask(texels)
    found = mipmap.pyramid(bare, used, levels)
    return Page(tuple(dilated(image, valid, dilation) for image, valid in found), used)


def assemble(texels: Texels, transfer: Float[Array, "n k"], *, dilation: int = 3) -> Float32[Array, "size size k"]:
    """The texture: the transfer of every used texel, dilated."""
    flat = np.zeros((texels.size * texels.size, transfer.shape[1]), np.float32)
    flat[texels.index] = transfer
    return dilated(flat.reshape(texels.size, texels.size, -1), mask(texels), dilation)


def dilated(image: Float32[Array, "s s k"], valid: Bool[Array, "s s"], rings: int) -> Float32[Array, "s s k"]:
    """An image grown outwards by rings of texels, so that bilinear look-ups near chart borders find no zeros. A texel
    of a ring is the mean of its valid neighbours among eight.
    """
    flat, valid = image.reshape(-1, image.shape[2]).copy(), valid.copy()
    for _ in range(rings):
        ring, sums, counts = _ring(flat, valid)
        flat[ring] = sums / counts[:, None]
        valid.reshape(-1)[ring] = True
    return flat.reshape(image.shape)


def mask(texels: Texels) -> Bool[Array, "size size"]:
    """Which texels have a surface point of their own."""
    valid = np.zeros((texels.size, texels.size), bool)
    valid.reshape(-1)[texels.index] = True
    return valid


def _ring(
    flat: Float32[Array, "t k"], valid: Bool[Array, "size size"]
) -> tuple[Int[Array, " n"], Float32[Array, "n k"], Int[Array, " n"]]:
    """Texels that are not valid but have valid neighbours, with the neighbours' sum and count."""
    size = len(valid)
    padded = np.pad(valid, 1)
    offsets = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if (row, column) != (0, 0)]
    near = [padded[1 + r : 1 + r + size, 1 + c : 1 + c + size] for r, c in offsets]
    counts = np.sum(near, axis=0, dtype=np.int64)
    ring = np.flatnonzero((counts > 0) & ~valid)
    sums = np.zeros((len(ring), flat.shape[1]), np.float32)
    for (row, column), neighbour in zip(offsets, near, strict=True):
        has = neighbour.reshape(-1)[ring]
        sums[has] += flat[ring[has] + row * size + column]
    return ring, sums, counts.reshape(-1)[ring]
