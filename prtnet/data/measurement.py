"""Where direct light is measured: blue noise on surfaces, or on a hull around a scene.

Belcour, Deliot, Barbier and Soler 2022, *A Data-Driven Paradigm for Precomputed Radiance Transfer*. A measurement is
the mean over surface points near each other, on the same side, so that shadow edges that pass between two of them
change it little by little.
"""

from collections.abc import Callable
from math import sqrt

import numpy as np
from jaxtyping import Bool, Float, Int

from prtnet import PrtnetError
from prtnet.data.albedo import albedo
from prtnet.data.elimination import eliminate, near_pairs
from prtnet.data.hull import hull_of
from prtnet.data.lighting.placing import Places
from prtnet.data.samples import Samples, area_uniform, select
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer
from prtnet.data_driven import Measurement

Array = np.ndarray

CANDIDATES = 8  # that each point is chosen from
SPARE = 2  # times as many neighbours are looked at as are taken
BLOCK = 2048  # places whose distances to all points are held at a time
UNREACHED = 4  # times as many candidates where light may reach some of the surface only
COINCIDENT = 1e-6  # of positions and normals, below which two measurements are one
LARGEST = 4096  # points; each is a row of the matrix that is multiplied by at run time


def on_surface(
    scene: Scene,
    count: int,
    supersampling: int,
    rng: np.random.Generator,
    *,
    reached: Callable[[Samples], Bool[Array, " n"]] | None = None,
) -> Measurement:
    """`count` points on the surfaces of a scene in unit coordinates, each the mean of `supersampling` neighbours.

    Prefixes are well spread as well. Both sides of two-sided faces count; what lies on other surfaces does not, nor do
    the outer walls of a room, nor what is not `reached` by any of the lights that are measured. The transfer is left
    empty. Raises PrtnetError for a count or supersampling below 1 or too large, and where too little surface is left.
    """
    _check_counts(count, supersampling)
    wanted = count * max(SPARE * supersampling, CANDIDATES) * (1 if reached is None else UNREACHED)
    found = area_uniform(scene, wanted, rng)
    worth, _ = Places(scene, Tracer(scene)).worth(found)
    if reached is not None:
        worth &= reached(found)
    if worth.sum() < count:
        raise PrtnetError(
            f"{scene.name}: found room for {worth.sum()} of {count} measurement points: its other surfaces are hidden"
            " or out of the light, expected surfaces that light can reach; lower data_driven.points"
        )
    area = float(scene.split_sides().face_areas.sum()) * float(worth.mean())
    return _chosen(scene, select(found, worth), area, count, supersampling)


def on_hull(scene: Scene, count: int, supersampling: int, rng: np.random.Generator) -> Measurement:
    """`count` points on a smooth closed surface around a scene in unit coordinates, of albedo 1; else `on_surface`.

    For hair and foliage, whose own surfaces are too many and too small to be sampled.
    """
    _check_counts(count, supersampling)
    hull = hull_of(scene)
    found = area_uniform(hull, count * max(SPARE * supersampling, CANDIDATES), rng)
    return _chosen(hull, found, float(hull.face_areas.sum()), count, supersampling)


def _check_counts(count: int, supersampling: int) -> None:
    if not 1 <= count <= LARGEST:
        raise PrtnetError(f"data_driven.points: found {count}, expected 1 to {LARGEST}")
    if not 1 <= supersampling <= 64:
        raise PrtnetError(f"data_driven.supersampling: found {supersampling}, expected 1 to 64")


def _chosen(scene: Scene, found: Samples, area: float, count: int, supersampling: int) -> Measurement:
    # in random order, so that the first ones are as fair as all
    first = slice(CANDIDATES * count)
    kept = eliminate(found.positions[first], found.geometric_normals[first], count, area)
    radius = sqrt(area / count)
    group = neighbours(found.positions, found.geometric_normals, kept, supersampling, radius)
    assert found.weights is not None
    colours = albedo(scene.split_sides(), found.face, found.weights)
    fields = (found.positions, found.normals, found.geometric_normals, colours)
    positions, normals, sides, colours = (np.ascontiguousarray(each[group], np.float32) for each in fields)
    measurement = Measurement(positions, normals, sides, colours, np.zeros((count, 0, 3), np.float32))
    check(measurement)
    return measurement


def neighbours(
    positions: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    kept: Int[Array, " m"],
    count: int,
    radius: float,
) -> Int[Array, "m count"]:
    """Each kept point and the nearest of those points that are nearer to it than to any other kept one, on its side.

    Distances as in `eliminate`. A point belongs to one group; where one has too few, they are repeated in turn.
    """
    places = np.concatenate([positions, radius * normals], axis=1).astype(np.float64)
    owner, distance = _nearest_row(places, places[kept])
    owner[kept], distance[kept] = np.arange(len(kept)), -1
    same_side = np.einsum("ni,ni->n", normals, normals[kept][owner]) > 0
    order = np.lexsort((distance, owner))
    order = order[same_side[order]]
    sizes = np.bincount(owner[order], minlength=len(kept))
    starts = np.cumsum(sizes) - sizes
    return order[starts[:, None] + np.arange(count) % sizes[:, None]]


def _nearest_row(places: Float[Array, "n d"], rows: Float[Array, "m d"]) -> tuple[Int[Array, " n"], Float[Array, " n"]]:
    """(the row that is nearest to each place, its squared distance)."""
    owner, squared = np.empty(len(places), np.int64), np.empty(len(places))
    length = np.sum(rows**2, axis=1)
    for start in range(0, len(places), BLOCK):
        block = places[start : start + BLOCK]
        apart = length - 2 * block @ rows.T
        nearest = apart.argmin(axis=1)
        owner[start : start + BLOCK] = nearest
        squared[start : start + BLOCK] = np.sum((block - rows[nearest]) ** 2, axis=1)
    return owner, squared


def check(measurement: Measurement) -> None:
    """Raises PrtnetError where two measurement points are one: the same places, on the same side."""
    places = [measurement.positions.mean(axis=1), measurement.geometric_normals.mean(axis=1)]
    rows = np.concatenate(places, axis=1).astype(np.float64)
    if not np.isfinite(rows).all():
        raise PrtnetError("measurement points: found numbers that are not finite")
    first, second = near_pairs(rows, COINCIDENT) if len(rows) else (np.zeros(0, int),) * 2
    if len(first):
        where = ", ".join(f"{value:.4g}" for value in rows[first[0], :3])
        raise PrtnetError(
            f"measurement points: found {first[0]} and {second[0]} at the same place ({where}) and {len(first) - 1}"
            " other such pairs, expected points apart from each other; lower data_driven.points"
        )
