"""The reference: a path tracer with next-event estimation, which knows nothing of atlases, lightmaps or bases.

    E = E_0 + E_1 + ... + E_B,  E_b(p) = mean over paths p, x_1 .. x_b of albedo(x_1) .. albedo(x_b) E_0(x_b)

Kajiya 1986, *The Rendering Equation*. Directions have cosine density about shading normals, so that the factors pi
cancel. E_0, what is lit directly: lamps by shadow rays; light from far away by the next ray of the path, where that
leaves the scene. No path ends by chance, and none goes on after B bounces. Every lighting uses the same paths.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from prtnet import PrtnetError, sh
from prtnet.data.albedo import albedo as albedo_at
from prtnet.data.lighting import direct
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.samples import Samples, at_barycentric, select
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer
from prtnet.data.transfer import cores, in_threads

log = logging.getLogger(__name__)
Array = np.ndarray

# independent estimates whose spread gives the noise
PASSES = 8
# paths that are traced together: enough for packets of rays that are alike, few enough for the cache
CHUNK = 1 << 16
# along each axis, by which rays are sorted
CELLS = 16
# steps of the R2 sequence (Roberts 2018), see prtnet.data.samples
R2_STEP = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True, eq=False)
class PathTraced:
    """Irradiance of points under each lighting, linear RGB, without the points' own albedo, which `radiance` adds."""

    direct: Float32[Array, "l n 3"]
    indirect: Float32[Array, "l n 3"]
    # standard error of their sum, RMS over colours
    noise: Float32[Array, "l n"]
    albedo: Float32[Array, "n 3"]

    @property
    def radiance(self) -> Float32[Array, "l n 3"]:
        return self.albedo / np.float32(np.pi) * (self.direct + self.indirect)


