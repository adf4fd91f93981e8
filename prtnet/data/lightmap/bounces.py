"""Light between diffuse surfaces, bounce by bounce over the texels of an atlas, for many configurations at once.

    E_b(p) = sum_i w_i albedo(q_i) / pi E_(b-1)(q_i),  E_0: direct irradiance,  indirect = E_1 + ... + E_B

q_i: the texel that ray i of p hits; w_i: its weight with the cosine. The same rays serve every configuration.

Where a floor runs on below a wall, texels along the wall stand for points within it, which are dark. They take part
with the values of the nearest texel in sight instead, or the foot of every wall would be too dark.
"""

import logging
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int

from prtnet import PrtnetError, sh
from prtnet.data import transfer
from prtnet.data.elimination import near_pairs
from prtnet.data.lightmap.rendered import Rendered, of_halves
from prtnet.data.samples import Samples
from prtnet.data.surface import Surface
from prtnet.data.tracer import Tracer

log = logging.getLogger(__name__)
Array = np.ndarray

# configurations that are carried through the rays together
GROUP = 128
# rays that tell whether a texel is within a solid: most of them hit surfaces from behind
HIDDEN_RAYS = 64
# how many texels away one in sight may be that a hidden one takes its values from
REACH = 4.0


def indirect(
    tracer: Tracer,
    points: Samples,
    albedo: Float[Array, "t 3"],
    surface: Surface,
    direct: Float32[Array, "c _ 3"],
    *,
    bounces: int = 4,
    directions: int = 512,
    rng: np.random.Generator,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Rendered:
    """Irradiance at texels from other surfaces after exactly so many bounces, without albedo of the receiver.

    `points`, `albedo` and `direct` (irradiance) are of the rows of `surface`. Half of the `directions` of a texel make
    a lightmap of its own; the two are independent, and their difference gives the noise. What is left out by stopping
    is estimated, with the light of the last two bounces as a geometric series. `progress` gets texels done, in all
    `2 * bounces * t` for each group of configurations.
    """
    _check(points, albedo, direct, bounces)
    where = points.positions, points.normals
    options = {"geometric_normals": points.geometric_normals, "threads": threads}
    source = sources(points, hidden(tracer, points, surface, threads))
    halves = [np.zeros_like(direct) for _ in range(2)]
    sums, done = np.zeros((bounces, 3)), 0
    for first in range(0, len(direct), GROUP):
        group = slice(first, first + GROUP)
        received = np.ascontiguousarray(direct[group].transpose(1, 0, 2))
        for half in halves:
            last = received
            for bounce in range(bounces):
                sent = (last[source] * (albedo / np.pi)[:, None, :]).astype(np.float32)
                last = transfer.bounce(
                    tracer, *where, surface, sent, directions=max(1, directions // 2), rng=rng, **options
                )
                half[group] += last.transpose(1, 0, 2)
                sums[bounce] += last.sum(axis=(0, 1), dtype=np.float64) / 2
                done += len(albedo)
                if progress is not None:
                    progress(done)
    for half in halves:
        half[:] = half[:, source]
    return of_halves(halves[0], halves[1], left_out(sums, albedo))


def hidden(tracer: Tracer, points: Samples, surface: Surface, threads: int | None = None) -> Bool[Array, " t"]:
    """Texels from which most directions end on the unseen backs of surfaces: within a solid, or behind a wall."""
    where, rng = (points.positions, points.normals), np.random.default_rng(0)
    options = {"geometric_normals": points.geometric_normals, "directions": HIDDEN_RAYS, "threads": threads}
    free = transfer.bake(tracer, *where, bands=1, rng=rng, **options)[:, 0] / sh.evaluate(np.array([[0, 0, 1.0]]), 1)
    white = np.ones((len(points.positions), 1, 3), np.float32)
    seen = transfer.bounce(tracer, *where, surface, white, rng=rng, **options)[:, 0, 0]
    return (free[0] + seen) / np.pi < 0.5


def sources(points: Samples, within: Bool[Array, " t"]) -> Int[Array, " t"]:
    """The texel whose values each takes: itself, or in place of one `within` a solid the nearest in sight that faces
    the same way, where there is one a few texels away."""
    source, normals = np.arange(len(within)), points.normals.astype(np.float64)
    if not within.any() or within.all():
        return source
    # texels stand row by row: even where charts are tiny, a quarter of them are followed by a neighbour
    reach = REACH * float(np.quantile(np.linalg.norm(np.diff(points.positions, axis=0), axis=1), 0.25))
    few = _around(points.positions, within, reach)
    pairs = near_pairs(np.concatenate([points.positions[few], reach * normals[few]], axis=1), reach)
    lost, found = few[np.concatenate(pairs)], few[np.concatenate(pairs[::-1])]
    mends = within[lost] & ~within[found]
    lost, found = lost[mends], found[mends]
    away = np.linalg.norm(points.positions[lost] - points.positions[found], axis=1)
    order = np.lexsort((found, away))[::-1]
    # the last of equal places is the one that stays: the nearest
    source[lost[order]] = found[order]
    return source


def _around(positions: Float[Array, "t 3"], within: Bool[Array, " t"], reach: float) -> Int[Array, " n"]:
    """The points in cells of the size `reach` in or beside which there is one `within`."""
    cells = np.floor((positions - positions.min(axis=0)) / reach).astype(np.int64) + 1
    shape = cells.max(axis=0) + 2
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 1, 3)
    beside = np.ravel_multi_index(np.moveaxis(np.unique(cells[within], axis=0) + steps, -1, 0), shape)
    return np.flatnonzero(np.isin(np.ravel_multi_index(cells.T, shape), beside))


def left_out(sums: Float64[Array, "b 3"], albedo: Float[Array, "t 3"]) -> float:
    """What comes after the last bounce as a share of all before it: a geometric series, from the light of each bounce.

    The ratio is that of the last two bounces, or the albedo where there is but one, which it cannot exceed for long.
    """
    total = float(sums.sum())
    if total <= 0:
        return 0.0
    largest = albedo.max(axis=0).astype(np.float64)
    ratio = largest
    if len(sums) > 1:
        before = np.where(sums[-2] > 0, sums[-2], 1)
        ratio = np.minimum(sums[-1] / before, largest)
    ratio = np.minimum(ratio, 0.999)
    return float(np.sum(sums[-1] * ratio / (1 - ratio))) / total


def _check(points: Samples, albedo: Array, direct: Array, bounces: int) -> None:
    if not len(points.positions) == len(albedo) == direct.shape[1]:
        raise PrtnetError(
            f"lightmap: found {len(points.positions)} points, albedo of {len(albedo)} and direct light of"
            f" {direct.shape[1]} texels, expected the same number of each"
        )
    if bounces < 1:
        raise PrtnetError(f"data_driven.bounces: found {bounces}, expected at least 1")
    if not np.isfinite(direct).all():
        raise PrtnetError("lightmap: found direct light that is not finite")
