"""A path tracer of many lighting configurations at once, on Mitsuba's surfaces, curves and media.

The paths do not depend on the lamps, so one set of them serves all: where a path meets a surface, every lamp is looked
at from there (next-event estimation), and where it leaves the scene every environment is. What is inside a medium lies
behind a boundary that refracts, where lamps without a size cannot be aimed at; their light comes in at the boundary,
which must be rough to pass it on. Media are homogeneous and scatter evenly in all directions.

Mitsuba's own integrators, one configuration at a time, are the plain twin.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float64

from prtnet import PrtnetError
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.lightmap.mitsuba import HEIGHT, clipped, module
from prtnet.data.lightmap.rendered import Rendered, of_halves
from prtnet.data.mapping import lat_long_directions

Array = np.ndarray

# paths that are traced in one go: bounds memory, and the sums of float32
LANES = 1 << 18
# surfaces that a path meets before chance decides whether it goes on, and after which it ends anyway
SURE, LAST = 6, 256
# share of the way to a lamp, or of the longest scene, that shadow rays leave out or go beyond
SHORT, BEYOND = 1e-4, 1e4
# what a path in a medium has left when chance decides whether it goes on
FAINT = 0.1
KINDS = {"directional": 0, "point": 1, "spot": 2}


@dataclass(frozen=True, eq=False)
class Medium:
    """What fills a part: extinction per unit length, and the share of light that scattering keeps, per colour."""

    density: float
    albedo: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class _Lamps:
    """All lamps of all configurations as arrays on the device; and environments as images, one after the other."""

    count: int
    kind: Any
    position: Any
    aim: Any
    colour: Any
    cosines: Any
    owner: Any
    environments: int
    image: Any
    of_environment: Any


def radiance(
    scene: Any,
    start: Callable[[Any, Any], Any],
    count: int,
    lightings: Sequence[Lighting],
    *,
    samples: int,
    seed: int,
    density: float = 0.0,
    progress: Callable[[int], None] | None = None,
) -> Rendered:
    """Mean radiance along random rays of each of `count` texels, under each lighting.

    `start(sampler, texel)` gives a Mitsuba ray for each index into the texels; `density` is the extinction of every
    medium of the scene. `progress` gets the paths done, of `samples * count`. Raises PrtnetError for fewer than two
    samples: the noise comes from two independent halves.
    """
    if samples < 2:
        raise PrtnetError(f"data_driven.directions: found {samples}, expected at least 2 samples for each texel")
    mi = module()
    lamps = _gathered(mi, lightings)
    halves, done = [], 0
    for half in range(2):
        total, left, turn = np.zeros((count * len(lightings), 3)), samples // 2, 0
        while left:
            each = max(1, min(left, LANES // count))
            number = int(np.random.default_rng([seed, half, turn]).integers(2**32))
            total += _pass(mi, scene, start, count, each, lamps, len(lightings), density, number)
            left, turn, done = left - each, turn + 1, done + each * count
            if progress is not None:
                progress(done)
        halves.append((total / (samples // 2)).reshape(count, len(lightings), 3).transpose(1, 0, 2))
    return of_halves(halves[0].astype(np.float32), halves[1].astype(np.float32))


def _gathered(mi: Any, lightings: Sequence[Lighting]) -> _Lamps:
    lamps = [(owner, lamp) for owner, lighting in enumerate(lightings) for lamp in lighting.lamps]
    distant = [(owner, each.environment) for owner, each in enumerate(lightings) if each.environment is not None]

    def vectors(name: str) -> Any:
        return mi.Point3f(np.array([getattr(lamp, name) for _, lamp in lamps], np.float32).reshape(-1, 3).T)

    cosines = np.cos(np.radians([[lamp.outer, lamp.inner] for _, lamp in lamps])).reshape(-1, 2)
    towards = lat_long_directions(HEIGHT, 2 * HEIGHT)
    images = [clipped(towards, environment) for _, environment in distant]
    return _Lamps(
        len(lamps),
        mi.UInt32(np.array([KINDS[lamp.kind] for _, lamp in lamps], np.uint32)),
        vectors("position"),
        vectors("aim"),
        vectors("colour"),
        mi.Point2f(cosines.T.astype(np.float32)),
        mi.UInt32(np.array([owner for owner, _ in lamps], np.uint32)),
        len(images),
        mi.Float(np.array(images, np.float32).ravel()),
        mi.UInt32(np.array([owner for owner, _ in distant], np.uint32)),
    )


def _pass(
    mi: Any,
    scene: Any,
    start: Callable[[Any, Any], Any],
    count: int,
    each: int,
    lamps: _Lamps,
    lightings: int,
    density: float,
    seed: int,
) -> Float64[Array, "n 3"]:
    """The sum of `each` paths of every texel, "(count lightings) 3"."""
    import drjit as dr

    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, each * count)
    # neighbours in a packet are texels of their own, so that their sums do not wait for each other
    texel = dr.arange(mi.UInt32, each * count) % count
    target = dr.zeros(mi.Float, count * lightings * 3)
    ray = start(sampler, texel)
    row = texel * lightings

    def step(o: Any, d: Any, beta: Any, albedo: Any, depth: Any, active: Any, sampler: Any) -> tuple[Any, ...]:
        """From one surface to the next."""
        inside = active & (dr.max(albedo) > 0)
        o, d, beta, sampler = _walked(mi, scene, o, d, beta, albedo, inside, sampler, density)
        active &= dr.max(beta) > 0
        found = scene.ray_intersect(mi.Ray3f(o, d), active)
        _from_afar(mi, target, row, lamps, d, beta, active & ~found.is_valid())
        active &= found.is_valid()
        bsdf, context = found.bsdf(), mi.BSDFContext()
        _from_lamps(mi, scene, target, row, lamps, found, bsdf, beta, active)
        drawn, weight = bsdf.sample(context, found, sampler.next_1d(active), sampler.next_2d(active), active)
        onward = found.spawn_ray(found.to_world(drawn.wo))
        beta = dr.select(active, beta * weight, 0)
        crossing = active & found.is_medium_transition()
        albedo = dr.select(crossing, _albedo_of(mi, found.target_medium(onward.d), crossing), albedo)
        depth += 1
        chance = dr.select(depth > SURE, dr.minimum(dr.max(beta) * dr.square(drawn.eta), 0.95), 1)
        active &= (sampler.next_1d(active) < chance) & (depth < LAST) & (dr.max(beta) > 0)
        beta = dr.select(active, beta / chance, 0)
        return onward.o, onward.d, beta, albedo, depth, active, sampler

    zero = mi.Color3f(0)
    state = ray.o, ray.d, mi.Color3f(1), zero, mi.UInt32(0), mi.Bool(True), sampler
    dr.while_loop(state, lambda o, d, beta, albedo, depth, active, sampler: active, step, label="surfaces")
    return np.array(target, np.float64).reshape(-1, 3)


def _albedo_of(mi: Any, medium: Any, active: Any) -> Any:
    """0 where there is none."""
    import drjit as dr

    scattered, _, extinction = medium.get_scattering_coefficients(dr.zeros(mi.MediumInteraction3f), active)
    return dr.select(dr.max(extinction) > 0, scattered / extinction, 0)


def _walked(
    mi: Any, scene: Any, o: Any, d: Any, beta: Any, albedo: Any, inside: Any, sampler: Any, density: float
) -> tuple[Any, Any, Any, Any]:
    """Scattered within a medium until the next thing on the way is a surface."""
    import drjit as dr

    if not density:
        return o, d, beta, sampler

    def scatter(o: Any, d: Any, beta: Any, walking: Any, sampler: Any) -> tuple[Any, ...]:
        length = -dr.log(1 - sampler.next_1d(walking)) / density
        walking &= ~scene.ray_test(mi.Ray3f(o, d, length, 0, []), walking)
        turned = mi.warp.square_to_uniform_sphere(sampler.next_2d(walking))
        o, d = dr.select(walking, o + length * d, o), dr.select(walking, turned, d)
        beta = dr.select(walking, beta * albedo, beta)
        # what has little left goes on with little chance, and with more
        chance = dr.select(walking, dr.minimum(dr.max(beta) / FAINT, 1), 1)
        beta = dr.select(sampler.next_1d(walking) < chance, beta / chance, 0)
        return o, d, beta, walking & (dr.max(beta) > 0), sampler

    state = o, d, beta, inside, sampler
    o, d, beta, _, sampler = dr.while_loop(state, lambda o, d, beta, walking, sampler: walking, scatter, label="medium")
    return o, d, beta, sampler


def _from_lamps(
    mi: Any, scene: Any, target: Any, row: Any, lamps: _Lamps, found: Any, bsdf: Any, beta: Any, active: Any
) -> None:
    """Adds what a surface sends along the path from every lamp to the lamp's configuration."""
    import drjit as dr

    if not lamps.count:
        return
    # a lamp behind the boundary of a solid does not shine on it from inside
    solid = found.is_medium_transition()

    def add(lamp: Any) -> tuple[Any]:
        kind = dr.gather(mi.UInt32, lamps.kind, lamp, active)
        aim = dr.gather(mi.Point3f, lamps.aim, lamp, active)
        away = dr.gather(mi.Point3f, lamps.position, lamp, active) - found.p
        distance = dr.norm(away)
        near = kind > 0
        towards = dr.select(near, mi.Vector3f(away / distance), mi.Vector3f(-aim))
        outer, inner = dr.gather(mi.Point2f, lamps.cosines, lamp, active)
        share = dr.clip((-dr.dot(towards, mi.Vector3f(aim)) - outer) / (inner - outer), 0, 1)
        strength = dr.select(near, dr.rcp(dr.square(distance)), 1)
        strength *= dr.select(kind == KINDS["spot"], share * share * (3 - 2 * share), 1)
        lit = active & (strength > 0) & (~solid | (dr.dot(found.n, towards) > 0))
        shadow = found.spawn_ray(towards)
        shadow.maxt = dr.select(near, distance * (1 - SHORT), BEYOND)
        sent = bsdf.eval(mi.BSDFContext(), found, found.to_local(towards), lit)
        lit &= (dr.max(sent) > 0) & ~scene.ray_test(shadow, lit)
        value = beta * sent * strength * mi.Color3f(dr.gather(mi.Point3f, lamps.colour, lamp, active))
        _add(target, value, row + dr.gather(mi.UInt32, lamps.owner, lamp, active), lit)
        return (lamp + 1,)

    dr.while_loop((mi.UInt32(0),), lambda lamp: active & (lamp < lamps.count), add, label="lamps")


def _from_afar(mi: Any, target: Any, row: Any, lamps: _Lamps, d: Any, beta: Any, active: Any) -> None:
    """Adds what every environment sends down a ray that leaves the scene."""
    import drjit as dr

    if not lamps.environments:
        return
    height, width = HEIGHT, 2 * HEIGHT
    across = 0.5 + dr.atan2(d.x, -d.z) / (2 * np.pi)
    column = dr.minimum(mi.UInt32(across * width), width - 1)
    down = dr.minimum(mi.UInt32(dr.acos(dr.clip(d.y, -1, 1)) / np.pi * height), height - 1)
    pixel = down * width + column

    def add(number: Any) -> tuple[Any]:
        value = dr.gather(mi.Color3f, lamps.image, number * (height * width) + pixel, active)
        _add(target, beta * value, row + dr.gather(mi.UInt32, lamps.of_environment, number, active), active)
        return (number + 1,)

    dr.while_loop((mi.UInt32(0),), lambda number: active & (number < lamps.environments), add, label="environments")


def _add(target: Any, value: Any, row: Any, active: Any) -> None:
    import drjit as dr

    for colour in range(3):
        dr.scatter_add(target, value[colour], row * 3 + colour, active)