def radiance(
    tracer: Tracer,
    scene: Scene,
    points: Samples,
    albedo: Float[Array, "n 3"],
    lightings: Sequence[Lighting],
    *,
    samples: int = 256,
    bounces: int = 4,
    rng: np.random.Generator,
    transfer_of: Float[Array, "n k"] | None = None,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> PathTraced:
    """Light that points (scene coordinates; pixels of a view, for one) get and send under each lighting.

    `samples`: paths of a point, rounded up to a multiple of PASSES. `transfer_of` the points makes their direct light
    from far away exact; else the first rays find it. `progress` gets points done. The result does not depend on
    `threads`. Raises PrtnetError for counts below 1 and arrays of other lengths.
    """
    _check(points, albedo, samples, bounces)
    each = max(1, -(-samples // PASSES))
    world = World(tracer, scene.centred(), lightings, transfer_of is None)
    chunks = np.array_split(np.arange(len(points.positions)), max(1, -(-len(points.positions) * each // CHUNK)))
    generators = rng.spawn(len(chunks))
    shape = len(lightings), len(points.positions), 3
    found, seen = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    noise = np.zeros(shape[:2], np.float32)

    def work(number: int) -> int:
        index = chunks[number]
        few = select(points, index)
        far, near, error = _estimates(world, few, each, bounces, generators[number])
        seen[:, index], found[:, index], noise[:, index] = far + world.lamps(few), near, error
        return len(index)

    done = 0
    for count in in_threads(work, range(len(chunks)), threads or cores()):
        done += count
        if progress is not None:
            progress(done)
    if transfer_of is not None:
        for row, lighting in zip(seen, lightings, strict=True):
            if lighting.environment is not None:
                row += transfer_of[:, : len(lighting.environment)] @ lighting.environment
    return PathTraced(seen, found, noise, np.asarray(albedo, np.float32))


def _estimates(
    world: "World", points: Samples, each: int, bounces: int, rng: np.random.Generator
) -> tuple[Float64[Array, "l n 3"], Float64[Array, "l n 3"], Float64[Array, "l n"]]:
    """(sampled direct light, indirect light, standard error) of a chunk of points: the mean of independent passes."""
    shape = len(world.lightings), len(points.positions), 3
    far, near, squares = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for _ in range(PASSES):
        one, other = world.walk(points, each, bounces, rng)
        far, near, squares = far + one, near + other, squares + (one + other) ** 2
    variance = np.maximum(squares - (far + near) ** 2 / PASSES, 0) / (PASSES - 1)
    return far / PASSES, near / PASSES, np.sqrt(variance.mean(axis=2) / PASSES)


class World:
    """What paths of several threads walk through. `scene` in unit coordinates."""

    def __init__(self, tracer: Tracer, scene: Scene, lightings: Sequence[Lighting], sampled: bool):
        self.tracer, self.lightings = tracer, list(lightings)
        self.split, self.fronts = scene.split_sides(), len(scene.faces)
        self.behind = np.full(self.fronts, -1)
        back = np.flatnonzero(scene.two_sided)
        self.behind[back] = self.fronts + np.arange(len(back))
        self.normals = self.split.face_normals.astype(np.float32)
        distant = [each.environment for each in lightings if each.environment is not None]
        self.bands = max((sh.bands_of(len(each)) for each in distant), default=0)
        self.sampled = sampled  # whether direct light from far away is that of the first rays

    def walk(
        self, points: Samples, each: int, bounces: int, rng: np.random.Generator
    ) -> tuple[Float64[Array, "l n 3"], Float64[Array, "l n 3"]]:
        """(direct light from far away, indirect light): means over `each` paths per point."""
        count = len(points.positions)
        point = np.repeat(np.arange(count), each)
        start = self.tracer.origins(points.positions, points.geometric_normals)[point]
        aim = towards(points.normals[point], stratified(count, each, rng))
        carried = np.ones((len(point), 3), np.float32)
        far, near = (np.zeros((len(self.lightings), count, 3)) for _ in range(2))
        for bounce in range(bounces + 1):
            if bounce == bounces and not self.bands:
                break
            order = alike(start, aim)
            point, carried, start, aim = point[order], carried[order], start[order], aim[order]
            face, where, _ = self.tracer.hits(start, aim)
            if self.bands and (bounce or self.sampled):
                free = np.flatnonzero(face < 0)
                self._escaped(far if bounce == 0 else near, point[free], carried[free], aim[free])
            if bounce == bounces:
                break
            side = self._sides(face, aim)
            go_on = np.flatnonzero(side >= 0)
            vertices, reflected = self._vertices(side[go_on], where[go_on])
            point, carried = point[go_on], carried[go_on] * reflected
            start = (vertices.positions + self.tracer.offset * vertices.geometric_normals).astype(np.float32)
            self._lit(near, point, carried, vertices, start)
            aim = towards(vertices.normals, rng.random((len(point), 2), np.float32))
        return far / each, near / each

    def _sides(self, face: Int[Array, " m"], aim: Float32[Array, "m 3"]) -> Int[Array, " m"]:
        """The one-sided face that a ray sees; -1 for none, and for the unseen back of one."""
        front = np.einsum("ni,ni->n", self.normals[face], aim) < 0
        return np.where(face < 0, -1, np.where(front, face, self.behind[face]))

    def _vertices(self, side: Int[Array, " m"], where: Float32[Array, "m 2"]) -> tuple[Samples, Float32[Array, "m 3"]]:
        """Points on faces, and their albedo. A back's corners stand in reverse."""
        u, v = where.astype(np.float64).T
        first = 1 - u - v
        back = side >= self.fronts
        weights = np.stack([np.where(back, v, first), u, np.where(back, first, v)], axis=1)
        return at_barycentric(self.split, side, weights), albedo_at(self.split, side, weights)

    def lamps(self, points: Samples) -> Float64[Array, "l n 3"]:
        """Irradiance of points from the lamps of each lighting."""
        start = self.tracer.origins(points.positions, points.geometric_normals)
        total = np.zeros((len(self.lightings), len(start), 3))
        here = replace(points, positions=self.tracer.frame.to_unit(points.positions))
        self._lit(total, np.arange(len(start)), np.ones((len(start), 3), np.float32), here, start)
        return total

    def _lit(
        self,
        total: Float64[Array, "l n 3"],
        point: Int[Array, " m"],
        carried: Float32[Array, "m 3"],
        vertices: Samples,
        starts: Float32[Array, "m 3"],
    ) -> None:
        """Adds what lamps send to vertices of paths (unit coordinates) to the points that these began at."""
        normals, sides = (each.astype(np.float64) for each in (vertices.normals, vertices.geometric_normals))
        for row, lighting in zip(total, self.lightings, strict=True):
            for lamp in lighting.lamps:
                found = direct.from_lamp(lamp, self.tracer, vertices.positions, normals, sides, starts)
                lit = np.flatnonzero(found)
                _add(row, point[lit], carried[lit] * (found[lit, None] * np.asarray(lamp.colour)))

    def _escaped(
        self,
        total: Float64[Array, "l n 3"],
        point: Int[Array, " m"],
        carried: Float32[Array, "m 3"],
        aim: Float32[Array, "m 3"],
    ) -> None:
        """Adds light from far away along rays that leave the scene: pi times its radiance, by the cosine density."""
        harmonics = sh.evaluate(aim.astype(np.float64), self.bands)
        for row, lighting in zip(total, self.lightings, strict=True):
            if lighting.environment is not None:
                distant = lighting.environment
                _add(row, point, np.pi * carried * (harmonics[:, : len(distant)] @ distant))


def _add(total: Float64[Array, "n 3"], point: Int[Array, " m"], light: Float[Array, "m 3"]) -> None:
    for colour in range(3):
        total[:, colour] += np.bincount(point, light[:, colour], len(total))


def stratified(count: int, each: int, rng: np.random.Generator) -> Float32[Array, "m 2"]:
    """`each` numbers in [0, 1)^2 for every one of `count` points: the R2 sequence, shifted for each by chance."""
    sequence = np.arange(each)[:, None] * R2_STEP
    return ((sequence + rng.random((count, 1, 2))) % 1).reshape(-1, 2).astype(np.float32)


def towards(normals: Float32[Array, "m 3"], numbers: Float32[Array, "m 2"]) -> Float32[Array, "m 3"]:
    """Unit directions of cosine density about unit normals: a point of the unit sphere that touches the surface there,
    from uniform numbers."""
    height = 1 - 2 * numbers[:, 0]
    radius = np.sqrt(np.maximum(1 - height * height, 0))
    angle = np.float32(2 * np.pi) * numbers[:, 1]
    away = normals + np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    length = np.sqrt(np.einsum("ni,ni->n", away, away))[:, None]
    return np.where(length > 1e-4, away / np.maximum(length, 1e-4), normals)


def alike(starts: Float32[Array, "m 3"], aims: Float32[Array, "m 3"]) -> Int[Array, " m"]:
    """An order in which rays of one octant that begin close to each other follow each other: their packets walk the
    tree together."""
    cells = np.clip((starts + 1) * np.float32(CELLS / 2), 0, CELLS - 1).astype(np.uint16)
    octant = (aims > 0).astype(np.uint16)
    key = np.zeros(len(starts), np.uint16)
    for digit, base in ((octant, 2), (cells, CELLS)):
        for axis in range(3):
            key = key * np.uint16(base) + digit[:, axis]
    return np.argsort(key, kind="stable")


def _check(points: Samples, albedo: Array, samples: int, bounces: int) -> None:
    if samples < 1 or bounces < 0:
        raise PrtnetError(
            f"path tracer: found {samples} samples and {bounces} bounces, expected at least 1 and at least 0"
        )
    if len(albedo) != len(points.positions):
        raise PrtnetError(f"path tracer: found albedo of {len(albedo)} points, expected {len(points.positions)}")
