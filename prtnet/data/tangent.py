"""Tangents at vertices from texture coordinates, for normal maps.

By the rules of Mikkelsen 2008, *Simulation of Wrinkled Surfaces Revisited* (MikkTSpace): of the faces at a vertex,
those that see their coordinates mirrored and those that do not have tangents of their own. Each is the sum of the
faces' tangents in the plane of the vertex normal, weighted by the angle at the corner. The bitangent is w cross(n, t),
with w = 1, or -1 where mirrored.
"""

import numpy as np
from jaxtyping import Float, Float32, Int, Int32

from prtnet.data.normals import corner_angles, unit, weld

Array = np.ndarray


def vertex_tangents(
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    normals: Float[Array, "v 3"],
    uv: Float[Array, "v 2"],
) -> tuple[Int[Array, " s"], Int32[Array, "f 3"], Float32[Array, "s 4"]]:
    """(source vertex of each new vertex, faces over the new vertices, unit tangents with w).

    A vertex that faces of both kinds share becomes two. Where no face has an area in uv, tangents are 0.
    """
    along, side = face_tangents(vertices, faces, uv)
    corner = faces.ravel()
    _, row = weld(np.hstack([vertices, normals, uv]))
    side = _of_neighbours(np.repeat(side, 3), row[corner])
    normal = normals[corner]
    flat = np.repeat(along, 3, axis=0)
    flat = unit(flat - np.sum(flat * normal, axis=1, keepdims=True) * normal)
    weighted = corner_angles(vertices, faces).reshape(-1, 1) * flat
    group = 2 * row[corner] + (side > 0)
    sums = unit(np.stack([np.bincount(group, weighted[:, axis]) for axis in range(3)], axis=1))
    keys, first, index = np.unique(2 * corner + (side > 0), return_index=True, return_inverse=True)
    tangents = np.concatenate([sums[group[first]], side[first, None]], axis=1)
    return keys // 2, index.reshape(-1, 3).astype(np.int32), tangents.astype(np.float32)


def face_tangents(
    vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"], uv: Float[Array, "v 2"]
) -> tuple[Float[Array, "f 3"], Float[Array, " f"]]:
    """(unit direction in which u grows, +1 or -1 where the coordinates are mirrored) of each face; 0 without area."""
    corners, places = np.asarray(vertices, np.float64)[faces], np.asarray(uv, np.float64)[faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    (u1, v1), (u2, v2) = (places[:, 1] - places[:, 0]).T, (places[:, 2] - places[:, 0]).T
    side = np.sign(u1 * v2 - u2 * v1)
    return unit((first * v2[:, None] - second * v1[:, None]) * side[:, None]), side


def _of_neighbours(side: Float[Array, " c"], row: Int[Array, " c"]) -> Float[Array, " c"]:
    """Corners of faces without an area in uv go with most of the others at their vertex."""
    most = np.where(np.bincount(row, side) >= 0, 1.0, -1.0)
    return np.where(side == 0, most[row], side)
