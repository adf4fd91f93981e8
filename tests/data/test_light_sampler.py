"""Directions drawn from lights: densities and frequencies against solid angles, discs against closed forms."""

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import light, light_sampler, mapping
from prtnet.data.analytic_light import AnalyticOptions
from prtnet.data.light import Light
from prtnet.data.light_sampler import ImageSampler


def noise_image(seed=3, height=8):
    """A few texels with a black row, black texels and a bright one."""
    image = np.random.default_rng(seed).random((height, 2 * height, 3)).astype(np.float32)
    image[2] = 0
    image[:, 5] = 0
    image[3, 4] = 30, 20, 10
    return image


def test_an_image_is_drawn_texel_by_texel_in_proportion():
    image, count = noise_image(), 200_000
    drawn = ImageSampler(image)
    directions, radiance, density = drawn.draw(np.random.default_rng(0).random((count, 2)))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-12)
    np.testing.assert_array_equal(drawn.radiance(directions), radiance)
    np.testing.assert_array_equal(drawn.density(directions), density)
    # the mean of the channels over the density is the same everywhere: its integral over the sphere
    integral = (image.mean(axis=2) * light.solid_angles(8, 16)[:, None]).sum()
    np.testing.assert_allclose(radiance.mean(axis=1) / density, integral, rtol=1e-6)
    _, row, column = mapping.locate("lat_long", directions, 8, 16)
    share = np.zeros((8, 16))
    np.add.at(share, (np.rint(row).astype(int), np.rint(column).astype(int) % 16), 1 / count)
    expected = image.mean(axis=2) * light.solid_angles(8, 16)[:, None] / integral
    assert np.all(np.abs(share - expected) <= 5 * np.sqrt(expected / count) + 1e-12)


def test_a_texel_is_drawn_evenly():
    """The mean over one texel of each SH basis function is its integral by quadrature over that texel."""
    image = np.zeros((4, 8, 3), np.float32)
    image[1, 6] = 1
    directions, _, _ = ImageSampler(image).draw(np.random.default_rng(1).random((400_000, 2)))
    towards, weights = sh.quadrature(400)
    inside = ImageSampler(image).radiance(towards)[:, 0] > 0
    expected = weights[inside] @ sh.evaluate(towards[inside], 4) / weights[inside].sum()
    np.testing.assert_allclose(sh.evaluate(directions, 4).mean(axis=0), expected, atol=3e-3)


def test_densities_integrate_to_one():
    """By a finer grid of the same edges."""
    towards, weights = light.directions(40, 80), light.solid_angles(40, 80)[:, None]
    density = ImageSampler(noise_image()).density(towards.reshape(-1, 3)).reshape(40, 80)
    np.testing.assert_allclose(np.sum(weights * density), 1, rtol=1e-6)


def sun(radius, rotation=0.0, name="sun"):
    options = AnalyticOptions()
    options.sun.radius = radius
    options.sun.direction = options.directional.direction = [0.0, 0.0, 2.0]
    return light.adjust(light.by_name(name, options), rotation=rotation)


@pytest.mark.parametrize("radius", [0.267, 20.0, 90.0])
def test_the_sun_is_drawn_from_its_cone(radius):
    drawn = light_sampler.of_light(sun(radius))
    directions, radiance, density = drawn.draw(np.random.default_rng(0).random((100_000, 2)))
    rim = np.cos(np.radians(radius))
    assert directions[:, 2].min() >= rim - 1e-12
    np.testing.assert_allclose(density, 1 / (2 * np.pi * 2 * np.sin(np.radians(radius) / 2) ** 2), rtol=1e-9)
    np.testing.assert_allclose(directions.mean(axis=0), [0, 0, (1 + rim) / 2], atol=4e-3)
    assert np.mean(drawn.density(directions) == density) > 0.999
    # what a surface that faces it receives
    received = np.mean(radiance * (directions[:, 2] / density)[:, None], axis=0)
    np.testing.assert_allclose(received, [3.6, 3.1, 2.4], rtol=0.01)


def test_a_light_from_one_direction():
    drawn = light_sampler.of_light(sun(1, rotation=90.0, name="directional"))
    directions, irradiance, density = drawn.draw(np.random.default_rng(0).random((5, 2)))
    assert drawn.single
    # +z turned towards +x
    np.testing.assert_allclose(directions, np.tile([1.0, 0, 0], (5, 1)), atol=1e-12)
    np.testing.assert_array_equal(irradiance, np.tile([3.6, 3.1, 2.4], (5, 1)))
    np.testing.assert_array_equal(density, 1)
    assert not drawn.radiance(directions).any()


def test_sun_and_images_turn_with_the_light():
    turned = light_sampler.of_light(sun(5, rotation=90.0))
    assert turned.radiance(np.array([[1.0, 0, 0]])).any()
    assert not turned.radiance(np.array([[0, 0, 1.0]])).any()
    image = np.zeros((8, 16, 3), np.float32)
    image[4, 0] = image[4, 15] = 1  # around +z
    found = light.adjust(Light("spot", lambda bands: np.zeros((bands**2, 3)), image), rotation=90.0)
    directions, _, _ = light_sampler.of_light(found).draw(np.random.default_rng(0).random((100, 2)))
    assert directions[:, 0].min() > 0.8


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(PrtnetError, match="light: odd has neither an image nor a disc"):
        light_sampler.of_light(Light("odd", lambda bands: np.zeros((bands**2, 3))))
