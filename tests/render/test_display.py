"""Tone curves, bloom and mirrored light: bounds, energy, and where things are to be seen."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prtnet import PrtnetError
from prtnet.data import atlas, light
from prtnet.data.analytic_light import AnalyticOptions
from prtnet.render import display
from prtnet.render.camera import Camera
from prtnet.render.display import OPEN, Display
from prtnet.render.raster import Raster
from tests.render.meshes import scene, sphere

COLOURS = st.lists(st.floats(0, 50), min_size=3, max_size=3)


@pytest.mark.parametrize("curve", display.TONES)
@settings(deadline=None)
@given(colour=COLOURS, lighter=st.floats(1, 20))
def test_tone_curves_rise_and_stay_in_range(curve, colour, lighter):
    low, high = (display.tone(np.array([colour]) * factor, curve) for factor in (1.0, lighter))
    assert np.all(high >= low - 1e-12)
    assert low.min() >= 0
    assert high.max() <= 1


def test_tone_curves_have_their_formulas():
    grey = np.array([0.1, 0.5, 1.0, 4.0, 9.0])
    colours = np.repeat(grey[:, None], 3, axis=1)
    np.testing.assert_allclose(display.tone(colours, "linear")[:, 0], [0.1, 0.5, 1, 1, 1])
    np.testing.assert_allclose(display.tone(colours, "exposure")[:, 0], 1 - np.exp(-grey))
    # WHITE is shown as white, and a colour keeps its hue
    np.testing.assert_allclose(display.tone(colours, "reinhard")[3:], 1, rtol=1e-12)
    shown = display.tone(np.array([[0.4, 0.2, 0.1]]), "reinhard")[0]
    np.testing.assert_allclose(shown / shown[2], [4, 2, 1])


def spot(size=128, value=40.0):
    image = np.full((size, size, 3), 0.2)
    image[size // 2, size // 2] = value * np.array([1, 0.5, 0.25])
    return image


@pytest.mark.parametrize("size", [97, 128])
def test_bloom_makes_and_loses_no_light(size):
    before = spot(size)
    after = display.bloom(before, 1.0)
    np.testing.assert_allclose(after.mean(axis=(0, 1)), before.mean(axis=(0, 1)), rtol=1e-9)
    assert after[size // 2, size // 2, 0] < before.max()
    # wherever the bright pixel stands to the pyramid's coarser grids
    for step in range(1, 6):
        moved = np.roll(before, (step, 2 * step), axis=(0, 1))
        np.testing.assert_allclose(display.bloom(moved, 1.0).mean(), before.mean(), rtol=1e-5)


def test_bloom_spreads_what_is_brighter_than_the_screen_alone():
    before, half, whole = spot(), display.bloom(spot(), 0.5), display.bloom(spot(), 1.0)
    assert (display.bloom(np.minimum(before, 1), 1.0) == np.minimum(before, 1)).all()
    assert (display.bloom(before, 0.0) == before).all()
    np.testing.assert_allclose(half - before, (whole - before) / 2, atol=1e-12)
    added = (whole - before)[64, :, 0]
    # falls to both sides of the middle, and reaches some way
    assert np.all(np.diff(added[65:80]) < 1e-9)
    assert added[64 + 4] > 0.01
    assert added[64 + 40] < 1e-3
    # the channel that does not exceed white stays where it is
    dim = spot(value=3.0)
    np.testing.assert_array_equal(display.bloom(dim, 1.0)[..., 2], dim[..., 2])


def test_light_beyond_the_border_is_lost():
    before = np.zeros((64, 64, 3))
    before[0, 0] = 40
    assert 0.2 * before.mean() < display.bloom(before, 1.0).mean() < 0.9 * before.mean()


@pytest.fixture(scope="module")
def ball():
    """A sphere from +z, its G-buffer and the transfer of an open point."""
    made = atlas.make(scene(sphere(48)), size=64)
    view = Raster(made, 64).gbuffer(Camera((0, 0, 6), (0, 0, 0), fov_y=25.0))
    transfer = np.zeros((len(view.pixel), 4), np.float32)
    transfer[:, 0] = OPEN
    return view, transfer


def sun(direction, radius=8.0):
    options = AnalyticOptions()
    options.sun.radius, options.sun.direction = radius, list(direction)
    return light.by_name("sun", options)


@pytest.mark.parametrize(("direction", "sign"), [((1, 0, 1), (1, 0)), ((-1, 0, 1), (-1, 0)), ((0, 1, 1), (0, 1))])
@pytest.mark.parametrize("as_image", [False, True])
def test_the_sun_is_mirrored_half_way_between_it_and_the_eye(ball, direction, sign, as_image):
    """At normals half way between +z, nearly the eye, and the sun: 22.5 degrees off the middle."""
    view, transfer = ball
    found = sun(direction)
    if as_image:
        towards = light.directions(180, 360)
        axis = np.asarray(direction) / np.sqrt(2)
        found = light.Light(
            "spot", lambda bands: np.zeros((bands**2, 3)), np.float32(towards @ axis > 0.99)[..., None].repeat(3, -1)
        )
    shown = display.highlights(found, view, transfer, 1.0)[..., 0]
    row, column = np.nonzero(shown)
    assert len(row) > 3
    weights = shown[row, column]
    right, up = np.average(column, weights=weights) - 31.5, 31.5 - np.average(row, weights=weights)
    # pixels of the sphere's radius: 64 / 2 / tan(12.5 degrees) / sqrt(35)
    radius = 32 / np.tan(np.radians(12.5)) / np.sqrt(35)
    np.testing.assert_allclose(np.array([right, up]) / radius, np.sin(np.radians(22.5)) * np.array(sign), atol=0.06)


def test_highlights_scale_and_what_is_in_shadow_does_not_shine(ball):
    view, transfer = ball
    white = light.by_name("constant")
    whole = display.highlights(white, view, transfer, 0.5)
    np.testing.assert_allclose(whole.reshape(-1, 3)[view.pixel], 0.5, rtol=1e-5)
    assert not whole.reshape(-1, 3)[np.setdiff1d(np.arange(64 * 64), view.pixel)].any()
    half = transfer.copy()
    half[::2] = 0
    dark = display.highlights(white, view, half, 0.5).reshape(-1, 3)[view.pixel]
    assert not dark[::2].any()
    np.testing.assert_allclose(dark[1::2], 0.5, rtol=1e-5)


def test_default_display_is_the_tone_map_of_scores():
    from prtnet import score

    image = np.random.default_rng(0).normal(1, 1, (8, 8, 3))
    shown = score.srgb_encode(display.show(Display(), image, 0.7))
    np.testing.assert_allclose(shown, score.tone_map(image, 0.7), atol=1e-12)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tone": "aces"}, r"render\.tone: found 'aces', expected one of linear, reinhard, exposure"),
        ({"bloom": 1.5}, r"render\.bloom: found 1\.5, expected a share from 0 to 1"),
        ({"bloom": float("nan")}, r"render\.bloom: found nan"),
        ({"highlights": -1.0}, r"render\.highlights: found -1\.0, expected a finite weight of 0 or more"),
        ({"highlights": float("inf")}, r"render\.highlights: found inf"),
    ],
)
def test_bad_options_are_refused(options, message):
    with pytest.raises(PrtnetError, match=message):
        Display(**options)


def test_a_single_direction_has_nothing_to_mirror():
    with pytest.raises(PrtnetError, match=r"render\.highlights: found 0\.1 with light directional"):
        Display(highlights=0.1).check(light.by_name("directional"))
    Display(highlights=0.1).check(light.by_name("sun"))
    Display(bloom=0.1).check(light.by_name("directional"))
