import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import convolve1d

from prtnet import PrtnetError, score

SEEDS = st.integers(0, 2**31)
ROW = score.Row(
    scene="plants",
    method="net",
    material="diffuse",
    light="sky",
    reference="traced",
    psnr=44.5,
    psnr_worst=41.2,
    psnr_full=47.0,
    ssim=0.99,
    ssim_full=0.995,
    mae=0.004,
    flip=None,
    ms=120.0,
    ms_ratio=8.1,
    macs=17_300,
    bytes=70_000,
    bake_seconds=12.0,
    train_seconds=60.0,
    clipped=0.01,
    views=8,
)


def picture(seed: int, size: int = 24) -> np.ndarray:
    return np.random.default_rng(seed).random((size, size + 3, 3))


def everywhere(image: np.ndarray) -> np.ndarray:
    return np.ones(image.shape[:2], bool)


def test_exposure_is_nine_tenths_over_the_99th_percentile_of_the_brightest_channel() -> None:
    image = np.zeros((10, 20, 3))
    image[..., 1] = np.arange(200).reshape(10, 20)
    image[..., 0] = -5
    assert score.exposure([image], [everywhere(image)]) == pytest.approx(0.9 / (0.99 * 199))


def test_exposure_looks_at_covered_pixels_of_all_views() -> None:
    bright, dim = np.full((4, 4, 3), 8.0, np.float32), np.full((4, 4, 3), 2.0, np.float32)
    bright[0] = 1e9
    covered = everywhere(bright)
    covered[0] = False
    assert score.exposure([dim, bright], [everywhere(dim), covered]) == pytest.approx(0.9 / 8)


@settings(deadline=None)
@given(SEEDS, st.floats(1e-3, 1e3))
def test_exposure_cancels_the_brightness_of_the_light(seed: int, gain: float) -> None:
    image = picture(seed)
    shown = score.tone_map(image, score.exposure([image], [everywhere(image)]))
    brighter = score.tone_map(gain * image, score.exposure([gain * image], [everywhere(image)]))
    np.testing.assert_allclose(brighter, shown, atol=1e-12)


@pytest.mark.parametrize("level", [0.0, -1.0])
def test_a_black_reference_is_refused(level: float) -> None:
    image = np.full((4, 4, 3), level)
    with pytest.raises(PrtnetError, match="expected above 0"):
        score.exposure([image], [everywhere(image)])


def test_tone_map_clips_and_encodes() -> None:
    linear = np.array([-1.0, 0.0, 0.001, 0.5, 1.0, 7.0])
    expected = [0, 0, 12.92 * 0.001, 1.055 * 0.5 ** (1 / 2.4) - 0.055, 1, 1]
    np.testing.assert_allclose(score.tone_map(linear, 1.0), expected, atol=1e-12)
    assert score.tone_map(np.float32([0.25]), 2.0).dtype == np.float32


@settings(deadline=None)
@given(st.floats(0, 1))
def test_srgb_round_trip(value: float) -> None:
    encoded = score.srgb_encode(np.array([value]))
    np.testing.assert_allclose(score.srgb_decode(encoded), value, atol=1e-6)


@settings(deadline=None)
@given(SEEDS, st.floats(1e-4, 0.5))
def test_psnr_of_a_constant_error(seed: int, error: float) -> None:
    image = picture(seed)
    assert score.psnr(image + error, image) == pytest.approx(-20 * math.log10(error))


def test_psnr_looks_at_covered_pixels_only() -> None:
    image = picture(1)
    other, covered = image.copy(), everywhere(image)
    covered[:5] = False
    other[:5] += 0.5
    other[5:] += 0.01
    assert score.psnr(other, image, covered) == pytest.approx(40)
    squared = (5 * 0.5**2 + 19 * 0.01**2) / 24
    assert score.psnr(other, image) == pytest.approx(-10 * math.log10(squared))


@settings(deadline=None)
@given(SEEDS)
def test_equal_images_are_perfect_and_finite(seed: int) -> None:
    image = picture(seed).astype(np.float32)
    view = score.score_view(image, image, everywhere(image), 1.0)
    assert view.psnr == view.psnr_full == score.PSNR_CAP
    assert view.mae == 0
    assert view.ssim == pytest.approx(1)


