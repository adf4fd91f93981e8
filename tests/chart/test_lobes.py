"""Lobes on the sphere: what is drawn is the function that the coefficients stand for."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from prtnet import PrtnetError, sh
from prtnet.chart import lobes
from tests.nets import random_points


def random_transfer(count: int, bands: int = 4, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, sh.count(bands)))


def test_a_lobe_is_the_sum_of_its_harmonics() -> None:
    transfer, (_, directions) = random_transfer(3), random_points(7)
    found = lobes.evaluate(transfer, directions.reshape(7, 1, 3))
    assert found.shape == (3, 7, 1)
    for point in range(3):
        for place in range(7):
            expected = sum(t * y for t, y in zip(transfer[point], sh.evaluate(directions[place], 4), strict=True))
            assert found[point, place, 0] == pytest.approx(expected, abs=1e-5)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**31))
def test_equal_areas_of_the_disc_are_equal_parts_of_the_sphere(seed: int) -> None:
    """By Parseval: the mean square over the disc is the sum of squared coefficients over 4 pi."""
    transfer, (_, normals) = random_transfer(1, seed=seed), random_points(1, seed=seed)
    directions, inside = lobes.disc(normals[0], 128)
    np.testing.assert_allclose(np.linalg.norm(directions[inside], axis=-1), 1, atol=1e-6)
    mean = np.mean(lobes.evaluate(transfer, directions[inside]) ** 2)
    # the rim is cut into pixels: up to 0.012 in 200 draws
    assert mean == pytest.approx(np.sum(transfer**2) / (4 * np.pi), rel=0.02)


@pytest.mark.parametrize("normal", [(0, 1, 0), (0, -1, 0), (1, 0, 0), (0.6, 0, 0.8), (0.48, 0.6, 0.64)])
def test_the_disc_has_the_normal_in_its_middle_and_up_on_top(normal: tuple[float, float, float]) -> None:
    directions, inside = lobes.disc(np.array(normal, np.float64), 101)
    np.testing.assert_allclose(directions[50, 50], normal, atol=1e-12)
    horizon = round(50 * 0.5**0.5)
    top, right = directions[50 - horizon, 50], directions[50, 50 + horizon]
    assert abs(top @ normal) < 0.05  # half a pixel
    up = np.array([0, 0, -1] if abs(normal[1]) == 1 else [0, 1, 0])
    assert top @ up > 0.7
    # seen from outside, right is right: a mirrored disc has the other sign
    assert np.cross(right, top) @ normal > 0.99
    assert not inside[0, 0]
    assert inside[50].all()


def test_the_points_shown_stand_where_their_names_say() -> None:
    errors = np.random.default_rng(0).permutation(np.linspace(0, 1, 101))
    shown = lobes.chosen(errors)
    assert {name: round(float(errors[index]), 6) for name, index in shown.items()} == lobes.PLACES
    assert set(lobes.chosen(np.array([0.3])).values()) == {0}


def test_the_picture_has_a_line_for_each_point_and_shows_the_difference(tmp_path: Path) -> None:
    truth, (_, normals) = random_transfer(3), random_points(3)
    wrong = truth + 0.1
    for name, predicted in (("a", truth), ("b", wrong), ("c", wrong)):
        lobes.picture(tmp_path / f"{name}.png", predicted, truth, normals, names=["x", "$y$", "z"], title="$t")
    bytes_of = {name: (tmp_path / f"{name}.png").read_bytes() for name in "abc"}
    assert bytes_of["b"] == bytes_of["c"] != bytes_of["a"]
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (814, round(110 * (0.75 + 3 * 2.05)))


def test_other_counts_are_refused(tmp_path: Path) -> None:
    truth, (_, normals) = random_transfer(2), random_points(2)
    with pytest.raises(PrtnetError, match="2 predictions, 2 truths, 2 normals and 1 names"):
        lobes.picture(tmp_path / "a.png", truth, truth, normals, names=["x"])
