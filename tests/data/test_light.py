import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import light
from prtnet.data.analytic_light import AnalyticOptions
from tests.assets import asset

AXES = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "+z": (0, 0, 1), "-z": (0, 0, -1)}
COLOURS = np.array([[1, 0, 0], [0, 1, 1], [0, 1, 0], [1, 0, 1], [0, 0, 1], [1, 1, 0]], float)


def write(path, pixels):
    pixels = np.asarray(pixels, np.float32)
    image = oiio.ImageBuf(oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT))
    image.set_pixels(oiio.ROI(), pixels)
    assert image.write(str(path)), image.geterror()
    return path


def axes_image(height):
    """Each axis its colour, in a cap of 20 degrees around it, drawn by the convention's own formula for u and v."""
    image = np.zeros((height, 2 * height, 3))
    for (x, y, z), colour in zip(AXES.values(), COLOURS, strict=True):
        u, v = 0.5 + np.arctan2(x, -z) / (2 * np.pi), 0.5 - np.arcsin(y) / np.pi
        rows, columns = np.indices((height, 2 * height)) + 0.5
        latitude, longitude = (0.5 - rows / height) * np.pi, (columns / (2 * height) - u) * 2 * np.pi
        here = (0.5 - v) * np.pi
        cosine = np.sin(latitude) * np.sin(here) + np.cos(latitude) * np.cos(here) * np.cos(longitude)
        image[cosine > np.cos(np.radians(20))] = colour
    return image


def test_solid_angles_fill_the_sphere():
    for height in (1, 2, 7, 64):
        assert np.isclose(light.solid_angles(height, 2 * height).sum() * 2 * height, 4 * np.pi, rtol=1e-13)


def test_directions_follow_the_convention():
    towards = light.directions(64, 128)
    np.testing.assert_allclose(np.linalg.norm(towards, axis=-1), 1, atol=1e-12)
    step = 2 * np.pi / 64
    for (row, column), expected in {(32, 64): (0, 0, -1), (32, 96): (1, 0, 0), (32, 32): (-1, 0, 0)}.items():
        assert np.linalg.norm(towards[row, column] - expected) < step
    assert towards[0, :, 1].min() > 0.99
    assert towards[-1, :, 1].max() < -0.99
    assert np.linalg.norm(towards[32, 0] - [0, 0, 1]) < step


def test_coloured_axes_come_back_on_their_axes():
    coefficients = light.project(axes_image(128), 6)
    seen = sh.evaluate(np.array(list(AXES.values()), float), 6) @ coefficients
    for colour, found in zip(COLOURS, seen, strict=True):
        lit, dark = found[colour > 0].min(), found[colour == 0].max(initial=-np.inf)
        assert lit > 0.3
        assert dark < 0.12


def test_constant_light_is_its_first_coefficient():
    found = light.project(np.tile(np.float32([1, 2, 3]), (64, 128, 1)), 5)
    np.testing.assert_allclose(found[0], np.sqrt(4 * np.pi) * np.array([1, 2, 3]), rtol=1e-6)
    assert np.abs(found[1:]).max() < 3e-3  # texel centres: the error falls with the square of their size


@pytest.mark.parametrize(("row", "column"), [(0, 3), (20, 90), (40, 10), (63, 127)])
def test_a_single_texel_shines_from_its_direction(row, column):
    image = np.zeros((64, 128, 3))
    image[row, column] = 5
    found = light.project(image, 5)[:, 0]
    direction, angle = light.directions(64, 128)[row, column], light.solid_angles(64, 128)[row]
    np.testing.assert_allclose(found, 5 * angle * sh.evaluate(direction, 5), rtol=1e-5, atol=1e-9)
    grid = light.directions(64, 128)
    peak = np.unravel_index(np.argmax(sh.evaluate(grid, 5) @ found), (64, 128))
    assert grid[peak] @ direction > 0.995


def test_projection_keeps_energy():
    """Parseval: coefficients never hold more than the image, and nearly all of it when it is smooth."""
    sky = light.sky(64)
    energy = (sky.astype(float) ** 2 * light.solid_angles(64, 128)[:, None, None]).sum((0, 1))
    kept = (light.project(sky, 12).astype(float) ** 2).sum(0)
    assert (kept < energy * (1 + 1e-3)).all()
    assert (kept > 0.95 * energy).all()


