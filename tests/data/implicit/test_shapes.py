"""Shapes: the sign says what is inside, the slope is at most 1, and no surface is nearer than the distance says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from prtnet import PrtnetError
from prtnet.data.implicit import shapes
from prtnet.data.implicit.field import Analytic
from tests.data.implicit.bounds import distances, points, slopes_are_bounded

COUNT = 12_000  # points of a sampled surface
SIZES = st.floats(0.1, 1.0)


def directions(rng, count=COUNT):
    found = rng.normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def ring(radius, y, angle):
    """Points at a radius about y."""
    return np.stack([radius * np.cos(angle), y, radius * np.sin(angle)], axis=1)


def solid_of_revolution(profile, rng):
    """Points on the surface that a closed polygon of (radius, y) makes, for one the axis of which is the start."""
    lengths = np.linalg.norm(np.diff(profile, axis=0), axis=1)
    edge = rng.choice(len(lengths), COUNT, p=lengths / lengths.sum())
    share = rng.random((COUNT, 1))
    at = profile[edge] + share * (profile[edge + 1] - profile[edge])
    return ring(at[:, 0], at[:, 1], rng.uniform(0, 2 * np.pi, COUNT))


def is_bound(shape, surface, inside, *, exact):
    at = points()
    found = distances(shape, at)
    within = inside(at)
    assert ((found < 0) == within)[np.abs(found) > 1e-9].all()
    slopes_are_bounded(shape)
    np.testing.assert_allclose(distances(shape, surface), 0, atol=1e-9)
    nearest, _ = cKDTree(surface).query(at)
    assert (np.abs(found) <= nearest + 1e-9).all()
    if exact:
        # samples are some way from the nearest point of the surface
        assert np.quantile(nearest - np.abs(found), 0.98) < 0.06


@settings(max_examples=5, deadline=None)
@given(SIZES, SIZES, SIZES, st.integers(0, 99))
def test_ellipsoids_and_spheres(x, y, z, seed):
    ball = directions(np.random.default_rng(seed))
    radii = np.array([x, y, z])
    is_bound(shapes.ellipsoid(x, y, z), ball * radii, lambda p: ((p / radii) ** 2).sum(axis=1) < 1, exact=False)
    is_bound(shapes.sphere(x), ball * x, lambda p: (p * p).sum(axis=1) < x * x, exact=True)


@settings(max_examples=5, deadline=None)
@given(SIZES, SIZES, SIZES, st.floats(0, 1), st.integers(0, 99))
def test_boxes(x, y, z, share, seed):
    """A rounded box is all that is near enough to a smaller one."""
    half = np.array([x, y, z])
    radius = share * half.min()
    core, ball = half - radius, directions(np.random.default_rng(seed))
    corners = core * np.sign(ball)
    # of a direction, the places where the plane across it touches: a corner
    surface = np.clip(4 * ball, -core, core) if not radius else corners + radius * ball

    def inside(p):
        return np.linalg.norm(np.maximum(np.abs(p) - core, 0), axis=1) < max(radius, 1e-300)

    is_bound(shapes.box(x, y, z, round=radius), surface, inside, exact=False)


@settings(max_examples=5, deadline=None)
@given(SIZES, SIZES, SIZES, st.integers(0, 99))
def test_solids_of_revolution(one, two, height, seed):
    rng = np.random.default_rng(seed)

    def within(p, bottom, top):
        radius = bottom + (top - bottom) * (p[:, 1] + height) / (2 * height)
        return (np.abs(p[:, 1]) < height) & (np.hypot(p[:, 0], p[:, 2]) < radius)

    rod = np.array([[0, -height], [one, -height], [one, height], [0, height]])
    is_bound(shapes.cylinder(one, height), solid_of_revolution(rod, rng), lambda p: within(p, one, one), exact=True)
    for top in (two, 0.0):
        sides = np.array([[0, -height], [one, -height], [top, height], [0, height]])
        surface = solid_of_revolution(sides, rng)
        is_bound(shapes.cone(one, top, height), surface, lambda p, top=top: within(p, one, top), exact=False)


@settings(max_examples=5, deadline=None)
@given(SIZES, st.floats(0.05, 1), st.integers(0, 99))
def test_rings(radius, share, seed):
    rng, tube = np.random.default_rng(seed), share * radius
    angle = rng.uniform(0, 2 * np.pi, COUNT)
    surface = ring(radius + tube * np.cos(angle), tube * np.sin(angle), rng.uniform(0, 2 * np.pi, COUNT))

    def inside(p):
        return (np.hypot(p[:, 0], p[:, 2]) - radius) ** 2 + p[:, 1] ** 2 < tube * tube

    is_bound(shapes.torus(radius, tube), surface, inside, exact=True)


@settings(max_examples=5, deadline=None)
@given(*2 * (st.tuples(*3 * (st.floats(-0.8, 0.8),)),), SIZES, st.floats(-0.95, 0.95))
def test_capsules_are_balls_along_a_segment(start, end, radius, taper):
    start, end = np.array(start), np.array(end) + (0, 0.9, 0)
    last = max(radius + taper * np.linalg.norm(end - start), 0)
    shape = shapes.capsule(tuple(start.tolist()), tuple(end.tolist()), radius, float(last))
    share, at = np.linspace(0, 1, 2000)[:, None, None], points()[:400]
    away = np.linalg.norm(at - (start + share * (end - start)), axis=2) - (radius + share[..., 0] * (last - radius))
    slopes_are_bounded(shape)
    found = distances(shape, at)
    assert (found <= away.min(axis=0) + 1e-9).all()
    np.testing.assert_allclose(found, away.min(axis=0), atol=2e-3)
    # the end of one is the start of the next
    again = (
        distances(shapes.capsule(tuple(end.tolist()), tuple(start.tolist()), float(last), radius), at) if last else 0
    )
    np.testing.assert_allclose(again, found if last else 0, atol=1e-9)


def test_a_plane_is_told_by_any_normal():
    at = points()
    np.testing.assert_allclose(distances(shapes.plane((0, 2, 0), 0.5), at), at[:, 1] - 0.5)


def test_a_chain_is_its_links():
    corners, radii = [(0, 0, 0), (0.5, 0, 0), (0.5, 0.5, 0.2)], [0.2, 0.1, 0.15]
    links = [shapes.capsule(a, b, r, s) for a, b, r, s in zip(corners, corners[1:], radii, radii[1:], strict=False)]
    expected = np.minimum(*(distances(link, points()) for link in links))
    np.testing.assert_array_equal(distances(shapes.chain(corners, radii), points()), expected)


def test_the_ellipsoid_is_exact_at_its_ends():
    """The usual estimate, f (f - 1) / |p / r^2|, is exact there too but steeper than 1 elsewhere."""
    shape = shapes.ellipsoid(1.0, 0.5, 0.25)
    ends = np.array([[1.3, 0, 0], [0, 0, 0.4], [0, 0, 0.1]])
    np.testing.assert_allclose(distances(shape, ends), [0.3, 0.15, -0.15], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(Analytic((shape,)).gradient(ends), axis=1), 1)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: shapes.sphere(0), "sphere: radius: found 0"),
        (lambda: shapes.box(1, -1, 1), "box: y: found -1"),
        (lambda: shapes.box(1, 1, 0.2, round=0.3), "box: round: found 0.3, expected 0 to 0.2"),
        (lambda: shapes.cylinder(1, float("nan")), "cylinder: height: found nan"),
        (lambda: shapes.cone(0, 0, 1), "cone: radius"),
        (lambda: shapes.plane((0, 0, 0)), "plane: normal"),
        (lambda: shapes.capsule((0, 0, 0), (0, 0, 0), 1), "capsule: length"),
        (lambda: shapes.capsule((0, 0, 0), (0, 1, 0), 1.5, 0.2), "end_radius: found 0.2"),
        (lambda: shapes.chain([(0, 0, 0), (0, 1, 0)], [1.0]), "chain: found 2 points and 1 radii"),
    ],
)
def test_impossible_sizes_are_refused(make, word):
    with pytest.raises(PrtnetError, match=word):
        make()
