"""Radiance towards the eye with no spherical harmonics at all: the reference that tells the error of SH itself.

    B = integral of L(w) V(p, w) max(0, n.w) (diffuse albedo / pi + specular (e+1)/2pi max(0, r.w)^e) dw

by Monte Carlo: the reflectance and the lobe are those of `render.material`, r the direction to the eye mirrored at the
shading normal, V ray-traced from points off the surface, as transfer is baked. Directions are drawn from the light,
from the cosine and from the lobe, and combined by the balance heuristic: each sample counts f / sum_k n_k p_k over
the n_k samples of all strategies (Veach and Guibas 1995, *Optimally Combining Sampling Techniques*). Numbers are the
R2 sequence (Roberts 2018) with a random shift per point and strategy.

With bounces, paths go on at what the cosine and the lobe hit, where light and cosine are drawn once each (Kajiya 1986,
*The Rendering Equation*, with next-event estimation). Hits reflect as `data.met` says and are diffuse: only the
point that the eye sees has a lobe.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from math import pi

import numpy as np
from jaxtyping import Float32, Float64, Int

from prtnet import PrtnetError
from prtnet.data.light_sampler import Sampler
from prtnet.data.met import Met, meet
from prtnet.data.samples import R2_STEP
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer
from prtnet.data.transfer import in_threads
from prtnet.render import reflectance
from prtnet.render.gbuffer import GBuffer
from prtnet.render.material import Material, Reflectance, mirrored

Array = np.ndarray

STRATEGIES = ("light", "cosine", "lobe")
CHUNK_SAMPLES = 1 << 16  # held at a time by each thread


@dataclass(frozen=True, eq=False)
class Points:
    """What is to be shaded, each point with its own reflectance."""

    # unit coordinates, off the surface
    origins: Float32[Array, "n 3"]
    # unit shading normals, and the direction to the eye mirrored at them
    normals: Float64[Array, "n 3"]
    mirrored: Float64[Array, "n 3"]
    # linear RGB, the weights of the material in them
    diffuse: Float64[Array, "n 3"]
    specular: Float64[Array, "n 3"]
    exponent: Float64[Array, " n"]

    def take(self, index: Int[Array, " m"]) -> "Points":
        """Some of them."""
        return Points(**{field.name: getattr(self, field.name)[index] for field in fields(self)})


def points_of(tracer: Tracer, gbuffer: GBuffer, material: Material) -> Points:
    """The covered pixels of a view, in the order of `gbuffer.pixel`."""
    positions, count = gbuffer.positions.astype(np.float64), len(gbuffer.pixel)
    own = reflectance.of_points(material, gbuffer.parts, gbuffer.part, gbuffer.roughness)
    if own is None:
        specular = np.tile(np.asarray(material.specular, np.float64), (count, 1))
        own = Reflectance(np.full(count, material.diffuse), specular, np.full(count, float(material.exponent)))
    return Points(
        tracer.origins(tracer.frame.from_unit(positions), gbuffer.geometric_normals),
        gbuffer.normals.astype(np.float64),
        mirrored(np.asarray(gbuffer.eye) - positions, gbuffer.normals),
        own.diffuse[:, None] * gbuffer.albedo.astype(np.float64),
        own.specular,
        own.exponent,
    )


@dataclass(frozen=True, eq=False)
class World:
    """What light comes from and what stands in its way."""

    tracer: Tracer
    sampler: Sampler
    # of the tracer; only bounces look at it
    scene: Scene | None = None


def radiance(
    world: World,
    points: Points,
    *,
    samples: int,
    rng: np.random.Generator,
    bounces: int = 0,
    strategies: Sequence[str] = STRATEGIES,
    progress: Callable[[int], None] | None = None,
    threads: int = 1,
) -> Float64[Array, "n 3"]:
    """Linear RGB radiance of points towards the eye, from `samples` directions each, shared among the strategies.

    Strategies that cannot give anything are left out: the lobe without gloss; all but one shadow ray under a light
    from a single direction. A point's bits depend on rng, its row and its place in the input, not on threads.
    `progress` gets the number of points done. Raises PrtnetError for bounces without a scene.
    """
    if samples < 1 or bounces < 0:
        found = f"found {samples} samples and {bounces} bounces"
        raise PrtnetError(f"exact: {found}, expected at least 1 sample and 0 or more bounces")
    if bounces and world.scene is None:
        raise PrtnetError(f"exact: found {bounces} bounces and no scene, expected the scene that light bounces in")
    counts = _counts(world.sampler, samples, strategies, bounces, glossy=bool(points.specular.any()))
    chunks = np.array_split(np.arange(len(points.origins)), max(1, -(-len(points.origins) * samples // CHUNK_SAMPLES)))
    streams = rng.spawn(len(chunks))
    out, done = np.empty((len(points.origins), 3)), 0

    def work(chunk: tuple[Array, np.random.Generator]) -> int:
        index, stream = chunk
        out[index] = _gathered(world, points.take(index), counts, stream, bounces)
        return len(index)

    for count in in_threads(work, zip(chunks, streams, strict=True), threads):
        done += count
        if progress is not None:
            progress(done)
    return out


def _counts(sampler: Sampler, samples: int, strategies: Sequence[str], bounces: int, *, glossy: bool) -> dict[str, int]:
    """Samples of each strategy, one at least."""
    used = [name for name in STRATEGIES if name in strategies and (glossy or name != "lobe")]
    counts = {name: max(1, len(range(place, samples, len(used)))) for place, name in enumerate(used)}
    if sampler.single:
        scattered = len(used) - ("light" in used)
        share = max(1, samples // max(scattered, 1)) if bounces else 0
        counts = {name: 1 if name == "light" else share for name in used}
    return dict.fromkeys(STRATEGIES, 0) | counts


def _gathered(
    world: World, points: Points, counts: dict[str, int], rng: np.random.Generator, bounces: int
) -> Float64[Array, "n 3"]:
    """One estimate per point of the light that arrives directly and over so many bounces."""
    total = np.zeros((len(points.origins), 3))
    if counts["light"]:
        total += _lit(world, points, counts, rng)
    drawn = [draw(points, _numbers(rng, points, counts[name])) for name, draw in DRAWS.items() if counts[name]]
    if drawn:
        total += _scattered(world, points, np.concatenate(drawn, axis=1), counts, rng, bounces)
    return total


def _lit(world: World, points: Points, counts: dict[str, int], rng: np.random.Generator) -> Float64[Array, "n 3"]:
    """Next-event estimation: directions from the light."""
    numbers = _numbers(rng, points, counts["light"])
    directions, light, density = world.sampler.draw(numbers.reshape(-1, 2))
    directions = directions.reshape(*numbers.shape[:2], 3)
    mixed = counts["light"] * density.reshape(numbers.shape[:2])
    if not world.sampler.single:
        mixed = mixed + _scatter_density(points, directions, counts)
    value = reflected(points, directions) * _over(light.reshape(directions.shape), mixed)
    point, sample = np.nonzero(value.any(axis=2))
    hit = world.tracer.trace(points.origins[point], directions[point, sample].astype(np.float32))
    value[point[hit], sample[hit]] = 0
    return value.sum(axis=1)


def _scattered(
    world: World,
    points: Points,
    directions: Float64[Array, "n s 3"],
    counts: dict[str, int],
    rng: np.random.Generator,
    bounces: int,
) -> Float64[Array, "n 3"]:
    """Directions from the cosine and the lobe: light where they are free, and what they hit where paths go on."""
    flat = directions.reshape(-1, 3)
    mixed = own = _scatter_density(points, directions, counts)
    if counts["light"]:
        mixed = own + counts["light"] * world.sampler.density(flat).reshape(own.shape)
    taken = reflected(points, directions)
    value = taken * _over(world.sampler.radiance(flat).reshape(directions.shape), mixed)
    point, sample = np.nonzero(taken.any(axis=2) if bounces else value.any(axis=2))
    starts, towards = points.origins[point], directions[point, sample].astype(np.float32)
    if not bounces:
        hit = world.tracer.trace(starts, towards)
        value[point[hit], sample[hit]] = 0
        return value.sum(axis=1)
    face, where, _ = world.tracer.hits(starts, towards)
    hit = face >= 0
    point, sample = point[hit], sample[hit]
    value[point, sample] = 0
    if len(point):
        assert world.scene is not None
        met = _diffuse(world.tracer, meet(world.scene, face[hit], where[hit], towards[hit]))
        further = np.zeros((len(point), 3))
        bright = np.flatnonzero(met.diffuse.any(axis=1))  # paths end at what is black
        once = {"light": 1, "cosine": int(bounces > 1 or not world.sampler.single), "lobe": 0}
        further[bright] = _gathered(world, met.take(bright), once, rng, bounces - 1)
        value[point, sample] = _over(taken[point, sample], own[point, sample]) * further
    return value.sum(axis=1)


def _diffuse(tracer: Tracer, met: Met) -> Points:
    normals = met.normals.astype(np.float64)
    none = np.zeros_like(normals)
    origins = tracer.origins(tracer.frame.from_unit(met.positions), met.geometric_normals)
    return Points(origins, normals, normals, met.albedo, none, np.ones(len(normals)))


def reflected(points: Points, directions: Float64[Array, "n s 3"]) -> Float64[Array, "n s 3"]:
    """Of radiance from each direction, the part that goes to the eye per steradian, cosine included."""
    cosine = np.maximum(np.einsum("ni,nsi->ns", points.normals, directions), 0)[..., None]
    out = (points.diffuse / pi)[:, None] * cosine
    if points.specular.any():
        out += points.specular[:, None] * (_lobe_density(points, directions)[..., None] * cosine)
    return out


def _scatter_density(
    points: Points, directions: Float64[Array, "n s 3"], counts: dict[str, int]
) -> Float64[Array, "n s"]:
    """n p of cosine and lobe, summed: 0 behind both."""
    total = np.zeros(directions.shape[:2])
    if counts["cosine"]:
        total += counts["cosine"] / pi * np.maximum(np.einsum("ni,nsi->ns", points.normals, directions), 0)
    if counts["lobe"]:
        total += counts["lobe"] * _lobe_density(points, directions)
    return total


def _lobe_density(points: Points, directions: Float64[Array, "n s 3"]) -> Float64[Array, "n s"]:
    """(e+1)/2pi max(0, r.w)^e, which is both the lobe and the density of `_draw_lobe`."""
    cosine = np.maximum(np.einsum("ni,nsi->ns", points.mirrored, directions), 0)
    exponent = points.exponent[:, None]
    return (exponent + 1) / (2 * pi) * cosine**exponent


def _draw_cosine(points: Points, numbers: Float64[Array, "n s 2"]) -> Float64[Array, "n s 3"]:
    return _around(points.normals, np.sqrt(1 - numbers[..., 0]), numbers[..., 1])


def _draw_lobe(points: Points, numbers: Float64[Array, "n s 2"]) -> Float64[Array, "n s 3"]:
    cosine = (1 - numbers[..., 0]) ** (1 / (points.exponent[:, None] + 1))
    return _around(points.mirrored, cosine, numbers[..., 1])


DRAWS = {"cosine": _draw_cosine, "lobe": _draw_lobe}


def _around(
    axis: Float64[Array, "n 3"], cosine: Float64[Array, "n s"], turn: Float64[Array, "n s"]
) -> Float64[Array, "n s 3"]:
    """Unit directions at cosines from an axis. Duff et al. 2017, *Building an Orthonormal Basis, Revisited*."""
    x, y, z = axis.T
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1)[:, None]
    second = np.stack([b, sign + y * y * a, -y], axis=-1)[:, None]
    level, angle = np.sqrt(np.maximum(1 - cosine**2, 0)), 2 * pi * turn
    along, across = (level * np.cos(angle))[..., None], (level * np.sin(angle))[..., None]
    return along * first + across * second + cosine[..., None] * axis[:, None]


def _numbers(rng: np.random.Generator, points: Points, count: int) -> Float64[Array, "n s 2"]:
    shift = rng.random((len(points.origins), 1, 2))
    return (shift + np.arange(count)[:, None] * R2_STEP) % 1.0


def _over(values: Float64[Array, "*n 3"], density: Float64[Array, "*n"]) -> Float64[Array, "*n 3"]:
    """Values over densities; 0 where nothing is drawn."""
    return values * np.divide(1.0, density, out=np.zeros_like(density), where=density > 0)[..., None]
