"""Operators: sets as they should be, bounds that stay bounds, also across the borders of cells."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from prtnet import PrtnetError
from prtnet.data.implicit import operators as o
from prtnet.data.implicit.field import Analytic
from prtnet.data.implicit.shapes import box, capsule, cone, cylinder, ellipsoid, sphere, torus
from prtnet.data.scene import Frame
from tests.data.implicit.bounds import distances, points, slopes_are_bounded

BLOB = o.moved(o.turned(ellipsoid(0.3, 0.15, 0.2), (1, 1, 0), 30), 0.02, 0.05, -0.03)
ONE, TWO = sphere(0.7), o.moved(box(0.5, 0.4, 0.6, round=0.1), 0.4, 0.2, 0)
SHARES = st.floats(0.05, 1)

OFFSETS, AXES = st.floats(-1, 1), st.sampled_from("xyz")


def later(make, *strategies):
    """A strategy of functions that make a shape: type checks draw random numbers, which strategies may not."""

    def delayed(*values):
        return lambda: make(*(value() if callable(value) else value for value in values))

    return st.builds(delayed, *strategies)


PRIMITIVES = st.one_of(
    later(sphere, SHARES),
    later(ellipsoid, SHARES, SHARES, SHARES),
    later(box, SHARES, SHARES, SHARES),
    later(cylinder, SHARES, SHARES),
    later(cone, SHARES, SHARES, SHARES),
    later(lambda a, b: torus(a, a * b), SHARES, SHARES),
    later(lambda a, b: capsule((0, 0, 0), (a, 1, 0), 1, 1 - 0.9 * b), SHARES, SHARES),
)


def operations(inner):
    smooth = st.floats(0, 1)
    return st.one_of(
        later(o.moved, inner, OFFSETS, OFFSETS, OFFSETS),
        later(o.turned, inner, st.tuples(SHARES, OFFSETS, OFFSETS), st.floats(-180, 180)),
        later(o.scaled, inner, st.floats(0.2, 3)),
        later(o.stretched, inner, *3 * (st.floats(0.5, 2),)),
        later(o.elongated, inner, SHARES, SHARES),
        later(o.shell, inner, SHARES),
        later(o.rounded, inner, SHARES),
        later(o.mirrored, inner, AXES),
        later(o.around, inner, AXES, st.integers(1, 9)),
        later(lambda a, b, k: o.union(a, b, smooth=k), inner, inner, smooth),
        later(lambda a, b, k: o.intersection(a, b, smooth=k), inner, inner, smooth),
        later(lambda a, b, k: o.difference(a, b, smooth=k), inner, inner, smooth),
    )


@settings(max_examples=40, deadline=None)
@given(st.recursive(PRIMITIVES, operations, max_leaves=4))
def test_no_composition_is_steeper_than_one(make):
    slopes_are_bounded(make())


def test_booleans_are_those_of_sets():
    one, two = (distances(shape, points()) < 0 for shape in (ONE, TWO))
    np.testing.assert_array_equal(distances(o.union(ONE, TWO), points()) < 0, one | two)
    np.testing.assert_array_equal(distances(o.intersection(ONE, TWO), points()) < 0, one & two)
    np.testing.assert_array_equal(distances(o.difference(ONE, TWO), points()) < 0, one & ~two)


@pytest.mark.parametrize("smooth", [0.05, 0.4])
def test_smooth_booleans_stay_near_the_hard_ones(smooth):
    """Where the distances differ by more than `smooth` they are the same; nowhere are they off by more than a quarter.

    A union gains, an intersection and a difference lose.
    """
    apart = np.abs(distances(ONE, points()) - distances(TWO, points())) > smooth
    for join, sign in ((o.union, -1), (o.intersection, 1)):
        change = sign * (distances(join(ONE, TWO, smooth=smooth), points()) - distances(join(ONE, TWO), points()))
        np.testing.assert_allclose(change[apart], 0, atol=1e-12)
        assert change.min() >= -1e-12
        assert smooth / 8 < change.max() <= smooth / 4 + 1e-12
    cut = distances(o.difference(ONE, TWO, smooth=smooth), points()) - distances(o.difference(ONE, TWO), points())
    assert -1e-12 <= cut.min() < smooth / 8 < cut.max() <= smooth / 4 + 1e-12


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_finite_repetition_is_the_union_of_the_copies(axis, count):
    """Also of a shape that reaches to one side of its cell: the copy in the next cell may be the nearest one."""
    for shape in (BLOB, o.moved(sphere(0.05), *(0.3 * np.eye(3)["xyz".index(axis)]).tolist())):
        step = 0.75 * np.eye(3)["xyz".index(axis)]
        copies = [o.moved(shape, *(k * step).tolist()) for k in range(count)]
        found = distances(o.repeated(shape, axis, 0.75, count), points())
        np.testing.assert_allclose(found, distances(o.union(*copies), points()), atol=1e-12)


def test_endless_repetition_is_that_of_many_copies():
    copies = o.union(*(o.moved(BLOB, 0.75 * k, 0, 0) for k in range(-6, 7)))
    endless = o.repeated(BLOB, "x", 0.75)
    np.testing.assert_allclose(distances(endless, points()), distances(copies, points()), atol=1e-12)
    slopes_are_bounded(endless)
    slopes_are_bounded(o.repeated(endless, "z", 0.8))


@pytest.mark.parametrize(("axis", "at"), [("x", (0, 0.6, 0)), ("y", (0.6, 0, 0)), ("z", (0.6, 0, 0))])
@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 12])
def test_copies_about_an_axis_are_turned_ones(axis, at, count):
    petal = o.moved(ellipsoid(0.12, 0.1, 0.11), *at)
    turned = o.union(*(o.turned(petal, axis, 360 * k / count) for k in range(count)))
    np.testing.assert_allclose(
        distances(o.around(petal, axis, count), points()), distances(turned, points()), atol=1e-12
    )


def test_mirrored_shapes_stand_on_both_sides():
    right = o.moved(BLOB, 0, 0.6, 0)
    found = distances(o.mirrored(right, "y"), points())
    np.testing.assert_allclose(found, np.minimum(distances(right, points()), distances(right, points() * (1, -1, 1))))


@settings(max_examples=10, deadline=None)
@given(st.tuples(OFFSETS, OFFSETS, st.floats(0.1, 1)), st.floats(-360, 360))
def test_turns_are_those_of_scipy(axis, degrees):
    rotation = Rotation.from_rotvec(np.radians(degrees) * np.array(axis) / np.linalg.norm(axis))
    found = distances(o.turned(BLOB, axis, degrees), rotation.apply(points()))
    np.testing.assert_allclose(found, distances(BLOB, points()), atol=1e-9)


def test_elongated_shapes():
    rod = o.elongated(sphere(0.2), y=0.5)
    np.testing.assert_allclose(
        distances(rod, points()), distances(capsule((0, -0.5, 0), (0, 0.5, 0), 0.2), points()), atol=1e-12
    )
    slab, longer = o.elongated(box(0.2, 0.3, 0.1), 0.4, 0, 0.2), box(0.6, 0.3, 0.3)
    outside = distances(longer, points()) > 0
    np.testing.assert_allclose(distances(slab, points())[outside], distances(longer, points())[outside])


def test_grown_hollow_and_stretched_shapes():
    plain = distances(ONE, points())
    np.testing.assert_allclose(distances(o.rounded(ONE, 0.2), points()), plain - 0.2)
    np.testing.assert_allclose(distances(o.shell(ONE, 0.1), points()), np.abs(plain) - 0.1)
    stretched = o.stretched(sphere(1), 0.5, 1, 0.25)
    inside = ((points() / (0.5, 1, 0.25)) ** 2).sum(axis=1) < 1
    np.testing.assert_array_equal(distances(stretched, points()) < 0, inside)
    slopes_are_bounded(stretched)


def test_a_surface_beside_its_parts_moves_with_them():
    frame = Frame(np.array([1.0, 0.5, -0.2]), 0.25)
    field = Analytic((ONE, TWO), joined=o.union(ONE, TWO, smooth=0.3))
    unit = field.in_frame(frame)
    np.testing.assert_allclose(unit.distance(points()), 0.25 * field.distance(frame.from_unit(points())), atol=1e-12)
    np.testing.assert_array_equal(unit.part(points()), field.part(frame.from_unit(points())))
    assert unit.digest() != Analytic((ONE, TWO)).in_frame(frame).digest()


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: o.scaled(ONE, 0), "scaled: factor: found 0"),
        (lambda: o.stretched(ONE, 1, -1, 1), "stretched: y"),
        (lambda: o.elongated(ONE, 0, -1), "elongated"),
        (lambda: o.shell(ONE, -0.1), "shell: thickness"),
        (lambda: o.mirrored(ONE, "w"), "axis: found 'w', expected x, y or z"),
        (lambda: o.repeated(ONE, "x", 0), "repeated: spacing"),
        (lambda: o.repeated(ONE, "x", 1, 0), "repeated: count"),
        (lambda: o.around(ONE, "y", 0), "around: count"),
        (lambda: o.turned(ONE, (0, 0, 0), 5), "turned: axis"),
    ],
)
def test_impossible_arguments_are_refused(make, word):
    with pytest.raises(PrtnetError, match=word):
        make()
