from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from prtnet import PrtnetError
from prtnet.chart import sheet


def images(seed: int, views: int, height: int = 20, width: int = 32) -> list[np.ndarray]:
    return list(np.random.default_rng(seed).random((views, height, width, 3)))


def read(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture)


def window(sheet_pixels: np.ndarray, plan: sheet.Layout, row: int, column: int) -> np.ndarray:
    x, y = plan.corner(row, column)
    return sheet_pixels[y : y + plan.height, x : x + plan.width]


def bytes_of(image: np.ndarray) -> np.ndarray:
    return np.round(255 * np.clip(image, 0, 1)).astype(np.uint8)


@settings(deadline=None)
@given(st.integers(1, 200), st.integers(1, 12))
def test_chosen_views_are_even(views: int, most: int) -> None:
    chosen = sheet.chosen(views, most)
    assert len(chosen) == min(views, most) == len(set(chosen))
    assert chosen[0] == 0
    assert max(chosen) < views
    if len(chosen) > 1:
        steps = np.diff(chosen)
        assert chosen[-1] == views - 1
        assert steps.max() - steps.min() <= 1


def test_sheet_shows_each_image_and_eight_times_its_error(tmp_path: Path) -> None:
    views = {"net": images(1, 2), "traced": images(0, 2), "texture": images(2, 2)}
    views["net"] = [0.95 * view + 0.05 * other for view, other in zip(views["traced"], views["net"], strict=True)]
    sheet.contact_sheet(tmp_path / "sheet.png", views, cell=32, title="A title that is far too long for the sheet" * 9)
    pixels, plan = read(tmp_path / "sheet.png"), sheet.layout(2, 2, (20, 32), 32)
    assert pixels.shape == (*plan.sheet[::-1], 3)
    assert (plan.rows, plan.columns, plan.width, plan.height) == (2, 5, 32, 20)
    for row in range(2):
        wanted = views["traced"][row]
        np.testing.assert_array_equal(window(pixels, plan, row, 0), bytes_of(wanted))
        for column, method in ((1, "net"), (3, "texture")):
            image = views[method][row]
            np.testing.assert_array_equal(window(pixels, plan, row, column), bytes_of(image))
            np.testing.assert_array_equal(window(pixels, plan, row, column + 1), bytes_of(8 * np.abs(image - wanted)))


def test_small_images_are_enlarged_by_whole_pixels_and_large_ones_shrunk(tmp_path: Path) -> None:
    views = {"traced": images(0, 1), "net": images(1, 1)}
    sheet.contact_sheet(tmp_path / "sheet.png", views, cell=100)
    shown = window(read(tmp_path / "sheet.png"), sheet.layout(1, 1, (20, 32), 100), 0, 0)
    np.testing.assert_array_equal(shown, bytes_of(views["traced"][0]).repeat(3, axis=0).repeat(3, axis=1))
    plan = sheet.layout(30, 3, (1024, 2048))
    assert (plan.width, plan.height, plan.rows, plan.columns) == (256, 128, 8, 7)


def test_sheet_is_the_same_each_time(tmp_path: Path) -> None:
    views = {"traced": images(0, 11), "net": images(1, 11)}
    covered = [np.arange(32)[None, :].repeat(20, axis=0) > 4 for _ in range(11)]
    for name in ("a.png", "b.png"):
        sheet.contact_sheet(tmp_path / name, views, covered=covered)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.png"]


def test_views_keep_their_own_numbers(tmp_path: Path) -> None:
    views = {"traced": images(0, 2), "net": images(1, 2)}
    for name, numbers in (("a.png", None), ("b.png", [0, 1]), ("c.png", [0, 29])):
        sheet.contact_sheet(tmp_path / name, views, numbers=numbers)
    first, same, other = (read(tmp_path / name) for name in ("a.png", "b.png", "c.png"))
    assert np.array_equal(first, same)
    assert not np.array_equal(first, other)


def test_what_was_not_drawn_stays_empty(tmp_path: Path) -> None:
    views = {"traced": images(0, 2), "exact": images(1, 2)}
    views["exact"][1] = np.full_like(views["exact"][1], np.nan)
    sheet.contact_sheet(tmp_path / "sheet.png", views, cell=32)
    pixels, plan = read(tmp_path / "sheet.png"), sheet.layout(2, 1, (20, 32), 32)
    np.testing.assert_array_equal(window(pixels, plan, 0, 1), bytes_of(views["exact"][0]))
    for column in (1, 2):
        assert (window(pixels, plan, 1, column) == sheet.PAPER).all()


def test_bad_views_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PrtnetError, match="no images of 'traced'"):
        sheet.contact_sheet(tmp_path / "sheet.png", {"net": images(0, 1)})
    with pytest.raises(PrtnetError, match="traced 2, net 1"):
        sheet.contact_sheet(tmp_path / "sheet.png", {"traced": images(0, 2), "net": images(0, 1)})


def test_a_grid_shows_rows_and_leaves_places_empty(tmp_path: Path) -> None:
    first, second, third = images(0, 3)
    sheet.grid(tmp_path / "grid.png", {"a": [first, None], "b": [second, third]}, ["one", "two"], title="t", cell=32)
    pixels = read(tmp_path / "grid.png")
    plan = sheet.Layout(2, 2, 32, 20)
    assert pixels.shape[:2] == plan.sheet[::-1]
    for row, column, image in ((0, 0, first), (1, 0, second), (1, 1, third)):
        np.testing.assert_array_equal(window(pixels, plan, row, column), bytes_of(image))
    assert (window(pixels, plan, 0, 1) == sheet.PAPER).all()
