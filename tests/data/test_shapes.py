"""Primitive surfaces against their closed forms."""

import numpy as np
import pytest

from prtnet.data import shapes
from prtnet.data.repair import is_closed


def volume(surface: shapes.Surface) -> float:
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)


CLOSED = {
    "box": (shapes.box([0, 0, 0], [1, 2, 3]), 6.0, 1e-12),
    "ellipsoid": (shapes.ellipsoid([1, 2, 0.5], 96), 4 / 3 * np.pi, 0.01),
    "tube": (shapes.tube(np.array([[0, 0, 0], [0, 1.0, 0], [0, 3, 0]]), 0.5, 96), 0.75 * np.pi, 0.01),
    "cylinder": (shapes.revolve([(0, 0), (1, 0), (1, 2), (0, 2)], 96), 2 * np.pi, 0.01),
    "rounded_box": (shapes.rounded_box([0, 0, 0], [2, 2, 2], 1e-6, 1), 8.0, 1e-4),
    "ball": (shapes.rounded_box([-1, -1, -1], [1, 1, 1], 1.0, 16), 4 / 3 * np.pi, 0.01),
    "panel": (shapes.panel([0, 1, 2, 3], [0, 1, 2, 3], [[1, 1, 1], [1, 0, 1], [1, 1, 1]], 0.5), 4.0, 1e-12),
}


@pytest.mark.parametrize("name", CLOSED)
def test_closed_outward_and_of_the_right_volume(name: str) -> None:
    surface, expected, tolerance = CLOSED[name]
    assert is_closed(surface.vertices, surface.faces)
    assert volume(surface) == pytest.approx(expected, rel=tolerance)


def test_sheet_faces_row_cross_column() -> None:
    points = np.array([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]]], float)
    a, b, c = shapes.sheet(points).vertices[shapes.sheet(points).faces[0]]
    assert np.cross(b - a, c - a)[2] > 0


def test_ground_faces_up() -> None:
    plane = shapes.ground(2, 3)
    a, b, c = plane.vertices[plane.faces[1]]
    assert np.cross(b - a, c - a)[1] > 0
    assert np.ptp(plane.vertices, axis=0).tolist() == [4, 0, 6]


def test_smooth_passes_through_its_points() -> None:
    control = np.array([[0, 0], [1, 2], [3, 1], [4, 4.0]])
    np.testing.assert_allclose(shapes.smooth(control, 3 * 10 + 1)[::10], control, atol=1e-12)


def test_rotations_keep_lengths() -> None:
    for matrix in (shapes.turn_y(0.7), shapes.tilt_x(-0.4)):
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(matrix) == pytest.approx(1)
    np.testing.assert_allclose(shapes.turn_y(np.pi / 2) @ [0, 0, 1], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(shapes.tilt_x(np.pi / 2) @ [0, 1, 0], [0, 0, 1], atol=1e-12)
