"""Vertex normals for meshes that come without: smooth across soft edges, split at creases.

Corners (a face's three vertices) that meet across an edge softer than the crease angle share one normal, the sum of
their face normals weighted by the angle at the corner (Thürmer and Wüthrich 1998, *Computing Vertex Normals from
Polygonal Facets*). Positions are merged first, so that faces without shared indices still smooth.
"""

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

Array = np.ndarray


def face_cross(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, "f 3"]:
    """Twice the area times the normal of each face, float64."""
    first, second, third = np.moveaxis(np.asarray(vertices, np.float64)[faces], 1, 0)
    return np.cross(second - first, third - first)


def unit(vectors: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Vectors scaled to length 1; zero vectors stay zero."""
    # two steps, so that neither tiny nor huge vectors leave the range of the squares
    largest = np.abs(vectors).max(axis=1, keepdims=True, initial=0)
    scaled = vectors / np.where(largest > 0, largest, 1)
    return scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-30)


def weld(vertices: Float[Array, "v d"]) -> tuple[Int[Array, " w"], Int[Array, " v"]]:
    """Equal rows as one: (index of one vertex for each distinct row, row number of each vertex)."""
    rows = np.ascontiguousarray(np.asarray(vertices, np.float64) + 0.0)  # -0.0 becomes 0.0
    order = np.lexsort(rows.T)
    fresh = np.ones(len(rows), bool)
    fresh[1:] = np.any(rows[order[1:]] != rows[order[:-1]], axis=1)
    inverse = np.empty(len(rows), np.int64)
    inverse[order] = np.cumsum(fresh) - 1
    return order[fresh], inverse


def crease_normals(
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    uv: Float[Array, "v 2"] | None = None,
    *,
    crease_degrees: float = 40.0,
) -> tuple[Int[Array, " s"], Int[Array, "f 3"], Float[Array, "s 3"]]:
    """(source vertex of each new vertex, faces over the new vertices, unit normals).

    Vertices are split where creases need it, and joined where position, normal and `uv` are the same.
    """
    keep, position = weld(vertices)
    flat = unit(face_cross(vertices, faces))
    group = _smooth_corners(position[faces], flat, np.cos(np.radians(crease_degrees)))
    keep, row = (keep, position) if uv is None else weld(np.hstack([vertices, uv]))
    pairs = group * len(keep) + row[faces.ravel()]
    keys, first, corner = np.unique(pairs, return_index=True, return_inverse=True)
    weighted = (corner_angles(vertices, faces)[..., None] * flat[:, None]).reshape(-1, 3)
    sums = np.stack([np.bincount(group, weighted[:, axis]) for axis in range(3)], axis=1)
    normals = unit(sums)[keys // len(keep)]
    lost = ~np.any(normals, axis=1)
    normals[lost] = flat[first[lost] // 3]
    return keep[keys % len(keep)], corner.reshape(-1, 3).astype(np.int32), normals.astype(np.float32)


def corner_angles(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> Float[Array, "f 3"]:
    """Inner angles of each triangle, radians."""
    corners = np.asarray(vertices, np.float64)[faces]
    edges = np.stack([unit(np.roll(corners, -1, axis=1)[:, i] - corners[:, i]) for i in range(3)], axis=1)
    cosine = -np.sum(edges * np.roll(edges, 1, axis=1), axis=2)
    return np.arccos(np.clip(cosine, -1, 1))


def _smooth_corners(
    faces: Int[Array, "f 3"], flat: Float[Array, "f 3"], least_cosine: float | np.floating
) -> Int[Array, " c"]:
    """Group number of each corner (face by face): corners joined across soft edges."""
    corner = np.arange(faces.size).reshape(-1, 3)
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    at_low = np.where(start <= end, corner.ravel(), np.roll(corner, -1, axis=1).ravel())
    at_high = np.where(start <= end, np.roll(corner, -1, axis=1).ravel(), corner.ravel())
    order = np.lexsort((high, low))
    here, there = order[:-1], order[1:]
    same = (low[here] == low[there]) & (high[here] == high[there])
    here, there = here[same], there[same]
    soft: Bool[Array, " e"] = np.sum(flat[here // 3] * flat[there // 3], axis=1) >= least_cosine
    here, there = here[soft], there[soft]
    links = np.concatenate([np.stack([at[here], at[there]], axis=1) for at in (at_low, at_high)])
    return trimesh.graph.connected_component_labels(links, node_count=faces.size).astype(np.int64)