def test_bad_radiance_becomes_black_and_is_counted(tmp_path, caplog):
    pixels = np.ones((4, 8, 3))
    pixels[0, 0], pixels[1, 1, 0], pixels[2, 2, 1] = -3, np.nan, np.inf
    with caplog.at_level(logging.WARNING):
        found = light.load(write(tmp_path / "bad.exr", pixels))
    assert found.sum() == 4 * 8 * 3 - 5
    assert "3 negative values (lowest -3)" in caplog.text
    assert "2 NaN or infinite" in caplog.text


@pytest.mark.parametrize("suffix", ["exr", "hdr"])
def test_images_come_back(tmp_path, suffix):
    pixels = np.random.default_rng(0).random((8, 16, 3)) + 0.5
    np.testing.assert_allclose(light.load(write(tmp_path / f"a.{suffix}", pixels)), pixels, rtol=2e-2)


def test_grey_and_alpha(tmp_path):
    grey = np.random.default_rng(0).random((4, 8, 1)).astype(np.float32)
    np.testing.assert_array_equal(light.load(write(tmp_path / "grey.exr", grey)), np.repeat(grey, 3, axis=2))
    rgba = np.random.default_rng(0).random((4, 8, 4)).astype(np.float32)
    np.testing.assert_array_equal(light.load(write(tmp_path / "rgba.exr", rgba)), rgba[..., :3])


def test_what_cannot_be_light_is_refused_by_name(tmp_path):
    with pytest.raises(PrtnetError, match=r"nowhere\.exr is not a file"):
        light.load(tmp_path / "nowhere.exr")
    torn = tmp_path / "torn.exr"
    torn.write_bytes(b"not an image")
    with pytest.raises(PrtnetError, match=r"torn\.exr cannot be read"):
        light.load(torn)
    with pytest.raises(PrtnetError, match=r"square\.exr is 4 x 4 pixels"):
        light.load(write(tmp_path / "square.exr", np.ones((4, 4, 3))))
    with pytest.raises(PrtnetError, match="no light at all"):
        light.load(write(tmp_path / "black.exr", np.zeros((4, 8, 3))))


def test_a_truncated_image_is_refused(tmp_path):
    whole = write(tmp_path / "whole.exr", np.random.default_rng(0).random((64, 128, 3)))
    torn = tmp_path / "half.exr"
    torn.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    with pytest.raises(PrtnetError, match=r"half\.exr cannot be read"):
        light.load(torn)


def test_the_sun_gives_the_irradiance_asked_for():
    black = {"zenith": (0, 0, 0), "horizon": (0, 0, 0), "ground": (0, 0, 0)}
    sun = np.array([0.3, 0.9, -0.2])
    image = light.sky(128, sun=list(sun), sun_irradiance=[3, 2, 1], **black)
    facing = np.clip(light.directions(128, 256) @ (sun / np.linalg.norm(sun)), 0, None)
    irradiance = (image * (facing * light.solid_angles(128, 256)[:, None])[..., None]).sum((0, 1))
    np.testing.assert_allclose(irradiance, [3, 2, 1], rtol=1e-3)


def test_the_sky_is_bright_above_dark_below_and_lit_from_the_side():
    image = light.sky()
    assert image.shape == (256, 512, 3)
    assert (image > 0).all()
    coefficients = light.project(image, 5)
    towards = np.array([[0.75, 0.55, 0.45], [-0.75, 0.1, -0.45], [0, 1, 0], [0, -1, 0]])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    sun, shade, up, down = (sh.cosine_lobe(towards, 5) @ coefficients).mean(axis=1)
    assert sun > 3 * shade
    assert up > 3 * down


def test_bad_suns():
    with pytest.raises(PrtnetError, match=r"light\.sky\.sun"):
        light.sky(8, sun=(0, 0, 0))
    with pytest.raises(PrtnetError, match="sharpness"):
        light.sky(8, sun_sharpness=0.0)


@pytest.mark.parametrize("columns", [0, 7, 16, -40])
def test_turned_columns_are_a_turned_light(columns):
    """Columns moved to the left are a turn from +z towards +x; whole columns are exact."""
    image = np.random.default_rng(0).random((16, 64, 3)).astype(np.float32)
    still = light.Light("noise", lambda bands: light.project(image, bands), image)
    turned = light.adjust(still, rotation=columns * 360 / 64)
    moved = np.roll(image, -columns, axis=1)
    np.testing.assert_array_equal(turned.image, moved)
    np.testing.assert_allclose(turned.coefficients(5), light.project(moved, 5), atol=1e-6)


