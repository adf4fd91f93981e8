"""Occlusion rays by sphere tracing: the surface itself is asked, no triangles stand in for it.

Hart 1996, *Sphere Tracing: A Geometric Method for the Antialiased Ray Tracing of Implicit Surfaces*. A ray hits where
it comes nearer to the surface than `epsilon`, and is free where it leaves the box around the surface.
"""

import logging
import time
from math import sqrt
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32

from prtnet import PrtnetError
from prtnet.data import directions as sets
from prtnet.data.directions import Table
from prtnet.data.implicit.compiled import compiled
from prtnet.data.implicit.field import Field, unit_gradient
from prtnet.data.scene import IDENTITY, Frame
from prtnet.data.tracer import rate, rays

log = logging.getLogger(__name__)
Array = np.ndarray

# In unit lengths. See experiments/results/bench_implicit.csv for the error that each leaves.
OFFSET = 5e-5
EPSILON = 5e-6
STEPS = 1024
DOUBLINGS = 7  # of the offset, at most: to 0.0064
CELLS = 48  # of the grid in which the surface's box is looked for, along each axis


class MarchTracer:
    """Rays against one field, with the interface of `prtnet.data.tracer.Tracer`.

    `frame` leads from the coordinates of points to the field's. `offset` is where rays start off the surface,
    `epsilon` (below it) how near they must come to hit, both in unit lengths; `steps` is the most that a ray walks.
    `rays_traced` counts rays and `rays_lost` those of them that used up their steps: they count as hits, since only
    rays that creep along a surface do that. Raises PrtnetError for a field without a surface in [-1, 1]^3.
    """

    kind = "marched"

    def __init__(
        self,
        field: Field,
        *,
        frame: Frame = IDENTITY,
        offset: float = OFFSET,
        epsilon: float = EPSILON,
        steps: int = STEPS,
    ):
        if not 0 < epsilon < offset:
            raise PrtnetError(f"tracer: found epsilon {epsilon} and offset {offset}, expected 0 < epsilon < offset")
        from prtnet.data.implicit import kernels

        self.field, self.frame, self.offset = field, frame, offset
        self.rays_traced = self.rays_lost = 0
        started = time.perf_counter()
        self._lanes = compiled(field.source())
        self._functions = np.array([self._lanes.address, kernels.advance.address])
        seconds = time.perf_counter() - started
        self._settings = np.array([1 / field.lipschitz, epsilon, steps], np.float32)
        self._box = bounds(field, margin=2 * offset)
        log.info("tracer: marched (16 rays at a time), compiled in %.2f s", seconds)

    def origins(self, positions: Float[Array, "n 3"], geometric_normals: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Where rays start: unit coordinates, float32, off the surface along the unit geometric normals.

        On a crest, or where the distance is a bound, `offset` may not bring a point out of reach of `epsilon`, and all
        rays would end where they start: there the height is doubled until it does, unless something is in the way.
        """
        unit = self.frame.to_unit(positions)
        start = (unit + self.offset * geometric_normals).astype(np.float32)
        height, close = self.offset, np.flatnonzero(self._distances(start) < self.offset / 2)
        for _ in range(DOUBLINGS):
            height *= 2
            lifted = (unit[close] + height * geometric_normals[close]).astype(np.float32)
            distance = self._distances(lifted)
            free = distance >= self.offset / 2
            start[close[free]] = lifted[free]
            close = close[~free & (distance > 0)]
        return start

    def occluded(self, origins: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        """Whether rays from `origins` (scene coordinates; no offset is added) hit anything."""
        start = self.frame.to_unit(origins).astype(np.float32)
        self.rays_traced += len(start)
        return self.trace(start, np.ascontiguousarray(directions, np.float32))

    def trace(self, origins: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        """Whether rays of unit directions hit anything. Unit coordinates."""
        return self._walk(origins, directions, any_hit=True)[0] > 0

    def hits(
        self, origins: Float[Array, "n 3"], directions: Float[Array, "n 3"]
    ) -> tuple[Int32[Array, " n"], Float32[Array, "n 3"], Float32[Array, " n"]]:
        """What rays hit first: part (-1: nothing), unit normal, distance in unit lengths or inf. Unit coordinates."""
        self.rays_traced += len(origins)
        _, distance = self._walk(origins, directions, any_hit=False)
        found = np.flatnonzero(np.isfinite(distance))
        points = origins[found] + distance[found, None].astype(np.float64) * directions[found]
        part, normal = np.full(len(origins), -1, np.int32), np.zeros((len(origins), 3), np.float32)
        part[found], normal[found] = self.field.part(points), unit_gradient(self.field, points)
        return part, normal, distance

    def clearance(
        self, positions: Float[Array, "n 3"], normals: Float[Array, "n 3"], directions: int = 32
    ) -> Float[Array, " n"]:
        """How far one sees from points (scene coordinates) into the half-space of their unit normals, at the most.

        In unit lengths, infinite where one sees out of the scene.
        """
        local, _ = sets.local_set("cosine_fibonacci", directions, np.random.default_rng(0))
        frames = sets.frames(sets.turns(normals, np.zeros(len(normals))))
        start, aim = rays(self.origins(positions, normals), frames, local.astype(np.float32))
        return self._walk(start, aim, any_hit=False)[1].reshape(len(positions), -1).max(axis=1)

    def gather(self, origins: Float[Array, "n 3"], turns: Float[Array, "n 6"], table: Table) -> Float32[Array, "n k"]:
        """The transfer of points: sum of the table's rows over the free directions, turned to the world, float32.

        `origins` as `self.origins` gives them, `turns` as `directions.turns`. Every point is computed by itself, so
        its bits do not depend on its neighbours. Safe to call from several threads.
        """
        from prtnet.data import kernels as packets
        from prtnet.data.implicit import kernels

        origins = np.ascontiguousarray(origins, np.float32)
        out = np.empty((len(origins), table.rows.shape[1]), np.float32)
        _, rows, sums = table.packed(kernels.LANES, packets.LANES)
        counts = np.zeros(2, np.int64)
        kernels.gather(
            self._functions, *self._box, self._settings, origins, self._distances(origins), sets.frames(turns),
            turns, table.directions, rows, sums, *table.flip, counts, out,
        )  # fmt: skip
        self.rays_lost += int(counts[0])
        return out

    def measure(
        self, positions: Float[Array, "n 3"], normals: Float[Array, "n 3"], *, bands: int = 5, points: int = 1024
    ) -> float:
        """Rays per second of one thread on some of these points: what an estimate of a bake's time needs."""
        lost = self.rays_lost
        try:
            return rate(self, positions, normals, bands=bands, points=points)
        finally:
            self.rays_lost = lost

    def _distances(self, points: Float32[Array, "n 3"]) -> Float32[Array, " n"]:
        return _distances(self._lanes, points)

    def _walk(self, origins: Array, directions: Array, any_hit: bool) -> tuple[Array, Array]:
        """How rays end, and at what length."""
        from prtnet.data.implicit import kernels

        origins, directions = (np.ascontiguousarray(each, np.float32) for each in (origins, directions))
        ends, lengths = np.empty(len(origins), np.uint8), np.empty(len(origins), np.float32)
        kernels.walk(
            self._functions, *self._box, self._settings, origins, self._distances(origins),
            np.zeros_like(origins), directions[:, None], any_hit, ends, lengths,
        )  # fmt: skip
        self.rays_lost += int(np.sum(ends == kernels.LOST))
        return ends, lengths


def evaluated(field: Field, points: Float[Array, "n 3"]) -> Float32[Array, " n"]:
    """The field at points (unit coordinates) by its compiled form, float32."""
    return _distances(compiled(field.source()), np.ascontiguousarray(points, np.float32))


def _distances(lanes: Any, points: Float32[Array, "n 3"]) -> Float32[Array, " n"]:
    from prtnet.data.implicit import kernels

    out = np.empty(len(points), np.float32)
    kernels.distances(lanes.address, points, out)
    return out


def bounds(field: Field, *, margin: float, cells: int = CELLS) -> tuple[Float32[Array, " 3"], Float32[Array, " 3"]]:
    """A box around the surface inside [-1, 1]^3: of all cells whose centre is not farther from it than their corners.

    Raises PrtnetError where there is no surface.
    """
    centres = (np.arange(cells) + 0.5) * 2 / cells - 1
    grid = np.stack(np.meshgrid(centres, centres, centres, indexing="ij"), axis=-1)
    near = np.abs(evaluated(field, grid.reshape(-1, 3))).reshape(grid.shape[:3])
    found = np.argwhere(near <= field.lipschitz * sqrt(3) / cells)
    if not len(found):
        raise PrtnetError(
            f"implicit surface: found no surface in [-1, 1]^3 (distances from {near.min():.3g}), expected one inside"
        )
    low, high = centres[found.min(axis=0)] - 1 / cells, centres[found.max(axis=0)] + 1 / cells
    return (low - margin).astype(np.float32), (high + margin).astype(np.float32)


def walked(
    field: Field,
    origins: Float[Array, "n 3"],
    directions: Float[Array, "n 3"],
    *,
    epsilon: float = EPSILON,
    steps: int = STEPS,
) -> Float[Array, " n"]:
    """The length at which rays hit, or inf: plain sphere tracing in float64, the twin of the compiled walk.

    A ray is free where it leaves [-1, 1]^3 for good, and hits where it uses up its steps.
    """
    at, found = np.zeros(len(origins)), np.full(len(origins), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.stack([(side - origins) / directions for side in (-1.0, 1.0)])
    leave = np.nanmin(np.nanmax(sides, axis=0), axis=1)
    for _ in range(steps):
        alive = np.flatnonzero(np.isnan(found))
        if not len(alive):
            break
        radius = field.distance(origins[alive] + at[alive, None] * directions[alive]) / field.lipschitz
        found[alive[radius < epsilon]] = at[alive[radius < epsilon]]
        at[alive] += np.maximum(radius, 0)
        gone = alive[(at[alive] > leave[alive]) & np.isnan(found[alive])]
        found[gone] = np.inf
    return np.where(np.isnan(found), at, found)
