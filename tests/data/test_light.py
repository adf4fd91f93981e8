import logging

import numpy as np
import OpenImageIO as oiio
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import light
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
    with pytest.raises(PrtnetError, match="sun direction"):
        light.sky(8, sun=(0, 0, 0))
    with pytest.raises(PrtnetError, match="sharpness"):
        light.sky(8, sun_sharpness=0.0)


def test_courtyard(caplog):
    with caplog.at_level(logging.WARNING):
        image = light.load(asset("envmaps/courtyard.exr"))
    assert image.shape == (512, 1024, 3)
    assert image.min() == 0
    assert "1818 negative values" in caplog.text
    coefficients = light.project(image, 5)
    mean = (image * light.solid_angles(512, 1024)[:, None, None]).sum((0, 1))
    np.testing.assert_allclose(coefficients[0], mean / np.sqrt(4 * np.pi), rtol=1e-5)
