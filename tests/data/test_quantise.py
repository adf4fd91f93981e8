"""Bytes for coefficients: the round trip, its error, and what filtering does to it."""

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data import quantise

RNG = np.random.default_rng(0)
IMAGE = (RNG.normal(size=(12, 12, 9)) * RNG.uniform(0.01, 2, 9)).astype(np.float32)
ALL = np.ones((12, 12), bool)


def test_float32_is_kept_to_the_bit():
    (found,) = quantise.decode(quantise.encode([IMAGE], ALL, "float32"))
    np.testing.assert_array_equal(found, IMAGE)


def test_float16_is_numpys():
    stored = quantise.encode([IMAGE], ALL, "float16")
    assert stored.levels[0].dtype == np.float16
    np.testing.assert_array_equal(quantise.decode(stored)[0], IMAGE.astype(np.float16).astype(np.float32))


def test_uint8_is_within_half_a_step_of_each_coefficients_own_range():
    stored = quantise.encode([IMAGE], ALL, "uint8")
    (found,) = quantise.decode(stored)
    span = IMAGE.max(axis=(0, 1)) - IMAGE.min(axis=(0, 1))
    worst = np.abs(found - IMAGE).max(axis=(0, 1)) / span
    assert (worst < 1.001 / 510).all()
    # and no better: half a step is reached nearly
    assert (worst > 0.9 / 510).all()
    np.testing.assert_allclose(found.max(axis=(0, 1)), IMAGE.max(axis=(0, 1)), rtol=1e-6)


def test_what_was_decoded_encodes_to_the_same_bytes():
    stored = quantise.encode([IMAGE], ALL, "uint8")
    again = quantise.encode(quantise.decode(stored), ALL, "uint8")
    np.testing.assert_array_equal(again.levels[0], stored.levels[0])


def test_decoding_and_filtering_change_places():
    stored = quantise.encode([IMAGE], ALL, "uint8")
    (decoded,) = quantise.decode(stored)
    weights = RNG.dirichlet([1, 1, 1, 1])
    corners = [(0, 0), (0, 1), (1, 0), (1, 1)]
    blended = sum(w * stored.levels[0][c].astype(np.float64) for w, c in zip(weights, corners, strict=True)) / 255
    expected = sum(w * decoded[c].astype(np.float64) for w, c in zip(weights, corners, strict=True))
    np.testing.assert_allclose(stored.offset + stored.scale * blended, expected, atol=1e-6)


def test_empty_texels_do_not_widen_the_range():
    used, image = ALL.copy(), IMAGE + 10
    used[:3], image[:3] = False, 0
    (found,) = quantise.decode(quantise.encode([image], used, "uint8"))
    span = image[used].max(axis=0) - image[used].min(axis=0)
    assert (np.abs(found - image)[used].max(axis=0) < 1.01 * span / 510 + 1e-6).all()


def test_a_constant_coefficient_and_further_levels():
    image = IMAGE.copy()
    image[..., 4] = -0.25
    levels = quantise.decode(quantise.encode([image, image[:6, :6]], ALL, "uint8"))
    assert (levels[0][..., 4] == np.float32(-0.25)).all()
    np.testing.assert_array_equal(levels[1], levels[0][:6, :6])


def test_unknown_format():
    with pytest.raises(PrtnetError, match=r"atlas\.format: found 'bfloat16', expected one of float32, float16, uint8"):
        quantise.check("bfloat16")
