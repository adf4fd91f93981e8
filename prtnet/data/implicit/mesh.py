"""The triangles of an implicit surface: marching cubes, with every vertex moved onto the surface itself.

Lorensen and Cline 1987, *Marching Cubes: A High Resolution 3D Surface Construction Algorithm*, in the form without
ambiguities of Lewiner et al. 2003. Distances come from the compiled field; cells that are farther from the surface than
their own size are not looked into.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import ceil, sqrt

import numpy as np
from jaxtyping import Float, Float32, Int

from prtnet import PrtnetError
from prtnet.data.implicit.field import Field, unit_gradient
from prtnet.data.implicit.march import evaluated
from prtnet.data.implicit.project import onto
from prtnet.data.implicit.surface import Described, Implicit
from prtnet.data.normals import face_cross
from prtnet.data.part import Part
from prtnet.data.scene import Frame, Material, Scene, assemble

log = logging.getLogger(__name__)
Array = np.ndarray
Distance = Callable[[Array], Array]

BLOCK = 8  # samples along each side of a block that is looked into or not
LEAST_AREA = 1e-6  # in squares of a voxel: triangles below it are dropped
FRAME_RESOLUTION = 64  # of the mesh whose extent makes the frame
BORDER = 2  # voxels of the grid outside of the box


def implicit_of(described: Described) -> Implicit:
    """A surface as somebody wrote it down, moved to unit coordinates."""
    frame = frame_of_field(described)
    return Implicit(described.name, described.field.in_frame(frame), described.materials, frame, described.camera)


def frame_of_field(described: Described) -> Frame:
    """The frame in which the surface's longest extent fills [-1, 1].

    Raises PrtnetError where there is no surface between `low` and `high`, or where it goes on outside of them.
    """
    low, high = (np.asarray(bound, np.float64) for bound in (described.low, described.high))
    if not (np.isfinite(low).all() and np.isfinite(high).all() and np.all(low < high)):
        raise PrtnetError(f"{described.name}: bounds: found {described.low} and {described.high}, expected low < high")
    box = Frame((low + high) / 2, float(2 / (high - low).max()))
    field, half = described.field.in_frame(box), (high - low) / (high - low).max()
    # uncompiled: it is looked at but once
    vertices, _ = triangles(field, FRAME_RESOLUTION, -half, half, described.name, field.distance)
    ends = [_furthest(field, vertices, axis * side) for side in (-1.0, 1.0) for axis in np.eye(3)]
    least, most = np.min(ends, axis=0), np.max(ends, axis=0)
    return Frame(box.from_unit((least + most) / 2), float(box.scale * 2 / (most - least).max()))


def _furthest(field: Field, vertices: Float[Array, "v 3"], towards: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """The point of the surface that is furthest in a direction: from vertices, uphill along the surface."""
    step = 2 / FRAME_RESOLUTION
    points = vertices[np.argsort(-(vertices @ towards))[:32]]
    found = points[0]
    for _ in range(24):
        normals = unit_gradient(field, points)
        uphill = towards - (normals @ towards)[:, None] * normals
        points = onto(field, points + step * uphill, furthest=step)
        best = points[np.argmax(points @ towards)]
        found, step = (best, step) if best @ towards > found @ towards else (found, step / 2)
    return found


def scene_of(implicit: Implicit, resolution: int) -> Scene:
    """The surface as triangles, in its own coordinates: one part per material, normals of the gradient.

    `resolution` is the number of voxels along the unit box, whose longest extent the surface fills.
    """
    started = time.perf_counter()
    vertices, faces = triangles(implicit.field, resolution, -np.ones(3), np.ones(3), implicit.name)
    normals = unit_gradient(implicit.field, vertices)
    count = len(implicit.materials)
    part = implicit.field.part(vertices[faces].mean(axis=1)) if count > 1 else np.zeros(len(faces), int)
    places = implicit.frame.from_unit(vertices)
    parts = [_part(material, places, normals, faces[part == i]) for i, material in enumerate(implicit.materials)]
    scene = assemble(implicit.name, parts, camera=implicit.camera)
    seconds = time.perf_counter() - started
    log.info("%s: %d triangles of %d voxels in %.1f s", implicit.name, len(faces), resolution, seconds)
    return replace(scene, frame=implicit.frame)


def _part(
    material: Material, vertices: Float[Array, "v 3"], normals: Float[Array, "v 3"], faces: Int[Array, "f 3"]
) -> Part:
    used, corner = np.unique(faces, return_inverse=True)
    return Part(
        material.name,
        vertices[used],
        corner.reshape(-1, 3),
        normals[used],
        albedo=material.albedo,
        two_sided=False,
        roughness_factor=material.roughness,
    )


def triangles(
    field: Field,
    resolution: int,
    low: Float[Array, " 3"],
    high: Float[Array, " 3"],
    name: str,
    distance: Distance | None = None,
) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"]]:
    """Vertices on the surface and faces, outwards by the right-hand rule, inside a box in unit coordinates.

    `distance` fills the grid, by itself the compiled form of the field's. Raises PrtnetError where the box has no
    surface, or does not hold all of it.
    """
    if resolution < 8:
        raise PrtnetError(f"{name}: resolution: found {resolution}, expected at least 8 voxels")
    # here and not above: two seconds that runs on meshes need not wait for
    from skimage.measure import marching_cubes

    voxel = 2 / resolution
    start = low - BORDER * voxel
    counts = tuple(ceil(float(side) / voxel) + 2 * BORDER + 1 for side in high - low)
    values = grid(distance or partial(evaluated, field), field.lipschitz, start, counts, voxel)
    _check(values, name)
    vertices, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="descent")
    vertices = onto(field, start + vertices.astype(np.float64) * voxel, furthest=voxel)
    area = np.linalg.norm(face_cross(vertices, faces), axis=1) / 2
    return vertices, faces[area > LEAST_AREA * voxel**2].astype(np.int64)


def _check(values: Float[Array, "x y z"], name: str) -> None:
    if not np.isfinite(values).all():
        raise PrtnetError(f"{name}: found distances that are not finite, expected numbers everywhere")
    if not values.min() < 0 < values.max():
        raise PrtnetError(
            f"{name}: found distances from {values.min():.3g} to {values.max():.3g} in its bounds, expected a surface: "
            "below 0 inside of it and above 0 outside"
        )
    for axis, letter in enumerate("xyz"):
        for side, which in ((0, "low"), (-1, "high")):
            if np.take(values, side, axis).min() < 0:
                raise PrtnetError(
                    f"{name}: found its surface to go on beyond the {which} end of {letter} of its bounds, expected all"
                    " of it inside them"
                )


def grid(
    distance: Distance, lipschitz: float, start: Float[Array, " 3"], counts: tuple[int, ...], voxel: float
) -> Float32[Array, "x y z"]:
    """Distances at start + voxel (i, j, k), exact near the surface; elsewhere those of the middle of a block."""
    blocks = tuple(-(-count // BLOCK) for count in counts)
    index = np.stack(np.meshgrid(*map(np.arange, blocks), indexing="ij"), axis=-1).reshape(-1, 3)
    middles = start + (index * BLOCK + (BLOCK - 1) / 2) * voxel
    coarse = distance(middles)
    # where a sample of the block or its neighbour may be on the other side
    reach = lipschitz * sqrt(3) * (BLOCK + 1) / 2 * voxel
    near = np.flatnonzero(~(np.abs(coarse) > reach))
    values = np.repeat(coarse[:, None].astype(np.float32), BLOCK**3, axis=1)
    inside = np.stack(np.meshgrid(*[np.arange(BLOCK)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for chosen in (near[first : first + 256] for first in range(0, len(near), 256)):
        points = start + (index[chosen, None] * BLOCK + inside) * voxel
        values[chosen] = distance(points.reshape(-1, 3)).reshape(len(chosen), -1)
    whole = values.reshape(*blocks, BLOCK, BLOCK, BLOCK).transpose(0, 3, 1, 4, 2, 5)
    x, y, z = counts
    return np.ascontiguousarray(whole.reshape([BLOCK * count for count in blocks])[:x, :y, :z])