@settings(deadline=None)
@given(SEEDS, SEEDS)
def test_metrics_do_not_care_which_image_is_the_reference(first: int, second: int) -> None:
    a, b = picture(first), picture(second)
    one, other = (score.score_view(*pair, everywhere(a), 1.0) for pair in ((a, b), (b, a)))
    assert (one.psnr, one.mae) == pytest.approx((other.psnr, other.mae))
    assert one.ssim == pytest.approx(other.ssim)


@settings(deadline=None)
@given(SEEDS)
def test_more_noise_is_worse(seed: int) -> None:
    rng = np.random.default_rng(seed)
    image, noise = 0.25 + 0.5 * rng.random((24, 24, 3)), 0.02 * rng.standard_normal((24, 24, 3))
    less, more = (score.score_view(image + gain * noise, image, everywhere(image), 1.0) for gain in (1, 3))
    assert less.psnr > more.psnr
    assert less.ssim > more.ssim
    assert less.mae < more.mae


def test_ssim_equals_the_formula_written_out() -> None:
    a, b = picture(3), picture(4)
    kernel = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
    kernel /= kernel.sum()

    def blur(x: np.ndarray) -> np.ndarray:
        return convolve1d(convolve1d(x, kernel, axis=0, mode="reflect"), kernel, axis=1, mode="reflect")

    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b, both = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2, blur(a * b) - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    luminance = (2 * mean_a * mean_b + c1) / (mean_a**2 + mean_b**2 + c1)
    structure = (2 * both + c2) / (var_a + var_b + c2)
    np.testing.assert_allclose(score.ssim_map(a, b), (luminance * structure).mean(-1), atol=1e-9)


def test_ssim_of_covered_pixels_is_the_map_averaged_over_them() -> None:
    a, b = picture(5), picture(6)
    covered = picture(7)[..., 0] > 0.6
    view, similarity = score.score_view(a, b, covered, 0.9), score.ssim_map(*(score.tone_map(x, 0.9) for x in (a, b)))
    assert view.ssim == pytest.approx(similarity[covered].mean())
    assert view.ssim_full == pytest.approx(similarity.mean())


def test_ssim_refuses_images_smaller_than_its_window() -> None:
    with pytest.raises(PrtnetError, match="found 10 x 40"):
        score.ssim_map(np.zeros((40, 10, 3)), np.zeros((40, 10, 3)))


def test_flip_of_equal_images_is_zero_and_grows() -> None:
    image = picture(8)
    same, worse = score.flip_map(image, image), score.flip_map(1 - image, image)
    if same is None or worse is None:
        pytest.skip("flip-evaluator is not installed: pip install prtnet[flip]")
    assert same.max() == 0
    assert worse.mean() > 0.2


def test_flip_is_none_where_its_package_is_absent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "flip_evaluator", None)
    image = picture(9)
    assert score.flip_map(image, image) is None
    assert score.score_views([image], [image], [everywhere(image)], 1.0).summary()["flip"] is None


def test_clipped_counts_covered_pixels_with_a_negative_channel() -> None:
    image, covered = np.ones((4, 5, 3)), np.ones((4, 5), bool)
    covered[0] = False
    image[:2, 0, 1] = -1e-6
    assert score.clipped_share(image, covered) == pytest.approx(1 / 15)


def test_views_are_averaged_in_decibels_and_the_worst_is_named() -> None:
    references = [picture(seed) * 0.5 for seed in range(3)]
    encoded = [score.srgb_encode(image) for image in references]
    errors = 0.001, 0.1, 0.01
    images = [score.srgb_decode(image + error) for image, error in zip(encoded, errors, strict=True)]
    metrics = score.score_views(images, references, [everywhere(image) for image in images], 1.0)
    assert [view.psnr for view in metrics.per_view] == pytest.approx([60, 20, 40])
    assert metrics.worst == 1
    summary = metrics.summary()
    assert (summary["psnr"], summary["psnr_worst"], summary["views"]) == (pytest.approx(40), pytest.approx(20), 3)
    assert summary["mae"] == pytest.approx(sum(errors) / 3)


