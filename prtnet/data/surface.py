"""What a ray meets: the point, its normals on the side that was hit, and how much that side reflects."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from prtnet.data.samples import at_barycentric
from prtnet.data.scene import Scene

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Met:
    """Points on a scene, on the side that faces where the ray came from."""

    # scene coordinates
    positions: Float64[Array, "n 3"]
    # unit shading normals, and unit normals of the triangles
    normals: Float32[Array, "n 3"]
    geometric_normals: Float32[Array, "n 3"]
    # linear RGB; backs of one-sided faces reflect nothing
    albedo: Float64[Array, "n 3"]


def meet(scene: Scene, face: Int[Array, " n"], where: Float[Array, "n 2"], directions: Float[Array, "n 3"]) -> Met:
    """The points that rays along `directions` hit, as `Tracer.hits` names them: faces of `scene` and (u, v) on them."""
    weights = np.concatenate([1 - where.sum(axis=1, keepdims=True), where], axis=1).astype(np.float64)
    points = at_barycentric(scene, face, weights)
    front = np.einsum("ni,ni->n", points.geometric_normals, directions) < 0
    side = np.where(front, 1, -1).astype(np.float32)[:, None]
    reflects = (front | scene.two_sided[face])[:, None]
    colour = np.where(reflects, albedo(scene, face, weights), 0)
    return Met(points.positions, side * points.normals, side * points.geometric_normals, colour)


def albedo(scene: Scene, face: Int[Array, " n"], weights: Float[Array, "n 3"]) -> Float64[Array, "n 3"]:
    """Linear RGB albedo at barycentric weights of faces: the part's factor times its texture, bilinear, repeated."""
    part = scene.part[face]
    colour = np.stack([material.albedo for material in scene.materials]).astype(np.float64)[part]
    for index, material in enumerate(scene.materials):
        chosen = np.flatnonzero(part == index)
        if material.texture is not None and scene.uv is not None and len(chosen):
            uv = np.einsum("ni,nij->nj", weights[chosen], scene.uv[scene.faces[face[chosen]]].astype(np.float64))
            colour[chosen] *= _look_up(material.texture, uv)
    return colour


def _look_up(texture: Float[Array, "h w 3"], uv: Float[Array, "n 2"]) -> Float64[Array, "n 3"]:
    height, width = texture.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    total = np.zeros((len(uv), 3))
    for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
        share = np.abs(1 - down - (y - top)) * np.abs(1 - right - (x - left))
        total += share[:, None] * texture[(top + down) % height, (left + right) % width]
    return total
