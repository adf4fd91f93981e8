"""What makes a distance a bound: with the right sign and no slope above 1, no surface is nearer than it says."""

import numpy as np

from prtnet.data.implicit.field import Analytic

RNG = np.random.default_rng(11)
POINTS = RNG.uniform(-1.5, 1.5, (1500, 3))
# to points beside them, near and far
AWAY = RNG.normal(size=(1500, 3)) * 10 ** RNG.uniform(-3, 0, (1500, 1))


def points():
    return POINTS.copy()


def distances(shape, at):
    return Analytic((shape,)).distance(at)


def slopes_are_bounded(shape):
    """Between any two points, which sees jumps, and of the gradient."""
    field = Analytic((shape,))
    rise = np.abs(field.distance(POINTS + AWAY) - field.distance(POINTS))
    assert (rise <= np.linalg.norm(AWAY, axis=1) * (1 + 1e-9) + 1e-12).all()
    assert np.linalg.norm(field.gradient(POINTS), axis=1).max() <= 1 + 1e-9
