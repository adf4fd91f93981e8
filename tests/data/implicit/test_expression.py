"""Expressions: one description, the same numbers everywhere."""

import numpy as np
import pytest

from prtnet.data.implicit import expression as e
from prtnet.data.implicit.derivative import with_gradient
from prtnet.data.implicit.expression import POINT, Program, X, Y, Z
from prtnet.data.implicit.field import Analytic
from prtnet.data.implicit.operators import difference, moved, scaled, turned, union
from prtnet.data.implicit.shapes import box, capsule, plane, sphere, torus
from prtnet.data.scene import Frame

BODY = union(
    moved(sphere(0.4), 0.1, 0.2, 0.0),
    turned(box(0.5, 0.2, 0.3, round=0.05), "z", 30),
    capsule((0, 0, 0), (0.3, 0.8, -0.2), 0.1),
    smooth=0.2,
)
SHAPE = difference(union(BODY, torus(0.6, 0.1)), plane(offset=-0.4), smooth=0.1)


@pytest.fixture
def points(rng):
    return rng.uniform(-1, 1, (500, 3))


@pytest.fixture
def rng():
    return np.random.default_rng(4)


def test_numbers_are_those_of_numpy(points):
    x, y, z = points.T
    node = e.select(X, Y, e.sqrt(X * X + 2) / 3, e.floor(5 * Z) - abs(Y)) + e.sin(X) * e.cos(Y) - 1
    expected = np.where(x < y, np.sqrt(x * x + 2) / 3, np.floor(5 * z) - np.abs(y)) + np.sin(x) * np.cos(y) - 1
    np.testing.assert_allclose(Program([node]).evaluate(x, y, z)[0], expected, atol=1e-14)


def test_powers_are_products(points):
    for exponent in range(1, 8):
        np.testing.assert_allclose(Program([X**exponent]).evaluate(*points.T)[0], points[:, 0] ** exponent)
    with pytest.raises(TypeError):
        X**0.5  # type: ignore[operator]


def test_what_is_known_is_folded():
    assert Program([(X * 0 + 3) * e.constant(2)]).steps == [("constant", (), 6.0)]
    assert Program([X + Y * 1 + 0]).steps == Program([X + Y]).steps


def test_equal_work_is_done_once():
    once, twice = e.length(X, Y), e.length(X, Y)
    assert len(Program([once + twice])) == len(Program([once])) + 1


def test_gradients_are_those_of_differences(points):
    program, step = with_gradient(SHAPE(POINT)), 1e-6
    value, *slopes = program.evaluate(*points.T)
    np.testing.assert_array_equal(value, Program([SHAPE(POINT)]).evaluate(*points.T)[0])
    moved_by = np.eye(3) * step
    field = Analytic((SHAPE,))
    numeric = [(field.distance(points + d) - field.distance(points - d)) / (2 * step) for d in moved_by]
    wrong = np.abs(np.stack(slopes) - numeric).max(axis=0) > 1e-4
    # where two surfaces are equally near there is no gradient
    assert wrong.mean() < 0.01


def test_distances_of_shapes():
    corners = np.array([[2.0, 0, 0], [2, 2, 0], [2, 2, 2], [0, 0, 0]])
    np.testing.assert_allclose(Analytic((box(1, 1, 1),)).distance(corners), [1, np.sqrt(2), np.sqrt(3), -1])
    np.testing.assert_allclose(Analytic((box(1, 1, 1, round=0.2),)).distance(corners[:1]), [1])
    np.testing.assert_allclose(Analytic((torus(1, 0.25),)).distance(np.array([[0.0, 0, 0], [1, 0.5, 0]])), [0.75, 0.25])


def test_a_frame_scales_distances(points):
    field = Analytic((sphere(3.0), moved(box(1, 1, 1), 4, 0, 0)), smooth=0.5)
    frame = Frame(np.array([1.0, 0.5, -0.2]), 0.25)
    unit = field.in_frame(frame)
    np.testing.assert_allclose(unit.distance(points), 0.25 * field.distance(frame.from_unit(points)), atol=1e-12)
    np.testing.assert_array_equal(unit.part(points), field.part(frame.from_unit(points)))


def test_transforms_are_those_of_points(points):
    shape = capsule((0, 0, 0), (0.3, 0.8, -0.2), 0.1)
    turned_back = points @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]).T
    found = Analytic((turned(shape, "z", -90),)).distance(turned_back @ np.diag([1, 1, 1]))
    plain = Analytic((shape,)).distance(points)
    back = Analytic((turned(turned(shape, "z", -90), "z", 90),)).distance(points)
    np.testing.assert_allclose(back, plain, atol=1e-12)
    assert not np.allclose(found, Analytic((shape,)).distance(turned_back), atol=1e-3)
    np.testing.assert_allclose(Analytic((scaled(shape, 2),)).distance(2 * points), 2 * plain, atol=1e-12)
