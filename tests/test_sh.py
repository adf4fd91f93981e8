"""SH against independent oracles: sphericart, scipy quadrature, closed forms."""

import numpy as np
import pytest
import scipy.integrate
import scipy.special
import sphericart
from hypothesis import given
from hypothesis import strategies as st

from prtnet import PrtnetError, sh

AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def unit(count: int, seed: int = 0) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def rotation(seed: int) -> np.ndarray:
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


@pytest.mark.parametrize("bands", [1, 2, 5, 12])
def test_evaluate_equals_sphericart(bands):
    directions = unit(500)
    oracle = sphericart.SphericalHarmonics(bands - 1).compute(directions)
    np.testing.assert_allclose(sh.evaluate(directions, bands), oracle, atol=1e-12)


def test_first_band_is_y_z_x():
    np.testing.assert_allclose(sh.evaluate(unit(9), 2)[:, 1:], np.sqrt(3 / (4 * np.pi)) * unit(9)[:, [1, 2, 0]])


def test_orthonormal():
    directions, weights = sh.quadrature(18)
    basis = sh.evaluate(directions, 10)
    np.testing.assert_allclose(basis.T @ (weights[:, None] * basis), np.eye(100), atol=1e-12)


def test_evaluate_keeps_leading_axes_and_type():
    directions = unit(6).astype(np.float32).reshape(2, 3, 3)
    values = sh.evaluate(directions, 5)
    assert values.shape == (2, 3, 25)
    assert values.dtype == np.float32
    np.testing.assert_array_equal(values.reshape(6, 25), sh.evaluate(directions.reshape(6, 3), 5))


def test_bands_and_counts_are_inverse():
    assert [sh.bands_of(sh.count(bands)) for bands in range(1, 9)] == list(range(1, 9))
    with pytest.raises(PrtnetError, match="square"):
        sh.bands_of(24)
    with pytest.raises(PrtnetError, match="at least 1"):
        sh.count(0)


def test_project_inverts_evaluate():
    directions, weights = sh.quadrature(8)
    coefficients = np.random.default_rng(1).normal(size=(25, 3))
    values = sh.evaluate(directions, 5) @ coefficients
    np.testing.assert_allclose(sh.project(values, directions, weights, 5), coefficients, atol=1e-12)


@pytest.mark.parametrize("l", range(9))
def test_cosine_zonal_equals_quadrature(l):
    integral, _ = scipy.integrate.quad(lambda t: t * scipy.special.eval_legendre(l, t), 0, 1)
    assert sh.cosine_zonal(9)[l] == pytest.approx(2 * np.pi * integral, abs=1e-12)


def test_cosine_lobe_is_the_projection_of_the_clamped_cosine():
    normal = unit(1)[0]
    # a dense rule: the clamped cosine has a kink, so no degree is exact
    directions, weights = sh.quadrature(600)
    clamped = np.maximum(0, directions @ normal)[:, None]
    np.testing.assert_allclose(sh.cosine_lobe(normal, 5), sh.project(clamped, directions, weights, 5)[:, 0], atol=2e-5)
    assert sh.cosine_lobe(np.array([0.0, 1.0, 0.0]), 2)[:2] == pytest.approx([0.8862, 1.0233], abs=1e-4)


@pytest.mark.parametrize("exponent", [0, 1, 7.5, 200])
@pytest.mark.parametrize("l", range(6))
def test_phong_lobe_equals_quadrature(exponent, l):
    integral, _ = scipy.integrate.quad(
        lambda t: (exponent + 1) * t**exponent * scipy.special.eval_legendre(l, t), 0, 1, epsabs=1e-13
    )
    assert sh.phong_lobe(exponent, 6)[l] == pytest.approx(integral, abs=1e-10)


def test_windows_are_their_formulas():
    """Sloan 2008: hann (1 + cos(pi l / w)) / 2, lanczos sin(pi l / w) / (pi l / w), 0 from w on."""
    np.testing.assert_array_equal(sh.window("none", 1, 4), np.ones(4))
    np.testing.assert_allclose(sh.window("hann", 4, 6), [1, 0.5 + 8**-0.5, 0.5, 0.5 - 8**-0.5, 0, 0], atol=1e-12)
    expected = [1, np.sqrt(8) / np.pi, 2 / np.pi, np.sqrt(8) / (3 * np.pi), 0, 0]
    np.testing.assert_allclose(sh.window("lanczos", 4, 6), expected, atol=1e-12)
    np.testing.assert_allclose(sh.window("hann", 2.5, 4)[2:], [(1 + np.cos(0.8 * np.pi)) / 2, 0], atol=1e-12)
    for kind in sh.WINDOWS:
        assert sh.window(kind, 3, 1) == [1]  # the mean stays


@pytest.mark.parametrize(("kind", "size"), [("hamming", 3), ("hann", 0), ("lanczos", -1), ("none", np.inf)])
def test_windows_that_mean_nothing_are_refused(kind, size):
    with pytest.raises(PrtnetError, match=r"window.*expected"):
        sh.window(kind, size, 4)


@given(st.integers(0, 10**6), st.integers(1, 6))
def test_rotate_turns_the_function(seed, bands):
    turn = rotation(seed)
    coefficients = np.random.default_rng(seed).normal(size=(bands**2, 2))
    directions = unit(20, seed)
    turned = sh.evaluate(directions, bands) @ sh.rotate(coefficients, turn)
    before = sh.evaluate(directions @ turn, bands) @ coefficients  # rows are R^-1 w
    np.testing.assert_allclose(turned, before, atol=1e-10)
    np.testing.assert_allclose(sh.rotate(sh.rotate(coefficients, turn), turn.T), coefficients, atol=1e-10)


def test_rotate_moves_the_cosine_lobe_with_its_normal():
    turn, normal = rotation(3), unit(1, 4)[0]
    lobe = sh.cosine_lobe(normal, 5)[:, None]
    np.testing.assert_allclose(sh.rotate(lobe, turn)[:, 0], sh.cosine_lobe(turn @ normal, 5), atol=1e-12)


def test_rotate_refuses_a_matrix_that_is_no_rotation():
    with pytest.raises(PrtnetError, match="orthogonal"):
        sh.rotate(np.zeros((4, 1)), 2 * np.eye(3))


def test_triple_product_multiplies_functions():
    rng, directions = np.random.default_rng(0), unit(50)
    first, second = rng.normal(size=9), rng.normal(size=16)
    # the product of 3 and 4 bands has 6 bands: nothing is cut
    product = np.einsum("ijk,i,j->k", sh.triple_product(3, 4, 6), first, second)
    expected = (sh.evaluate(directions, 3) @ first) * (sh.evaluate(directions, 4) @ second)
    np.testing.assert_allclose(sh.evaluate(directions, 6) @ product, expected, atol=1e-11)


def test_triple_product_with_a_constant_is_the_identity():
    np.testing.assert_allclose(sh.triple_product(1, 5, 5)[0] * np.sqrt(4 * np.pi), np.eye(25), atol=1e-12)
