"""What keys and the mouse do."""

from math import radians, tan

import numpy as np
import pytest

from prtnet.data.light import about_y
from prtnet.render.camera import Camera
from prtnet.view.state import FARTHEST, KEYS, NEAREST, SHARPEST, STEEPEST, Orbit, State

EYE = Camera((0.8, 1.1, -2.3), (0.1, -0.2, 0.3), fov_y=40.0)


def state(**more) -> State:
    return State(Orbit.of(EYE), ["texture", "vertex", "net"], ["studio", "sky", "sun"], **more)


def screen(camera: Camera, point) -> np.ndarray:
    """x to the right and y up, as shares of the frame's height from its middle."""
    clip = camera.matrix() @ np.append(point, 1.0)
    return clip[:2] / clip[3] / 2


def test_an_orbit_stands_where_the_camera_stood():
    found = Orbit.of(EYE).camera()
    np.testing.assert_allclose(found.eye, EYE.eye, atol=1e-12)
    assert (found.target, found.fov_y) == (EYE.target, EYE.fov_y)


def test_the_scene_follows_the_mouse_as_it_turns():
    """What is before the middle moves with the mouse: to the right, and down."""
    before = Orbit.of(EYE)
    nearer = np.add(EYE.target, 0.2 * np.subtract(EYE.eye, EYE.target))
    moved = state()
    moved.drag("left", 20, 10, 500)
    right, up = screen(moved.orbit.camera(), nearer)
    assert right > 0
    assert up < 0
    assert moved.orbit.distance == before.distance
    assert moved.orbit.target == before.target


def test_what_is_looked_at_stays_under_the_mouse_as_it_moves():
    moved = state()
    moved.drag("middle", 50, -30, 500)
    np.testing.assert_allclose(screen(moved.orbit.camera(), EYE.target), [0.1, 0.06], atol=1e-9)


def test_the_wheel_brings_nearer_within_bounds():
    near, far = state(), state()
    near.scroll(1)
    assert near.orbit.distance < Orbit.of(EYE).distance
    near.scroll(1000)
    far.scroll(-1000)
    assert (near.orbit.distance, far.orbit.distance) == (NEAREST, FARTHEST)
    assert near.orbit.camera().near > 0


def test_no_drag_turns_the_view_over():
    turned = state()
    turned.drag("left", 0, 1e6, 500)
    assert turned.orbit.elevation == STEEPEST
    turned.drag("left", 1e6, -2e6, 500)
    assert turned.orbit.elevation == -STEEPEST
    assert np.isfinite(turned.orbit.camera().matrix()).all()


def test_numbers_choose_methods():
    chosen = state()
    for name, method in (("3", "net"), ("2", "vertex"), ("1", "texture"), ("4", "texture"), ("0", "texture")):
        chosen.key(name)
        assert chosen.method == method


def test_l_goes_round_the_lights():
    lit = state()
    names = []
    for _ in range(4):
        names.append(lit.lights[lit.light])
        lit.key("L")
    assert names == ["studio", "sky", "sun", "studio"]


def test_letters_are_switches():
    switched = state()
    for letter, switch in (("G", "glossy"), ("S", "split"), ("E", "error"), ("H", "help")):
        switched.key(letter)
        assert getattr(switched, switch)
        switched.key(letter)
        assert not getattr(switched, switch)


def test_brackets_change_the_exponent_of_gloss_alone():
    glossy = state()
    glossy.key("]")
    assert glossy.sharper == 1
    glossy.key("G")
    for _ in range(2):
        glossy.key("]")
    assert glossy.sharper == pytest.approx(2)
    for _ in range(100):
        glossy.key("[")
    assert glossy.sharpness == -SHARPEST


def test_where_there_is_no_gloss_there_is_none_to_switch_on():
    dull = state(has_gloss=False)
    dull.key("G")
    assert not dull.glossy


def test_the_light_turns_about_y_and_tilts():
    turned = state()
    turned.turn_light(40, 0)
    np.testing.assert_allclose(turned.rotation(), about_y(40))
    turned = state()
    turned.key("DOWN")
    x, up = turned.rotation() @ [1, 0, 0], turned.rotation() @ [0, 1, 0]
    np.testing.assert_allclose(x, [1, 0, 0], atol=1e-12)
    assert up[2] > 0
    turned.drag("right", 33, -7, 500)
    np.testing.assert_allclose(turned.rotation() @ turned.rotation().T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turned.rotation()) == pytest.approx(1)


def test_arrows_and_back_are_no_turn():
    turned = state()
    for name in ("LEFT", "UP", "RIGHT", "DOWN"):
        turned.key(name)
    assert (turned.azimuth, turned.tilt) == (0, 0)


def test_r_leads_back_and_keeps_the_method():
    moved = state(light=1)
    moved.drag("left", 20, 10, 500)
    moved.scroll(3)
    moved.drag("right", 20, 10, 500)
    for name in ("L", "3", "R"):
        moved.key(name)
    assert (moved.orbit, moved.light, moved.azimuth, moved.tilt) == (Orbit.of(EYE), 1, 0.0, 0.0)
    assert moved.method == "net"


def test_other_keys_do_nothing():
    for name in ("Q", "F1", "SPACE", "", "²"):
        pressed = state()
        pressed.key(name)
        assert pressed == state()


def test_the_words_say_what_is_shown():
    shown = state()
    assert shown.words() == "texture · diffuse · studio"
    for name in ("3", "G", "]", "L", "LEFT", "S", "E"):
        shown.key(name)
    assert shown.words() == "net · glossy, exponents x 1.41 · sky turned -5 · split · 8 x error"


def test_every_key_has_its_line():
    assert {key for key, _ in KEYS} >= {"drag", "wheel", "arrows", "1 2 3", "[ ]", *"LGSEHPR", "Esc"}


def test_a_move_of_the_frames_height_is_one():
    orbit = Orbit((0.0, 0.0, 0.0), 0.0, 0.0, 2.0, 40.0)
    np.testing.assert_allclose(orbit.moved(1, 0).target, [-4 * tan(radians(20)), 0, 0], atol=1e-12)
