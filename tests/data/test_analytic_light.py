"""Lights by formula against dense quadrature of their own formulas, and closed forms."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import scipy.special
from omegaconf import OmegaConf

from prtnet import PrtnetError, sh
from prtnet.data import analytic_light as lights
from prtnet.data import light

BANDS = 6
# dense: profiles have edges and kinks, so no degree is exact
TOWARDS, WEIGHTS = sh.quadrature(800)


def dense(values):
    return sh.project(values, TOWARDS, WEIGHTS, BANDS)


def made(name, **knobs):
    options = lights.AnalyticOptions()
    for key, value in knobs.items():
        setattr(getattr(options, name), key, value)
    return light.by_name(name, options)


def test_constant_is_its_first_coefficient():
    found = made("constant", radiance=[1.0, 2.0, 0.5]).coefficients(BANDS)
    np.testing.assert_allclose(found[0], np.sqrt(4 * np.pi) * np.array([1, 2, 0.5]), rtol=1e-6)
    assert np.abs(found[1:]).max() < 1e-6


def test_gradient_equals_quadrature():
    zenith, horizon, nadir = np.array([[0.1, 0.2, 0.9], [0.7, 0.8, 0.6], [0.3, 0.0, 0.1]])
    found = made("gradient", zenith=list(zenith), horizon=list(horizon), nadir=list(nadir))
    y = TOWARDS[:, 1:2]
    drawn = np.where(y > 0, horizon + y * (zenith - horizon), horizon - y * (nadir - horizon))
    np.testing.assert_allclose(found.coefficients(BANDS), dense(drawn), atol=2e-5)


@pytest.mark.parametrize("radius", [0.001, 0.267, 5.0, 40.0, 90.0])
def test_the_sun_has_the_closed_form_of_a_disc(radius):
    """f_l = 2 pi (P_{l-1}(a) - P_{l+1}(a)) / (2 l + 1), f_0 = 2 pi (1 - a), with a = cos radius."""
    direction = np.array([0.3, -0.4, 1.2])
    found = made("sun", direction=list(direction), radius=radius, irradiance=[3.0, 2.0, 0.0]).coefficients(BANDS)
    angle, l = np.radians(radius), np.arange(1, BANDS)
    edge = np.cos(angle)
    legendre = scipy.special.eval_legendre(np.arange(BANDS + 1), edge)
    # the difference loses digits where the disc is small
    zonal = 2 * np.pi * np.concatenate([[1 - edge], (legendre[l - 1] - legendre[l + 1]) / (2 * l + 1)])
    along = sh.evaluate(direction / np.linalg.norm(direction), BANDS) * zonal[sh.band_index(BANDS)]
    expected = along[:, None] * np.array([3, 2, 0]) / (np.pi * np.sin(angle) ** 2)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 if radius > 0.1 else 1e-4)


@pytest.mark.parametrize("radius", [10.0, 60.0])
def test_the_sun_equals_quadrature_and_gives_its_irradiance(radius):
    sun = lights.SunOptions(direction=[1.0, 2.0, -1.0], radius=radius, irradiance=[3.0, 2.0, 1.0])
    lobes = lights.lobes("sun", lights.AnalyticOptions(sun=sun))
    drawn = lights.radiance(lobes, TOWARDS)
    np.testing.assert_allclose(lights.project(lobes, BANDS), dense(drawn), atol=0.03)
    facing = np.clip(TOWARDS @ lights.unit("", [1.0, 2.0, -1.0]), 0, None)
    np.testing.assert_allclose((WEIGHTS * facing) @ drawn, [3, 2, 1], rtol=5e-3)


def test_a_small_sun_is_directional():
    small = made("sun", radius=1e-3).coefficients(BANDS)
    np.testing.assert_allclose(small, made("directional").coefficients(BANDS), rtol=1e-5, atol=1e-5)
    facing = sh.evaluate(lights.unit("", [0.75, 0.55, 0.45]), 40)
    many = made("directional", irradiance=[1.0, 1.0, 1.0]).coefficients(40)
    irradiance = (sh.cosine_zonal(40)[sh.band_index(40)] * facing) @ many
    np.testing.assert_allclose(irradiance, 1, atol=2e-3)


def test_green_is_the_published_function_with_its_pole_up():
    """The published formula in its own angles, with theta from +y, and phi from +z towards +x."""
    x, y, z = TOWARDS.T
    theta, phi = np.arccos(y), np.arctan2(x, z)
    drawn = np.maximum(0, 5 * np.cos(theta) - 4)
    drawn = drawn + np.maximum(0, -4 * np.sin(theta - np.pi) * np.cos(phi - 2.5) - 3)
    found = made("green", radiance=[1.0, 2.0, 0.5])
    np.testing.assert_allclose(found.coefficients(BANDS), dense(drawn[:, None] * [1, 2, 0.5]), atol=2e-5)
    np.testing.assert_allclose(
        lights.radiance(lights.lobes("green", lights.AnalyticOptions()), TOWARDS),
        drawn[:, None] * [1, 1, 1],
        atol=1e-12,
    )


@pytest.mark.parametrize("name", ["sky", "constant", "gradient", "green"])
def test_the_image_shows_the_same_light(name):
    found = made(name)
    assert found.image.shape == (256, 512, 3)
    np.testing.assert_allclose(light.project(found.image, 5), found.coefficients(5), atol=2e-3)


def test_the_sky_is_what_it_was():
    np.testing.assert_array_equal(made("sky").coefficients(5), light.project(light.sky(), 5))


def test_the_option_files_are_the_defaults():
    folder = Path(__file__).resolve().parents[2] / "configs" / "light"
    assert {file.stem for file in folder.glob("*.yaml")} == set(light.NAMES)
    for name in light.NAMES:
        values = OmegaConf.to_container(OmegaConf.load(folder / f"{name}.yaml"))
        assert values == {"name": name, name: asdict(getattr(lights.AnalyticOptions(), name))}


@pytest.mark.parametrize(
    ("name", "knobs", "words"),
    [
        ("constant", {"radiance": [1.0, 2.0]}, ["light.constant.radiance", "[1.0, 2.0]", "three"]),
        ("constant", {"radiance": [0.0, 0.0, 0.0]}, ["constant", "no light at all"]),
        ("gradient", {"nadir": [0.0, -1.0, 0.0]}, ["light.gradient.nadir", "-1.0"]),
        ("green", {"radiance": [1.0, np.nan, 1.0]}, ["light.green.radiance", "nan"]),
        ("sun", {"radius": 0.0}, ["light.sun.radius", "found 0.0 degrees"]),
        ("sun", {"radius": 91.0}, ["light.sun.radius", "at most 90"]),
        ("sun", {"direction": [0.0, 0.0, 0.0]}, ["light.sun.direction", "other than 0"]),
        ("directional", {"direction": [1.0, 0.0]}, ["light.directional.direction"]),
        ("directional", {"irradiance": [1.0, 0.0, np.inf]}, ["light.directional.irradiance", "inf"]),
        ("sky", {"ground": [0.1]}, ["light.sky.ground", "three"]),
        ("sky", {"sun": [0.1]}, ["light.sky.sun"]),
    ],
)
def test_values_that_mean_nothing_are_refused_by_key(name, knobs, words):
    with pytest.raises(PrtnetError) as raised:
        made(name, **knobs)
    assert all(word in str(raised.value) for word in words)


def test_unknown_names_are_refused_with_the_known_ones():
    with pytest.raises(
        PrtnetError, match="found 'moon', expected one of sky, constant, gradient, sun, directional, gr"
    ):
        light.by_name("moon")
