"""Blue noise by weighted sample elimination: of many points, those that are spread best.

Yuksel 2015, *Sample Elimination for Generating Poisson Disk Sample Sets*: while there are too many points, the one that
is most crowded goes. A neighbour at distance d counts (1 - d / s)^8 up to a reach s of 3 r, r the largest radius that
so many Poisson disks can have (2 r in the paper). Weight limiting takes s beta (1 - (kept / given)^1.5) for distances
below that.

Points have a side: distances are those of positions and, r times, of unit normals, so that the two sides of a sheet are
2 r apart, however thin it is.
"""

from math import sqrt

import numpy as np
from jaxtyping import Float, Int

from prtnet import PrtnetError

Array = np.ndarray

# times as far as disks of that radius reach: on thin strips, where points have neighbours in two directions only, the
# spacing is larger than the area says, and points would stop to see each other
REACH = 1.5
# of weight limiting; the usual 0.65 is too much where neighbours are looked for that far
BETA = 0.3
GAMMA = 1.5
ALPHA = 8  # of the weight
ROUNDS = 30  # of a fixed point


def eliminate(
    positions: Float[Array, "n 3"], normals: Float[Array, "n 3"], count: int, area: float, *, beta: float = BETA
) -> Int[Array, " count"]:
    """Which of evenly distributed points on surfaces of an `area` (of all sides) are kept.

    Progressive: the kept ones are halved again and again, and those that go last stand first, so that the first few are
    spread well, too. Raises PrtnetError where there are fewer points than `count`.
    """
    if not 1 <= count <= len(positions):
        raise PrtnetError(f"sample elimination: found {len(positions)} points, expected at least the {count} to keep")
    extent = np.ptp(positions, axis=0)
    kept, _ = _level(positions, normals, np.arange(len(positions)), count, largest_radius(count, area, extent), beta)
    tails = []
    while len(kept) > 1:
        half = len(kept) // 2
        kept, gone = _level(positions, normals, kept, half, largest_radius(half, area, extent), beta)
        tails.append(gone[::-1])
    return np.concatenate([kept, *tails[::-1]])


def largest_radius(count: int, area: float, extent: Float[Array, " 3"]) -> float:
    """The largest radius of `count` Poisson disks on an area (Yuksel 2015, eq. 2), or that of spheres (eq. 3) in the
    box `extent` where it comes first: there surfaces fill the box, as hair does."""
    radius = disks = sqrt(area / (2 * sqrt(3) * count))
    for _ in range(ROUNDS):
        # spheres reach out of the box that their centres lie in
        spheres = (float(np.prod(extent + 2 * radius)) / (4 * sqrt(2) * count)) ** (1 / 3)
        radius = min(disks, spheres)
    return radius


def _level(
    positions: Array, normals: Array, index: Array, count: int, radius: float, beta: float
) -> tuple[Array, Array]:
    """(`count` of the points `index`, the others in the order in which they go)."""
    places, reach = np.concatenate([positions[index], radius * normals[index]], axis=1), 2 * REACH * radius
    first, second = near_pairs(places, reach)
    least = reach * beta * (1 - (count / len(index)) ** GAMMA)
    distance = np.maximum(np.linalg.norm(places[first] - places[second], axis=1), least)
    weight = (1 - distance / reach) ** ALPHA
    order = np.argsort(np.concatenate([first, second]), kind="stable")
    neighbour, share = np.concatenate([second, first])[order], np.concatenate([weight, weight])[order]
    crowded = np.bincount(np.concatenate([first, second]), np.tile(weight, 2), len(index)).astype(float)
    ends = np.cumsum(np.bincount(first, minlength=len(index)) + np.bincount(second, minlength=len(index)))
    gone = np.empty(len(index) - count, np.int64)
    for step in range(len(gone)):
        worst = gone[step] = crowded.argmax()
        around = slice(ends[worst - 1] if worst else 0, ends[worst])
        crowded[worst] = -np.inf
        crowded[neighbour[around]] -= share[around]
    return index[np.isfinite(crowded)], index[gone]


def near_pairs(points: Float[Array, "n d"], reach: float) -> tuple[Int[Array, " pairs"], Int[Array, " pairs"]]:
    """All pairs of points closer than `reach`, each once; the first three coordinates sort them into cells."""
    cells = np.floor((points[:, :3] - points[:, :3].min(axis=0)) / reach).astype(np.int64) + 1
    # a layer of empty cells around, so that no step leads into another row
    shape = cells.max(axis=0) + 2
    key = (cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]
    order = np.argsort(key, kind="stable")
    key, sorted_points = key[order], points[order]
    found = []
    steps = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    for x, y, z in steps[13:]:
        there = key + (x * shape[1] + y) * shape[2] + z
        # within its own cell a point meets those that stand behind it
        begin = np.searchsorted(key, there) if (x, y, z) != (0, 0, 0) else np.arange(1, len(key) + 1)
        count = np.searchsorted(key, there, side="right") - begin
        first = np.repeat(np.arange(len(key)), count)
        second = np.arange(len(first)) - np.repeat(np.cumsum(count) - count - begin, count)
        near = np.sum((sorted_points[first] - sorted_points[second]) ** 2, axis=1) < reach**2
        found.append(np.stack([first[near], second[near]]))
    pairs = order[np.concatenate(found, axis=1)]
    return pairs[0], pairs[1]
