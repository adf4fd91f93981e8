"""Projection, rays, paths."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data import atlas, builtin, samples
from prtnet.data.tracer import Tracer
from prtnet.render import camera
from prtnet.render.camera import Camera
from prtnet.render.raster import Raster
from tests.assets import asset
from tests.render.meshes import quad, scene, sphere

EYE = Camera((0.3, 0.9, 2.5), (0.1, 0.0, -0.2), fov_y=50.0, near=0.1, far=9.0)


def test_target_is_in_the_middle_and_up_is_up():
    clip = EYE.matrix() @ [*EYE.target, 1]
    np.testing.assert_allclose(clip[:2], 0, atol=1e-12)
    above = EYE.matrix() @ [EYE.target[0], EYE.target[1] + 0.1, EYE.target[2], 1]
    assert above[1] / above[3] > 0
    right = EYE.matrix() @ [EYE.target[0] + 0.1, *EYE.target[1:], 1]
    assert right[0] / right[3] > 0


def test_near_and_far_map_to_the_ends_of_depth():
    backward = EYE.basis()[2]
    for distance, depth in ((EYE.near, -1), (EYE.far, 1)):
        clip = EYE.matrix() @ [*(np.array(EYE.eye) - distance * backward), 1]
        assert clip[2] / clip[3] == pytest.approx(depth)


def test_rays_are_the_inverse_of_the_projection():
    rays = EYE.rays(8)
    points = np.array(EYE.eye) + 1.7 * rays.reshape(-1, 3)
    clip = np.concatenate([points, np.ones((64, 1))], axis=1) @ EYE.matrix().T
    x = (clip[:, 0] / clip[:, 3] + 1) / 2 * 8
    row = (1 - clip[:, 1] / clip[:, 3]) / 2 * 8
    r, c = np.divmod(np.arange(64), 8)
    np.testing.assert_allclose(x, c + 0.5, atol=1e-9)
    np.testing.assert_allclose(row, r + 0.5, atol=1e-9)


def test_winding_tells_inside_from_outside():
    ball = scene(sphere(12))
    np.testing.assert_allclose(camera.winding(ball, np.array([[0.1, 0.2, 0], [0, 3, 0.0]])), [1, 0], atol=1e-6)


@pytest.mark.parametrize("name", builtin.NAMES)
def test_half_of_the_frame_shows_the_scene(name):
    made = builtin.make(name, tessellation=0.5).centred()
    tracer = Tracer(made)
    cameras = camera.path(made, tracer, 8)
    assert len(cameras) == 8
    assert np.mean([camera.coverage(made, tracer, eye) for eye in cameras]) >= 0.5


def test_orbit_goes_round_once():
    made = builtin.make("tea_set", tessellation=0.3).centred()
    eyes = np.array([eye.eye for eye in camera.path(made, Tracer(made), 12)])
    turn = np.unwrap(np.arctan2(eyes[:, 0], eyes[:, 2]))
    assert np.diff(turn) == pytest.approx(np.pi / 6, abs=0.15)
    assert (eyes[:, 1] > 0).all()


@pytest.mark.parametrize("name", ["plants", "tea_set", "dining_table", "cornell", "hair"])
def test_near_plane_of_an_orbit_cuts_nothing_off(name):
    made = builtin.make(name, tessellation=0.3).centred()
    for eye in camera.path(made, Tracer(made), 4):
        clip = np.concatenate([made.vertices, np.ones((len(made.vertices), 1))], axis=1) @ eye.matrix().T
        ahead = clip[clip[:, 3] > 0]
        assert (ahead[:, 2] > -ahead[:, 3]).all()
        assert eye.near > 0.1


def test_faces_that_all_but_touch_are_told_apart():
    """A sheet a hundred-thousandth of the scene above a floor hides it, on screen as for rays."""
    floor, sheet = quad([-1, 0, 1], [2, 0, 0], [0, 0, -2]), quad([-0.7, 2e-5, 0.6], [1.4, 0, 0], [0.1, 0, -1.2])
    made = scene(floor, replace(sheet, name="sheet"))
    tracer, drawing = Tracer(made), Raster(atlas.make(made, size=64), 96)
    for eye in camera.path(made, tracer, 3):
        seen = drawing.gbuffer(eye)
        rays = eye.rays(96).reshape(-1, 3)[seen.pixel]
        face, _, _ = tracer.hits(np.broadcast_to(eye.eye, rays.shape), rays)
        assert np.mean(made.part[face] != seen.part) < 0.002


def test_inside_eyes_are_free():
    made = builtin.make("room", tessellation=0.5).centred()
    eyes = np.array([eye.eye for eye in camera.path(made, Tracer(made), 12)])
    surface = samples.area_uniform(made, 40_000, np.random.default_rng(1)).positions
    near = np.array([np.linalg.norm(surface - eye, axis=1).min() for eye in eyes])
    assert near.min() > 0.03
    assert (np.abs(camera.winding(made, eyes)) < 1.5).all()


def test_auto_sees_rooms_from_inside_and_solids_from_outside():
    ball, shell = scene(sphere(16)), scene(sphere(16))
    shell = type(shell)(**{**shell.__dict__, "faces": shell.faces[:, ::-1].copy(), "normals": -shell.normals})
    for made, inside in ((ball, False), (shell, True)):
        auto = type(made)(**{**made.__dict__, "camera": "auto"})
        eyes = np.array([eye.eye for eye in camera.path(auto, Tracer(auto), 4)])
        assert (np.linalg.norm(eyes, axis=1) < 1).all() == inside


def test_a_far_and_large_scene_has_the_same_path():
    made = builtin.make("cornell")
    moved = type(made)(**{**made.__dict__, "vertices": made.vertices * 1000 + 1e6})
    moved = type(made)(**{**moved.__dict__, "frame": camera_frame(moved)})
    for a, b in zip(camera.path(made, Tracer(made), 3), camera.path(moved, Tracer(moved), 3), strict=True):
        np.testing.assert_allclose(a.eye, b.eye, atol=1e-3)


def camera_frame(made):
    from prtnet.data.scene import frame_of

    return frame_of(made.vertices)


def test_errors():
    flat = scene(quad([-1, 0, 1], [2, 0, 0], [0, 0, -2]))
    tracer = Tracer(flat)
    with pytest.raises(PrtnetError, match="auto, orbit or inside"):
        camera.path(flat, tracer, 4, kind="fly")
    with pytest.raises(PrtnetError, match=r"render\.views"):
        camera.path(flat, tracer, 0)
    with pytest.raises(PrtnetError, match="closed in"):
        camera.path(flat, tracer, 4, kind="inside")


def test_hall_is_seen_from_inside():
    from prtnet.data.scene import load

    hall = load(asset("meshes/modern-hall")).centred()
    cameras = camera.path(hall, Tracer(hall), 4)
    assert np.abs([eye.eye for eye in cameras]).max() < 1
    assert np.mean([camera.coverage(hall, Tracer(hall), eye) for eye in cameras]) > 0.8
