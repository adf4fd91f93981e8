"""How far the surface of a field is from a mesh that it stands for, and how much of a distance it is."""

from dataclasses import dataclass, replace

import numpy as np

from prtnet.data import samples
from prtnet.data.implicit import mesh
from prtnet.data.implicit.neural import Neural
from prtnet.data.implicit.project import onto
from prtnet.data.part import Part
from prtnet.data.scene import IDENTITY, Scene, assemble
from prtnet.data.signed_distance import Distance

Array = np.ndarray

RESOLUTION = 96  # voxels of the mesh that the field's points are drawn from; they are moved onto the surface itself
SHELL = 0.1  # of the surface, in unit lengths: where the slope is looked at
DEVIATION = 0.1  # of the slope from 1, above which a point deviates
NEAR = 1e-3  # unit lengths: points nearer to the surface have no sign worth counting


@dataclass(frozen=True)
class SurfaceError:
    """Lengths are shares of the longest side of the mesh's bounding box."""

    to_mesh: float  # mean distance from points of the field's surface to the mesh
    from_mesh: float  # and the other way
    to_mesh_worst: float
    from_mesh_worst: float
    deviation: float  # mean of | |gradient| - 1 | in a shell about the mesh
    deviating: float  # share of the points of this shell where it is above DEVIATION
    wrong_sign: float  # share of the points of the box

    @property
    def chamfer(self) -> float:
        """Mean of both ways."""
        return (self.to_mesh + self.from_mesh) / 2

    @property
    def worst(self) -> float:
        """The greater one of both ways: an estimate of the Hausdorff distance from below."""
        return max(self.to_mesh_worst, self.from_mesh_worst)


def surface_error(field: Neural, distance: Distance, rng: np.random.Generator, count: int = 1 << 15) -> SurfaceError:
    """By `count` points each of the field's surface, the mesh where it is seen from outside, the shell and the box.

    Raises PrtnetError for a field without a surface, or with one that leaves its box.
    """
    half = np.array(field.half)
    surface = triangulated(field, distance.scene.name)
    found = onto(field, samples.area_uniform(surface, count, rng).positions, furthest=2 / RESOLUTION)
    given = samples.area_uniform(distance.scene, count, rng).positions
    given = given[~distance.hidden(distance.nearest(given), rng)]
    side = np.ptp(distance.scene.vertices, axis=0).max()
    to_mesh, from_mesh = distance.nearest(found).distance / side, Distance(surface).nearest(given).distance / side
    shell = np.clip(given + rng.uniform(-SHELL, SHELL, given.shape), -half, half)
    off = np.abs(np.linalg.norm(field.gradient(shell), axis=1) - 1)
    spread = rng.uniform(-1, 1, (count, 3)) * half
    signed, _ = distance.signed(spread, rng)
    wrong = ((field.distance(spread) < 0) != (signed < 0)) & (np.abs(signed) > NEAR)
    return SurfaceError(
        float(to_mesh.mean()),
        float(from_mesh.mean()),
        float(to_mesh.max()),
        float(from_mesh.max()),
        float(off.mean()),
        float(np.mean(off > DEVIATION)),
        float(wrong.mean()),
    )


def triangulated(field: Neural, name: str) -> Scene:
    """The field's surface as a scene in unit coordinates."""
    half = np.array(field.half)
    # uncompiled: it is looked at but once
    vertices, faces = mesh.triangles(field, RESOLUTION, -half, half, name, field.distance)
    return replace(assemble(name, [Part(name, vertices, faces, field.gradient(vertices))]), frame=IDENTITY)
