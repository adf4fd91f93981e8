"""Rows of a sweep side by side: seeds joined, names that tell points apart."""

import statistics
from dataclasses import replace

import pytest

from prtnet.chart import points, tables
from prtnet.chart.tables import Spread
from tests.rows import FLOOR, NET, TEXTURE


def seeds(values: list[float], point: str = "", **figures: object) -> list:
    return [
        replace(NET, psnr=value, point=",".join(filter(None, (point, f"train.seed={seed}"))), **figures)
        for seed, value in enumerate(values)
    ]


def test_seeds_are_one_row_of_means_with_the_sample_deviation():
    rows = seeds([34.0, 34.2, 34.9], "ablation=none") + seeds([30.0, 31.0, 33.0], "ablation=16x1", macs=1500)
    shown = points.side_by_side(rows)
    assert [(row.point, row.macs) for row in shown] == [("none", NET.macs), ("16x1", 1500)]
    for (row, spread), values in zip(shown.items(), ([34.0, 34.2, 34.9], [30.0, 31.0, 33.0]), strict=True):
        assert row.psnr == pytest.approx(statistics.fmean(values))
        assert spread == Spread(statistics.stdev(values), 3)
    text = tables.markdown(list(shown), shown)
    assert "| net, none | traced | **34.37 ± 0.47 (3)** |" in text
    assert "| net, 16x1 | traced | 31.33 ± 1.53 (3) |" in text
    assert tables.SPREAD_LEGEND in text


def test_figures_are_means_where_all_seeds_have_them():
    first, second = (replace(NET, bytes=10, ssim=0.5, flip=0.1), replace(NET, psnr=40.51, bytes=13, ssim=0.75))
    joined, spread = points.mean([first, second])
    assert (joined.psnr, joined.bytes, joined.ssim, joined.flip) == (pytest.approx(42.51), 12, 0.625, None)
    assert joined.method == "net"
    assert spread is not None
    assert points.mean([replace(first, psnr=None), second])[1] is None


def test_what_no_seed_changes_has_no_spread():
    rows = [replace(row, point=f"train.seed={seed}", ms_ratio=seed) for seed in (0, 1) for row in (TEXTURE, FLOOR)]
    shown = points.side_by_side(rows)
    assert list(shown.values()) == [None, None]
    assert [row.point for row in shown] == [None, None]
    assert [row.psnr for row in shown] == [TEXTURE.psnr, FLOOR.psnr]
    assert tables.SPREAD_LEGEND not in tables.markdown(list(shown), shown)


def test_one_seed_alone_has_no_spread():
    assert list(points.side_by_side(seeds([34.0], "ablation=none")).values()) == [None]


def test_seeds_of_scenes_stay_apart():
    rows = [row for scene in ("a", "b") for row in seeds([30.0, 31.0], f"scene={scene}", scene=scene)]
    assert [(row.scene, row.point) for row in points.side_by_side(rows)] == [("a", None), ("b", None)]


def test_two_names_of_one_point_are_both_said():
    rows = [replace(NET, point=f"ablation={name}") for name in ("none", "64x4")]
    rows.append(replace(NET, psnr=30.0, point="ablation=16x1"))
    rows += [replace(TEXTURE, point=row.point) for row in rows]
    shown = [tables.method_name(row) for row in points.side_by_side(rows)]
    assert shown == ["net, none = 64x4", "net, 16x1", "texture"]


def test_numbers_keep_the_name_of_their_key():
    names = ["a.width=16,b=16x1,c=1e3,d=true", "a.width=8,b=32x2,c=1e4,d=false"]
    words = list(points.own_words(names).values())
    assert words == [("width=16", "16x1", "c=1e3", "d=true"), ("width=8", "32x2", "c=1e4", "d=false")]
