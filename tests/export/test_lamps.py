"""Matrices of shadow maps against geometry, the uniforms, and the text in both languages."""

import shutil

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data.lighting.lamp import Lamp, Lighting
from prtnet.export import glsl, lamps

WHITE = (1.0, 1.0, 1.0)
BOX = np.array([[-1.0, -0.4, -0.7], [1.0, 0.6, 0.5]])
# one of them straight down, where the usual up is none
AIMS = np.array([[0.3, -0.8, 0.5], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-0.9, 0.1, 0.2], [0.0, 1.0, 1e-5]])
AIMS /= np.linalg.norm(AIMS, axis=1, keepdims=True)


def spot(outer=30.0, aim=AIMS[0], position=(0.1, 0.2, -0.1)) -> Lamp:
    return Lamp("spot", WHITE, position, tuple(aim), outer / 2, outer)


def placed(matrix: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(x, y, z over w; w)"""
    clip = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
    return clip[:, :3] / clip[:, 3:], clip[:, 3]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(2)


@pytest.mark.parametrize("aim", AIMS)
def test_parallel_light_sees_the_whole_box_and_orders_it_by_depth(aim, rng):
    (matrix,) = lamps.shadow_matrices(Lamp("directional", WHITE, aim=tuple(aim)), BOX)
    points = rng.uniform(*BOX, (200, 3))
    corners = np.array(np.meshgrid(*BOX.T)).reshape(3, -1).T
    found, along = placed(matrix, points)[0], points @ aim
    assert np.abs(placed(matrix, corners)[0]).max() < 1
    # the box fills the map in one direction and its depth
    assert np.abs(placed(matrix, corners)[0]).max(axis=0)[[0, 1]].max() > 1 / (1.001 * lamps.MARGIN)
    np.testing.assert_array_equal(np.argsort(found[:, 2]), np.argsort(along))
    np.testing.assert_allclose(placed(matrix, points + 0.3 * aim)[0][:, :2], found[:, :2], atol=1e-12)
    # texels are square
    assert np.linalg.norm(matrix[0, :3]) == pytest.approx(np.linalg.norm(matrix[1, :3]))
    assert np.linalg.det(matrix[:3, :3]) < 0, "clip coordinates are left-handed: a picture, not its mirror image"


@pytest.mark.parametrize("lamp", [Lamp("point", WHITE, (0.1, 0.2, -0.1)), spot(75.0)], ids=["point", "wide spot"])
def test_the_face_of_the_longest_axis_sees_each_direction(lamp, rng):
    matrices = lamps.shadow_matrices(lamp, BOX)
    assert matrices.shape == (6, 4, 4)
    away = rng.normal(size=(500, 3))
    axis = np.abs(away).argmax(axis=1)
    face = 2 * axis + (away[np.arange(500), axis] < 0)
    for number in range(6):
        chosen = away[face == number]
        for length in (0.2, 0.9):
            points = np.array(lamp.position) + length * chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
            found, depth = placed(matrices[number], points)
            assert (depth > 0).all()
            assert np.abs(found[:, :2]).max() <= 1 / lamps.MARGIN + 1e-9
            if length == 0.2:
                near = found
        np.testing.assert_allclose(found[:, :2], near[:, :2], atol=1e-9)
        assert (found[:, 2] > near[:, 2]).all()


@pytest.mark.parametrize("aim", AIMS)
def test_the_cone_of_a_spot_is_round_and_fills_its_map(aim, rng):
    lamp = spot(40.0, aim)
    (matrix,) = lamps.shadow_matrices(lamp, BOX)
    across = np.cross(aim, rng.normal(size=(100, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    edge = np.array(lamp.position) + 0.5 * (aim + np.tan(np.radians(40)) * across)
    radius = np.linalg.norm(placed(matrix, edge)[0][:, :2], axis=1)
    np.testing.assert_allclose(radius, 1 / lamps.MARGIN, atol=1e-9)


@pytest.mark.parametrize("position", [(0.1, 0.2, -0.1), (3.0, 2.0, 0.0), (0.0, 9.0, 0.0)])
@pytest.mark.parametrize("kind", ["point", "spot"])
def test_everything_lit_lies_between_the_planes(kind, position, rng):
    aim = -np.array(position) / np.linalg.norm(position)
    lamp = Lamp(kind, WHITE, position, tuple(aim), 40, 59)
    points = rng.uniform(*BOX, (4000, 3))
    away = points - position
    points = points[np.linalg.norm(away, axis=1) > 0.02]
    seen = 0
    for matrix in lamps.shadow_matrices(lamp, BOX):
        found, depth = placed(matrix, points)
        inside = (depth > 0) & (np.linalg.norm(found[:, :2], axis=1) < 1 if kind == "spot" else True)
        inside &= np.abs(found[:, :2]).max(axis=1) <= 1 / lamps.MARGIN
        assert np.abs(found[inside, 2]).max(initial=0) < 1
        seen += inside.sum()
    assert seen >= len(points) * (0.99 if kind == "point" else 0.2)


def test_uniforms_are_column_by_column_and_padded():
    lighting = Lighting((spot(40.0), Lamp("directional", (1.0, 2.0, 3.0), aim=(0.0, -1.0, 0.0))))
    matrices = [lamps.shadow_matrices(lamp, BOX) for lamp in lighting.lamps]
    found = lamps.uniforms(lighting, matrices, 3)
    assert found["lamp_count"] == 2
    assert found["shadow_matrix"].shape == (18, 4, 4)
    np.testing.assert_array_equal(found["shadow_matrix"][6], matrices[1][0].T.astype(np.float32))
    np.testing.assert_array_equal(found["lamp_position"][:2, 3], [2, 0])
    np.testing.assert_allclose(found["lamp_aim"][0, 3], np.cos(np.radians(40)), rtol=1e-6)
    np.testing.assert_allclose(found["lamp_colour"][0, 3], np.cos(np.radians(20)), rtol=1e-6)
    np.testing.assert_array_equal(found["lamp_colour"][1, :3], [1, 2, 3])
    assert not found["shadow_matrix"][12:].any()


def test_more_lamps_than_room_are_refused():
    lighting = Lighting((spot(),) * 3)
    with pytest.raises(PrtnetError, match="3 lamps, expected at most 2"):
        lamps.uniforms(lighting, [lamps.shadow_matrices(spot(), BOX)] * 3, 2)


@pytest.mark.skipif(shutil.which("glslangValidator") is None, reason="glslangValidator is absent: glslang-tools has it")
@pytest.mark.parametrize("head", ["#version 330 core\n", "#version 300 es\nprecision highp float;\n"])
@pytest.mark.parametrize("room", [1, 4])
def test_the_text_is_valid_on_the_desktop_and_in_browsers(head, room):
    for text in (lamps.measured(room), lamps.AVERAGED):
        assert glsl.validate(head + text) == ""
