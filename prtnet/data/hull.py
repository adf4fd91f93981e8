"""A smooth closed surface around a scene: where hair and foliage are looked at from outside.

The points at one distance from all triangles, holes and pockets filled, blurred a little.
"""

from dataclasses import replace
from math import sqrt

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError
from prtnet.data.nearest import boxes_of, nearest
from prtnet.data.part import Part
from prtnet.data.scene import IDENTITY, Scene, assemble

Array = np.ndarray

DISTANCE = 0.08  # unit lengths, of the hull from the scene
RESOLUTION = 64  # voxels along the unit box
BLOCK = 4  # voxels along each side of a block that is looked into or not
BAND = 2  # voxels on both sides of the hull in which distances are exact


def hull_of(scene: Scene, *, distance: float = DISTANCE, resolution: int = RESOLUTION) -> Scene:
    """The hull of a scene, both in unit coordinates: one part, albedo 1, normals outwards."""
    from skimage.filters import gaussian
    from skimage.measure import label, marching_cubes

    scene = scene.centred()
    voxel = 2 / resolution
    if not 2 * voxel <= distance <= 1:
        raise PrtnetError(f"hull: found a distance of {distance:g}, expected {2 * voxel:g} to 1 unit lengths")
    low = scene.vertices.min(axis=0) - distance - 4 * voxel
    counts = np.ceil((scene.vertices.max(axis=0) + distance + 4 * voxel - low) / voxel).astype(int) + 1
    away = _distances(scene, low, counts, voxel, distance)
    values = gaussian(np.clip(away - distance, -BAND * voxel, BAND * voxel), 1.0)
    # what no way leads to from outside is inside
    free = np.asarray(label(values > 0, connectivity=1))
    values[(free > 0) & (free != free[0, 0, 0])] = -BAND * voxel
    vertices, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="descent")
    places = low + vertices.astype(np.float64) * voxel
    part = Part("hull", places, faces.astype(np.int64), albedo=np.ones(3, np.float32), two_sided=False)
    return replace(assemble(f"hull of {scene.name}", [part]), frame=IDENTITY)


def _distances(scene: Scene, low: Array, counts: Array, voxel: float, level: float) -> Float[Array, "x y z"]:
    """At low + voxel (i, j, k): exact near the level, else that of a place at most a block away."""
    corners = scene.vertices[scene.faces]
    order, boxes = boxes_of(corners)
    corners = np.ascontiguousarray(corners[order])
    blocks = -(-counts // BLOCK)
    middles = low + voxel * (BLOCK * _grid(blocks) + (BLOCK - 1) / 2)
    away = _nearest(middles, corners, boxes).reshape(blocks)
    for axis in range(3):
        away = away.repeat(BLOCK, axis=axis)
    x, y, z = counts
    away = np.ascontiguousarray(away[:x, :y, :z]).ravel()
    # distances change by no more than the way
    near = np.abs(away - level) < (BLOCK * sqrt(3) / 2 + BAND) * voxel
    away[near] = _nearest(low + voxel * _grid(counts)[near], corners, boxes)
    return away.reshape(counts)


def _grid(counts: Array) -> Array:
    return np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)


def _nearest(points: Array, corners: Array, boxes: Array) -> Array:
    face, where = np.empty(len(points), np.int64), np.empty((len(points), 3))
    nearest(points, corners, boxes, face, where)
    return np.linalg.norm(points - where, axis=1)
