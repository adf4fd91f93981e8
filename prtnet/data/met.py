"""What a ray meets: the point, its normals on the side that was hit, and how much that side reflects."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from prtnet.data.albedo import albedo
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
    colour = np.where(reflects, albedo(scene, face, weights), 0).astype(np.float64)
    return Met(points.positions, side * points.normals, side * points.geometric_normals, colour)
