"""Vertex PRT: the mesh whose vertices keep transfer, parts of it subdivided, and where their rays start.

Sloan, Kautz and Snyder 2002, *Precomputed Radiance Transfer for Real-Time Rendering in Dynamic, Low-Frequency
Lighting Environments*. Each side of a two-sided face has vertices of its own. Where the mesh is coarse, shadows
between vertices are lost: `subdivide` cuts chosen parts finer, without moving their surface.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from prtnet import PrtnetError
from prtnet.data.normals import corner_angles, unit
from prtnet.data.samples import Samples, at_barycentric
from prtnet.data.scene import Scene

Array = np.ndarray

# images name faces by float32 numbers (`Raster.faces`), which are whole up to here
MOST_FACES = (1 << 24) - 1
# of the scene's diagonal: how far rays start off a surface (the tracer's own offset), and from its border
OFFSET, REACH = 1e-5, 1e-4
# a vertex whose faces look all ways has a mean normal as short as this, and takes that of one of them
NO_NORMAL = 1e-3
# the middles of a face's edges 0-1, 1-2, 2-0
MIDDLES = np.array([[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]])


def check(scene: Scene, subdivide: Collection[str], level: int) -> None:
    """Raises PrtnetError for parts that the scene lacks, a level below 0, and more triangles than can be drawn."""
    names = list(dict.fromkeys(material.name for material in scene.materials))
    unknown = [name for name in subdivide if name not in names]
    if unknown:
        raise PrtnetError(f"vertex.subdivide: found {', '.join(unknown)}, expected some of {', '.join(names)}")
    if level < 0:
        raise PrtnetError(f"vertex.level: found {level}, expected 0 or more")
    sides = 1 + scene.two_sided
    cut = int(sides[_chosen(scene, subdivide)].sum())
    total = int(sides.sum()) - cut + cut * 4**level
    if total > MOST_FACES:
        raise PrtnetError(f"vertex.level: found {level}, which makes {total} triangles, expected at most {MOST_FACES}")


def mesh(scene: Scene, subdivide: Collection[str] = (), level: int = 1) -> Scene:
    """The drawn mesh: one-sided faces in the order of scene.split_sides(), no vertex that no face uses.

    The triangles of the parts named in `subdivide` are cut in four, `level` times; the pieces stand in their place.
    Positions, normals and uv of new vertices are means of the two they lie between. Raises PrtnetError as `check`.
    """
    check(scene, subdivide, level)
    # vertices keep their own normals: a normal map is finer than they are
    made = replace(scene.split_sides(), tangents=None)
    for _ in range(level if subdivide else 0):
        made = _cut(made, _chosen(made, subdivide))
    used, corner = np.unique(made.faces, return_inverse=True)
    return replace(
        made,
        vertices=made.vertices[used],
        normals=made.normals[used],
        uv=None if made.uv is None else made.uv[used],
        roughness=None if made.roughness is None else made.roughness[used],
        faces=corner.reshape(-1, 3).astype(np.int32),
    )


def _chosen(scene: Scene, subdivide: Collection[str]) -> Bool[Array, " f"]:
    return np.array([material.name in subdivide for material in scene.materials], bool)[scene.part]


def _cut(split: Scene, chosen: Bool[Array, " f"]) -> Scene:
    """One-sided faces with the chosen ones cut in four at the middles of their edges, which neighbours share."""
    corner = split.faces[chosen].astype(np.int64)
    ends = np.sort(np.stack([corner, np.roll(corner, -1, axis=1)], axis=-1), axis=-1)
    code = ends[..., 0] * len(split.vertices) + ends[..., 1]
    _, first, edge = np.unique(code, return_index=True, return_inverse=True)
    middle = at_barycentric(split, np.flatnonzero(chosen)[first // 3], MIDDLES[first % 3])
    ab, bc, ca = (edge.reshape(-1, 3) + len(split.vertices)).T
    a, b, c = corner.T
    children = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 4, 3)
    times = np.where(chosen, 4, 1)
    faces = np.repeat(split.faces, times, axis=0)
    faces[np.repeat(chosen, times)] = children.reshape(-1, 3)
    origin = None if split.face_origin is None else np.repeat(split.face_origin, times)
    low, high = ends.reshape(-1, 2)[first].T
    uv, rough = (
        None if values is None else np.concatenate([values, (values[low] + values[high]) / 2])
        for values in (split.uv, split.roughness)
    )
    return replace(
        split,
        vertices=np.concatenate([split.vertices, middle.positions]),
        normals=np.concatenate([split.normals, middle.normals]),
        uv=uv,
        faces=faces,
        part=np.repeat(split.part, times),
        two_sided=np.zeros(len(faces), bool),
        face_origin=origin,
        roughness=rough,
    )


def points(drawn: Scene) -> Samples:
    """Where the rays of each vertex of a drawn mesh start, in the order of its vertices; in scene coordinates.

    The geometric normal of a vertex is the mean of its faces', weighted by their angles there (Thürmer and Wüthrich
    1998). At the border of a surface the point is moved into it, by REACH of the scene's diagonal or a tenth of the
    shortest edge: in the very corner between a floor and a wall rays would start in both and leave through either.
    `face` is the face in which the vertex has its widest angle.
    """
    unit_mesh = drawn.centred()
    corner, angles = drawn.faces.ravel(), corner_angles(unit_mesh.vertices, drawn.faces).ravel()
    normals = np.repeat(unit_mesh.face_normals, 3, axis=0)
    widest = np.lexsort((-angles, corner))
    face = (widest[np.searchsorted(corner[widest], np.arange(len(drawn.vertices)))] // 3).astype(np.int32)
    mean = _vertex_mean(normals, angles, corner, len(drawn.vertices))
    lost = np.linalg.norm(mean, axis=1) < NO_NORMAL
    mean[lost] = unit_mesh.face_normals[face[lost]]
    sides = unit(mean)
    # a face without area has no normal
    sides = np.where(np.any(sides, axis=1, keepdims=True), sides, drawn.normals)
    moved = unit_mesh.vertices + _inwards(unit_mesh, sides, angles)
    return Samples(drawn.frame.from_unit(moved), drawn.normals, sides.astype(np.float32), face)


def _inwards(unit_mesh: Scene, sides: Float64[Array, "v 3"], angles: Float64[Array, " c"]) -> Float64[Array, "v 3"]:
    """The step of each vertex into its surface: about nothing where faces lie all around, REACH at a border."""
    corner, vertices = unit_mesh.faces.ravel(), unit_mesh.vertices
    edges = [vertices[np.roll(unit_mesh.faces, -turn, axis=1).ravel()] - vertices[corner] for turn in (1, 2)]
    bisector = unit(unit(edges[0]) + unit(edges[1]))
    inside = _vertex_mean(bisector, angles, corner, len(vertices))
    inside -= np.einsum("vi,vi->v", inside, sides)[:, None] * sides
    shortest = np.full(len(vertices), np.inf)
    np.minimum.at(shortest, corner, np.minimum(*(np.linalg.norm(edge, axis=1) for edge in edges)))
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    step = np.minimum(REACH * diagonal, 0.1 * shortest)
    # on bent surfaces the step may lead behind a face: half of the offset before it is kept
    normals = np.repeat(unit_mesh.face_normals, 3, axis=0)
    before = OFFSET * diagonal * np.maximum(np.einsum("ci,ci->c", sides[corner], normals), 0) / 2
    sinking = -np.einsum("ci,ci->c", inside[corner], normals)
    np.minimum.at(step, corner, np.where(sinking > 1e-9, before / np.maximum(sinking, 1e-9), np.inf))
    return step[:, None] * inside


def _vertex_mean(
    vectors: Float64[Array, "c 3"], weights: Float64[Array, " c"], corner: Int[Array, " c"], count: int
) -> Float64[Array, "v 3"]:
    """The weighted mean over the corners at each vertex."""
    sums = np.stack([np.bincount(corner, weights * vectors[:, axis], count) for axis in range(3)], axis=1)
    return sums / np.maximum(np.bincount(corner, weights, count), 1e-30)[:, None]


def interpolate(
    values: Float[Array, "v k"], drawn: Scene, face: Int[Array, " n"], weights: Float[Array, "n 3"]
) -> Float[Array, "n k"]:
    """Values at vertices, interpolated at barycentric weights of faces: what the rasteriser does with colours."""
    return np.einsum("ni,nik->nk", weights, values[drawn.faces[face]])
