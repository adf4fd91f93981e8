"""Whether a described surface is one: a distance that rays can walk by, with its zero inside the bounds.

All tests are on points: some tens of thousands in the box, on its faces, and on and beside the surface. They find what
is wrong nearly everywhere or in places of some size; a needle may slip through.
"""

import logging
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from prtnet import PrtnetError
from prtnet.data.implicit.field import Field
from prtnet.data.implicit.surface import Described

log = logging.getLogger(__name__)
Array = np.ndarray

INSIDE = 8000  # points in the box
SIDE = 40  # points along an edge of its faces
NEAR = 1500  # points on the surface
STEPS = 8  # towards it
# of the slope above `lipschitz`: rounding, and the ends of smooth blends
SLACK = 1.02
LONGEST = 20_000  # operations of a distance: compilers take minutes above it
FLAT = 0.05  # a slope below this share of `lipschitz` is worth a warning


class _Slope(NamedTuple):
    """A measured one, and where."""

    value: float
    point: Float[Array, " 3"]


def check(made: Described) -> None:
    """Raises PrtnetError for what is no surface, with what was found, where, and what to do. Takes under a second.

    A distance much flatter than it may be is only warned about: rays walk it slowly.
    """
    low, high = np.asarray(made.low, np.float64), np.asarray(made.high, np.float64)
    if not (np.isfinite([low, high]).all() and (low < high).all()):
        raise PrtnetError(f"{made.name}: bounds: found {made.low} to {made.high}, expected a box")
    if len(made.field.program) > LONGEST:
        raise PrtnetError(
            f"{made.name}: the distance takes {len(made.field.program)} operations, expected at most {LONGEST}: say "
            "copies by mirrored, repeated or around, which fold space, or leave shapes out"
        )
    rng, size = np.random.default_rng(0), float((high - low).max())
    points = low + (high - low) * rng.random((INSIDE, 3))
    faces = _faces(low, high)
    values, border = _finite(made, points), _finite(made, faces)
    surface = _on_surface(made.field, points, values)
    within = np.all((surface >= low) & (surface <= high), axis=1)
    _refuse_empty(made, points, values, surface, within)
    _refuse_outside(made, faces, border, size)
    if not within.all():
        raise PrtnetError(f"{made.name}: {_outside(made, surface[~within][0])}")
    # beside the surface, where rays start and slow down
    beside = surface + rng.normal(scale=0.02 * size, size=surface.shape)
    measured = _secants(made, points, values, size, rng), _gradients(made, np.concatenate([surface, beside]))
    _refuse_steep(made, max(measured, key=lambda slope: slope.value))
    _warn_flat(made, beside)


def _refuse_empty(
    made: Described,
    points: Float[Array, "n 3"],
    values: Float[Array, " n"],
    surface: Float[Array, "m 3"],
    within: Bool[Array, " m"],
) -> None:
    if within.any() or values.min() < 0 < values.max():
        return
    if values.max() <= 0:
        raise PrtnetError(
            f"{made.name}: found distances below 0 at all of {len(values)} points within the bounds, expected a "
            "surface: they are below 0 inside and above 0 outside"
        )
    nearest = int(values.argmin())
    beyond = f"; there is one at {_word(surface[0])}: move the bounds" if len(surface) else ""
    raise PrtnetError(
        f"{made.name}: found no surface within the bounds {made.low} to {made.high}, where the least distance is "
        f"{values[nearest]:.4g} at {_word(points[nearest])}, expected some below 0{beyond}"
    )


