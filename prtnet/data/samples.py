"""Points on surfaces: area-uniform by Turk's square-root rule, and the vertices as a test set.

Turk 1990, *Generating Random Points in Triangles* (Graphics Gems): (1 - sqrt r) A + sqrt r (1 - s) B + sqrt r s C.
The faces are chosen by area. By default both choices are low-discrepancy: the faces by systematic (stratified) picks
along the running sum of areas, and (r, s) from the R2 sequence (Roberts 2018, *The Unreasonable Effectiveness of
Quasirandom Sequences*).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32, UInt64

from prtnet import PrtnetError
from prtnet.data import normal_map
from prtnet.data.normals import unit
from prtnet.data.scene import Scene

Array = np.ndarray

# barycentric distance from the vertices that samples keep, so that vertices stay a fair test set
VERTEX_MARGIN = 1e-4
PLASTIC = 1.32471795724474602596
R2_STEP = np.array([1 / PLASTIC, 1 / PLASTIC**2])
MORTON_BITS = 21


@dataclass(frozen=True, eq=False)
class Samples:
    """Points on a scene, each on one side of one face."""

    # scene coordinates
    positions: Float64[Array, "n 3"]
    # unit shading normals
    normals: Float32[Array, "n 3"]
    # unit normals of the triangles, on the same side
    geometric_normals: Float32[Array, "n 3"]
    # index into scene.split_sides().faces
    face: Int32[Array, " n"]
    # barycentric, of the corners of that face; None where points are not known by them
    weights: Float[Array, "n 3"] | None = None


def area_uniform(scene: Scene, count: int, rng: np.random.Generator, *, sequence: str = "r2") -> Samples:
    """`count` points, equally dense everywhere, on both sides of two-sided faces, in random order.

    `sequence` is "r2" (low discrepancy) or "random". Only a 1e-4 barycentric neighbourhood of the vertices is left out.
    """
    if count < 1:
        raise PrtnetError(f"samples.count: found {count}, expected at least 1")
    split = scene.split_sides()
    # unit coordinates: the sums neither overflow nor depend on where the scene stands
    running = np.cumsum(split.centred().face_areas)
    if sequence == "r2":
        pick = (np.arange(count) + rng.random()) / count
        numbers = (rng.random(2) + np.arange(count)[:, None] * R2_STEP) % 1.0
    elif sequence == "random":
        pick, numbers = rng.random(count), rng.random((count, 2))
    else:
        raise PrtnetError(f"samples.sequence: found {sequence!r}, expected r2 or random")
    face = np.searchsorted(running, pick * running[-1], side="right")
    face = np.minimum(face, np.flatnonzero(np.diff(running, prepend=0))[-1])
    weights = _away_from_vertices(square_root_rule(numbers), rng)
    # systematic picks come face by face; shuffled, every slice of the samples is a fair one
    order = rng.permutation(count)
    return at_barycentric(split, face[order], weights[order])


def square_root_rule(numbers: Float[Array, "n 2"]) -> Float[Array, "n 3"]:
    """Uniform numbers in [0, 1)^2 to barycentric weights that are uniform over the triangle."""
    root = np.sqrt(numbers[:, 0])
    last = root * numbers[:, 1]
    return np.stack([1 - root, root - last, last], axis=1)


def _away_from_vertices(weights: Float[Array, "n 3"], rng: np.random.Generator) -> Float[Array, "n 3"]:
    """Draws again where a weight is above 1 - VERTEX_MARGIN: about 3e-8 of all."""
    near = np.flatnonzero(weights.max(axis=1) > 1 - VERTEX_MARGIN)
    while len(near):
        weights[near] = square_root_rule(rng.random((len(near), 2)))
        near = near[weights[near].max(axis=1) > 1 - VERTEX_MARGIN]
    return weights


def at_barycentric(split: Scene, face: Int[Array, " n"], weights: Float[Array, "n 3"]) -> Samples:
    """The points of one-sided faces at barycentric weights, with interpolated normals, bent by normal maps."""
    corner = split.faces[face]
    positions = sum(weights[:, i, None] * split.vertices[corner[:, i]] for i in range(3))
    normals = sum(weights[:, i, None].astype(np.float32) * split.normals[corner[:, i]] for i in range(3))
    normals = normal_map.perturbed(split, face, weights, np.asarray(normals))
    geometric = split.face_normals.astype(np.float32)[face]
    return Samples(np.asarray(positions), _unit_or(normals, geometric), geometric, face.astype(np.int32), weights)


def _unit_or(normals: Float32[Array, "n 3"], fallback: Float32[Array, "n 3"]) -> Float32[Array, "n 3"]:
    """Normals of unit length; opposite corner normals that cancel leave the fallback."""
    length = np.sqrt(np.einsum("ni,ni->n", normals, normals))[:, None]
    return np.where(length > 1e-6, normals / np.maximum(length, 1e-6), fallback)


def at_vertices(scene: Scene) -> Samples:
    """Every vertex that a face uses, back sides of two-sided faces included: the vertex test set.

    The geometric normal of a vertex is the area-weighted mean of its faces'; `face` is one of them.
    """
    split = scene.split_sides()
    used, first = np.unique(split.faces, return_index=True)
    face = first // 3
    unit_scene = split.centred()
    weighted = np.repeat(unit_scene.face_normals * unit_scene.face_areas[:, None], 3, axis=0)
    corner = split.faces.ravel()
    sums = np.stack([np.bincount(corner, weighted[:, axis]) for axis in range(3)], axis=1)[used]
    own = split.face_normals[face].astype(np.float32)
    geometric = _unit_or(unit(sums).astype(np.float32), own)
    at_corner = np.eye(3)[first % 3]
    return Samples(split.vertices[used], split.normals[used], geometric, face.astype(np.int32), at_corner)


def select(samples: Samples, index: Bool[Array, " n"] | Int[Array, " m"]) -> Samples:
    """The samples of a mask or an index array."""
    weights = None if samples.weights is None else samples.weights[index]
    return Samples(
        samples.positions[index], samples.normals[index], samples.geometric_normals[index], samples.face[index], weights
    )


def morton_order(positions: Float[Array, "n 3"]) -> Int[Array, " n"]:
    """Index that sorts points along a Z-curve (Morton 1966), 21 bits per axis of the bounding box: near stays near."""
    low = positions.min(axis=0)
    extent = np.maximum((positions.max(axis=0) - low).max(), np.finfo(np.float64).tiny)
    cells = ((positions - low) / extent * (2**MORTON_BITS - 1)).astype(np.uint64)
    code = np.zeros(len(positions), np.uint64)
    for axis in range(3):
        code |= _spread_bits(cells[:, axis]) << np.uint64(axis)
    return np.argsort(code, kind="stable")


def _spread_bits(values: UInt64[Array, " n"]) -> UInt64[Array, " n"]:
    """Two zero bits between every two of the lowest 21 bits."""
    masks = (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    )
    for shift, mask in masks:
        values = (values | (values << np.uint64(shift))) & np.uint64(mask)
    return values