def test_the_rotation_goes_from_z_towards_x():
    options = AnalyticOptions()
    options.directional.direction = [0.0, 0.5, 1.0]
    turned = light.adjust(light.by_name("directional", options), rotation=90)
    options.directional.direction = [1.0, 0.5, 0.0]
    np.testing.assert_allclose(turned.coefficients(5), light.by_name("directional", options).coefficients(5), atol=1e-6)


@pytest.mark.parametrize("degrees", [0.3, 10.1, 359.9, -12.34])
def test_an_image_turned_by_part_of_a_texel_keeps_its_light(degrees):
    image = light.sky(64)
    turned = light.adjust(light.Light("sky", lambda bands: light.project(image, bands), image), rotation=degrees)
    np.testing.assert_allclose(turned.image.mean(axis=1), image.mean(axis=1), rtol=1e-5)
    np.testing.assert_allclose(light.project(turned.image, 5), turned.coefficients(5), atol=3e-3)


@pytest.mark.parametrize(("window", "size"), [("hann", None), ("hann", 3.0), ("lanczos", 6.0)])
def test_windows_scale_bands_and_turn_with_the_light(window, size):
    plain = light.by_name("green")
    found = light.adjust(plain, window=window, window_size=size, rotation=30)
    factors = sh.window(window, size or 5, 5)[sh.band_index(5)][:, None]
    np.testing.assert_allclose(
        found.coefficients(5), factors * light.adjust(plain, rotation=30).coefficients(5), atol=1e-6
    )
    np.testing.assert_allclose(found.coefficients(5)[0], plain.coefficients(5)[0], atol=1e-6)


def test_windows_take_the_negative_light_of_a_hard_one():
    basis = sh.evaluate(sh.quadrature(40)[0], 5)
    plain = light.by_name("directional")
    lowest = [(basis @ light.adjust(plain, window=kind).coefficients(5)).min() for kind in ("none", "lanczos", "hann")]
    assert lowest[0] < -1
    assert lowest[0] < lowest[1] < lowest[2] < -1e-3


def test_names_say_what_is_not_default(tmp_path):
    path = write(tmp_path / "studio.old.exr", np.ones((4, 8, 3)))
    plain = light.from_file(path)
    assert plain.name == "studio.old"
    assert light.adjust(plain).name == "studio.old"
    assert light.adjust(plain, window="hann").name == "studio.old hann"
    assert light.adjust(plain, window="lanczos", window_size=4).name == "studio.old lanczos 4"
    assert light.adjust(light.by_name("sun"), window="hann", rotation=-22.5).name == "sun hann turned -22.5"


@pytest.mark.parametrize(
    ("knobs", "words"),
    [
        ({"rotation": np.nan}, ["light.rotation", "nan"]),
        ({"window": "hamming"}, ["light.window", "hamming", "none, hann, lanczos"]),
        ({"window": "hann", "window_size": 0.0}, ["light.window_size", "0.0"]),
        ({"window_size": 3.0}, ["light.window_size", "light.window=none"]),
    ],
)
def test_bad_adjustments_are_refused_by_key(knobs, words):
    with pytest.raises(PrtnetError) as raised:
        light.adjust(light.by_name("sky"), **knobs)
    assert all(word in str(raised.value) for word in [*words, "expected"])


def test_every_light_turns_and_projects_at_any_bands():
    for name in light.NAMES:
        for bands in (1, 5, 8):
            assert np.isfinite(light.adjust(light.by_name(name), rotation=15).coefficients(bands)).all()


def test_other_mappings_load_as_lat_long(tmp_path):
    path = write(tmp_path / "ball.exr", np.ones((64, 64, 3)))
    np.testing.assert_allclose(light.load(path, "auto"), np.ones((32, 64, 3)), rtol=1e-6)


def test_courtyard(caplog):
    with caplog.at_level(logging.WARNING):
        image = light.load(asset("envmaps/courtyard.exr"))
    assert image.shape == (512, 1024, 3)
    assert image.min() == 0
    assert "1818 negative values" in caplog.text
    coefficients = light.project(image, 5)
    mean = (image * light.solid_angles(512, 1024)[:, None, None]).sum((0, 1))
    np.testing.assert_allclose(coefficients[0], mean / np.sqrt(4 * np.pi), rtol=1e-5)
