"""Computed normals: smooth where the surface is, split at creases."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from prtnet.data import shapes
from prtnet.data.normals import corner_angles, crease_normals, unit, weld


def test_box_gets_flat_faces() -> None:
    box = shapes.box([0, 0, 0], [1, 1, 1])
    source, faces, normals = crease_normals(box.vertices, box.faces)
    assert len(source) == 24
    for triangle in faces:
        np.testing.assert_allclose(normals[triangle], normals[triangle][:1].repeat(3, axis=0), atol=1e-6)
    np.testing.assert_array_equal(box.vertices[source][faces], box.vertices[box.faces])


def test_sphere_stays_smooth() -> None:
    ball = shapes.ellipsoid([1, 1, 1], 48)
    source, _, normals = crease_normals(ball.vertices, ball.faces)
    assert len(source) == len(ball.vertices)
    assert (np.einsum("vi,vi->v", normals, ball.vertices[source]) > 0.998).all()


def test_unshared_triangles_smooth_too() -> None:
    ball = shapes.ellipsoid([1, 1, 1], 32)
    soup = ball.vertices[ball.faces].reshape(-1, 3)
    source, faces, normals = crease_normals(soup, np.arange(len(soup)).reshape(-1, 3))
    np.testing.assert_array_equal(soup[source][faces].reshape(-1, 3), soup)
    assert (np.einsum("vi,vi->v", normals, soup[source]) > 0.995).all()


@pytest.mark.parametrize(("bend", "count"), [(30, 4), (50, 6)])
def test_crease_angle(bend: float, count: int) -> None:
    turn = np.radians(bend)
    points = np.array([[0, 0, 0], [0, 0, -1], [-1, 0, 0], [np.cos(turn), np.sin(turn), 0]])
    source, _, _ = crease_normals(points, np.array([[0, 1, 2], [0, 3, 1]]))
    assert len(source) == count


def test_normals_weigh_by_angle_not_by_area() -> None:
    """A cube's corner has the diagonal as its normal, however its faces are cut."""
    box = shapes.box([0, 0, 0], [1, 2, 3])
    source, _, normals = crease_normals(box.vertices, box.faces, crease_degrees=100)
    at_corner = normals[np.flatnonzero(source == np.argmin(box.vertices.sum(axis=1)))]
    np.testing.assert_allclose(at_corner, [[-(3**-0.5)] * 3], atol=1e-6)


@pytest.mark.parametrize("scale", [1e-150, 1e-3, 1e150])
def test_unit_at_any_scale(scale: float) -> None:
    vectors = np.array([[3.0, 4, 0], [0, 0, 0]])
    np.testing.assert_allclose(unit(vectors * scale), [[0.6, 0.8, 0], [0, 0, 0]])


@given(arrays(np.float64, (12, 3), elements=st.sampled_from([0.0, -0.0, 1.0, 2.5])))
def test_weld_is_exact(points: np.ndarray) -> None:
    keep, inverse = weld(points)
    np.testing.assert_array_equal(points[keep][inverse], points)
    assert len(np.unique(points + 0.0, axis=0)) == len(keep)


def test_angles_sum_to_pi() -> None:
    points = np.random.default_rng(0).normal(size=(30, 3))
    np.testing.assert_allclose(corner_angles(points, np.arange(30).reshape(-1, 3)).sum(axis=1), np.pi)