def _finite(made: Described, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Distances; raises PrtnetError where they are no numbers."""
    with np.errstate(all="ignore"):
        values, slopes = made.field.distance(points), made.field.gradient(points[::4])
    for word, wrong, at in (
        ("distance", ~np.isfinite(values), points),
        ("gradient", ~np.isfinite(slopes).all(axis=1), points[::4]),
    ):
        if wrong.any():
            where = at[np.flatnonzero(wrong)[0]]
            raise PrtnetError(
                f"{made.name}: the {word} is no finite number at {np.count_nonzero(wrong)} of {len(at)} points, "
                f"{_word(where)} for one; expected one everywhere: look for square roots of what falls below 0, and "
                "divisions"
            )
    return values


def _faces(low: Float[Array, " 3"], high: Float[Array, " 3"]) -> Float[Array, "n 3"]:
    """A grid of points on the six faces of a box."""
    u, v = (each.ravel() for each in np.meshgrid(*2 * (np.linspace(0, 1, SIDE),)))
    found = []
    for axis in range(3):
        for side in (0.0, 1.0):
            at = np.empty((len(u), 3))
            at[:, axis], at[:, axis - 2], at[:, axis - 1] = side, u, v
            found.append(low + (high - low) * at)
    return np.concatenate(found)


def _refuse_outside(made: Described, faces: Float[Array, "n 3"], border: Float[Array, " n"], size: float) -> None:
    if border.max() < 0:
        raise PrtnetError(
            f"{made.name}: found distances below 0 on all of the bounds {made.low} to {made.high}, expected them above "
            "0: turn the sign round, or cut a room out of a box that lies within"
        )
    if border.min() < -1e-9 * size:
        raise PrtnetError(f"{made.name}: {_outside(made, faces[border.argmin()])}")


def _outside(made: Described, where: Float[Array, " 3"]) -> str:
    return (
        f"the surface leaves the bounds {made.low} to {made.high}, at {_word(where)} for one; expected larger bounds, "
        "or a flat box or cylinder in place of an endless plane"
    )


def _on_surface(field: Field, points: Float[Array, "n 3"], values: Float[Array, " n"]) -> Float[Array, "m 3"]:
    """Points of the surface, from those that are nearest to it: Newton's steps along the gradient."""
    lipschitz = field.lipschitz
    at = points[np.argsort(np.abs(values))[:NEAR]]
    for _ in range(STEPS):
        distance, slope = field.distance(at), field.gradient(at)
        square = np.maximum((slope * slope).sum(axis=1), (0.1 * lipschitz) ** 2)
        at = at - (distance / square)[:, None] * slope
    size = np.ptp(points, axis=0).max()
    return at[np.abs(field.distance(at)) < 1e-5 * size * lipschitz]


def _secants(
    made: Described, points: Float[Array, "n 3"], values: Float[Array, " n"], size: float, rng: np.random.Generator
) -> _Slope:
    """The steepest of short lines between points: it sees jumps, which no gradient does."""
    away = rng.normal(size=points.shape)
    away *= (10 ** rng.uniform(-3, -1, len(points)) * size / np.linalg.norm(away, axis=1))[:, None]
    slopes = np.abs(made.field.distance(points + away) - values) / np.linalg.norm(away, axis=1)
    steepest = int(slopes.argmax())
    return _Slope(float(slopes[steepest]), points[steepest])


def _gradients(made: Described, points: Float[Array, "n 3"]) -> _Slope:
    slopes = np.linalg.norm(made.field.gradient(points), axis=1)
    steepest = int(slopes.argmax())
    return _Slope(float(slopes[steepest]), points[steepest])


def _refuse_steep(made: Described, found: _Slope) -> None:
    declared = made.field.lipschitz
    if found.value > SLACK * declared:
        raise PrtnetError(
            f"{made.name}: the distance has a slope of {found.value:.4g} at {_word(found.point)}, expected at most "
            f"{declared:g}, for rays would step through the surface; declare lipschitz = {1.01 * found.value:.3g}, "
            "or, where the slope has no end, as at a jump, mend the distance"
        )


def _warn_flat(made: Described, points: Float[Array, "n 3"]) -> None:
    slopes = np.linalg.norm(made.field.gradient(points), axis=1) / made.field.lipschitz
    usual = float(np.quantile(slopes, 0.95))
    if usual < FLAT:
        message = (
            "%s: near the surface the slope of the distance is %.3g of lipschitz at most: rays will walk it slowly"
        )
        log.warning(message, made.name, usual)


def _word(point: Float[Array, " 3"]) -> str:
    return "(" + ", ".join(f"{each:.4g}" for each in point) + ")"