def test_bad_views_are_refused_by_number() -> None:
    image = picture(0)
    broken, nothing = image.copy(), np.zeros(image.shape[:2], bool)
    broken[2, 3, 0] = np.nan
    whole = everywhere(image)
    with pytest.raises(PrtnetError, match="view 1: 1 values are NaN"):
        score.score_views([image, broken], [image, image], [whole, whole], 1.0)
    with pytest.raises(PrtnetError, match="view 0: no pixel is covered"):
        score.score_views([image], [image], [nothing], 1.0)
    with pytest.raises(PrtnetError, match="1 images, 2 references"):
        score.score_views([image], [image, image], [whole], 1.0)
    with pytest.raises(PrtnetError, match="at least one"):
        score.score_views([], [], [], 1.0)


def test_costs() -> None:
    assert score.fetch_macs(25) == 200
    assert score.fetch_macs(25, "bilinear") == 100
    assert score.diffuse_macs(25) == 75
    assert score.texture_bytes(1024, 25) == 1024**2 * 28 * 4
    assert score.texture_bytes(4, 16, texel_bytes=2, levels=3) == (16 + 4 + 1) * 16 * 2


def test_keys_are_those_of_the_format() -> None:
    expected = (
        "scene method material light reference psnr psnr_worst psnr_full ssim ssim_full mae flip ms ms_ratio "
        "macs bytes bake_seconds train_seconds clipped views covered vertices triangles point"
    )
    assert " ".join(score.KEYS) == expected


def test_row_takes_metrics_and_known_costs() -> None:
    image = picture(2)
    metrics = score.score_views([image], [image], [everywhere(image)], 1.0)
    names = {"scene": "s", "method": "net", "material": "diffuse", "light": "sky", "reference": "traced"}
    row = score.row(metrics, **names, macs=12, ms=0.5)
    assert (row.psnr, row.macs, row.ms, row.bytes, row.views) == (100.0, 12, 0.5, None, 1)
    with pytest.raises(TypeError):
        score.row(metrics, **names, speed=3)


def test_file_round_trip(tmp_path: Path) -> None:
    rows = [ROW, replace(ROW, method=score.NOISE_FLOOR, ms=None, views=1)]
    score.write(tmp_path / "score.json", rows, score.versions())
    assert score.read(tmp_path / "score.json") == (rows, score.versions())
    assert [row.is_noise_floor for row in rows] == [False, True]


def test_files_from_before_a_column_are_read_with_null(tmp_path: Path) -> None:
    whole = replace(ROW, covered=0.5, vertices=12, triangles=20)
    content = json.loads(score.rows_to_json([whole], {}))
    for name in score.OPTIONAL:
        del content["rows"][0][name]
    (tmp_path / "old.json").write_text(json.dumps(content))
    assert score.read(tmp_path / "old.json")[0] == [ROW]
    assert ROW.covered is ROW.vertices is ROW.triangles is None
    del content["rows"][0]["macs"]
    (tmp_path / "older.json").write_text(json.dumps(content))
    with pytest.raises(PrtnetError, match="row 0 misses or has besides: macs;"):
        score.read(tmp_path / "older.json")


def test_file_is_strict_json() -> None:
    rows = [replace(ROW, psnr=math.inf, ms=math.nan, mae=-math.inf, psnr_full=np.float64(3), bytes=None)]
    text = score.rows_to_json(rows, {"torch": None})

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    row = json.loads(text, parse_constant=refuse)["rows"][0]
    assert (row["psnr"], row["ms"], row["mae"], row["psnr_full"]) == (None, None, None, 3)


def test_versions_name_what_a_score_depends_on() -> None:
    assert list(score.versions()) == ["prtnet", "python", "numpy", "torch", "machine"]
    assert score.versions()["numpy"] == np.__version__


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not a score file"),
        ("[1]", "not a score file"),
        ('{"rows": [NaN], "versions": {}}', "not strict JSON"),
        ('{"rows": [{"scene": "x"}], "versions": {}}', "row 0 misses"),
    ],
)
def test_broken_files_are_refused_by_name(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "score.json"
    path.write_text(text)
    with pytest.raises(PrtnetError, match=message) as caught:
        score.read(path)
    assert str(path) in str(caught.value)
    with pytest.raises(PrtnetError, match="not a score file"):
        score.read(tmp_path / "absent.json")
