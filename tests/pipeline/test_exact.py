"""The reference without SH in a run: its rows, what it is kept under, and what becomes of a killed one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from prtnet import PrtnetError, score, store
from prtnet.chart import plot
from prtnet.pipeline import exact, run
from tests.pipeline.test_pipeline import artifacts, config, killed
from tests.small import overrides

EXACT = {"methods": ["texture"], "render__exact_samples": 64, "render__exact_views": 1}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("exact")
    run(config(out, **EXACT))
    return out


def test_rows_against_exact(finished):
    rows, _ = score.read(finished / "score.json")
    by_pair = {(row.method, row.reference): row for row in rows}
    methods = ("texture", score.NOISE_FLOOR)
    assert set(by_pair) == {(name, "traced") for name in methods} | {(name, "exact") for name in (*methods, "traced")}
    assert by_pair["texture", "exact"].views == 1
    assert by_pair["texture", "exact"].macs == by_pair["texture", "traced"].macs
    assert by_pair["traced", "exact"].macs is None
    # three bands of a sky are a little off, and these few samples noisier than that
    assert 20 < (by_pair["traced", "exact"].psnr or 0) < 60
    assert (by_pair["texture", "exact"].psnr or 0) < (by_pair["traced", "exact"].psnr or 0)
    page = (finished / "card.md").read_text()
    assert "traced against exact is the error of SH itself" in page


@pytest.mark.parametrize("bounces", [1, 3])
def test_bounces_agree_with_those_of_transfer(tmp_path, bounces):
    """Under a constant light SH are exact for diffuse surfaces: paths and gathered transfer find the same radiance."""
    changes = {"transfer__transport": "interreflected", "transfer__bounces": bounces, "transfer__directions": 256}
    more = {"light__name": "constant", "render__exact_samples": 512, "render__traced_directions": 512}
    run(config(tmp_path, **EXACT | changes | more))
    by_pair = {(row.method, row.reference): row.psnr or 0 for row in score.read(tmp_path / "score.json")[0]}
    assert by_pair["traced", "exact"] > 48


def test_charts_keep_references_apart(finished, tmp_path):
    """The chart is the same with and without rows against another reference."""
    rows, _ = score.read(finished / "score.json")
    for name, few in (("all", rows), ("traced", [row for row in rows if row.reference == "traced"])):
        plot.pareto(tmp_path / f"{name}.png", few)
    assert (tmp_path / "all.png").read_bytes() == (tmp_path / "traced.png").read_bytes()


def test_sheet_has_the_views_that_were_drawn(finished):
    kept = store.load_arrays(next((finished / "cache" / "score").glob("*.safetensors")))
    drawn = [not np.isnan(image).any() for image in kept["exact"]]
    assert drawn == [True, False]
    assert np.abs(kept["exact"][0].astype(float) - kept["traced"][0])[kept["covered"][0]].mean() < 0.1


def test_images_are_kept_under_all_they_depend_on(finished):
    """Two of each: the first view, and it again for the noise floor."""

    def count(**changes):
        before = set(artifacts(finished, "exact"))
        run(config(finished, **EXACT | changes))
        return len(set(artifacts(finished, "exact")) - before)

    assert len(artifacts(finished, "exact")) == 2
    # what SH alone depends on draws nothing anew
    assert count() == 0
    assert count(light__window="hann", transfer__bands=2) == 0
    assert count(light__rotation=30.0) == 2
    assert count(light__name="sun") == 2
    assert count(light__name="sun", light__rotation=30.0) == 2
    assert count(material__specular=[0.5, 0.5, 0.5]) == 2
    assert count(render__exact_samples=65) == 2
    assert count(seed=1) == 2
    assert count(transfer__transport="interreflected") == 2
    run(config(finished, **EXACT))


def test_without_it_nothing_is_drawn(tmp_path):
    run(config(tmp_path, methods=["texture"]))
    assert not artifacts(tmp_path, "exact")
    assert "exact" not in {row.reference for row in score.read(tmp_path / "score.json")[0]}


def test_a_killed_run_goes_on_to_the_same_bytes(tmp_path):
    changes = EXACT | {"render__exact_samples": 1 << 13, "threads": 1}
    interrupted, whole = tmp_path / "interrupted", tmp_path / "whole"
    killed(overrides(interrupted, **changes | {"methods": "[texture]"}), interrupted, "cache/exact/*.shards/*.json")
    for out in (interrupted, whole):
        run(config(out, **changes))
    for name in artifacts(whole, "exact"):
        first, second = (store.file_digest(out / "cache" / "exact" / name) for out in (interrupted, whole))
        assert first == second
    assert len(artifacts(interrupted, "exact")) == 2
    assert not list(interrupted.rglob("*.shards"))


def test_more_views_than_there_are_is_all(finished):
    run(config(finished, **EXACT | {"render__exact_views": 5}))
    rows, _ = score.read(finished / "score.json")
    assert {row.views for row in rows if row.method == "texture"} == {2}
    run(config(finished, **EXACT))


@pytest.mark.parametrize(("key", "value", "least"), [("exact_samples", -1, 0), ("exact_views", 0, 1)])
def test_bad_counts_are_refused(tmp_path: Path, key, value, least):
    with pytest.raises(PrtnetError, match=rf"render\.{key}: found {value}, expected at least {least}"):
        run(config(tmp_path, **EXACT | {f"render__{key}": value}))


def test_a_light_is_told_by_its_image_or_its_disc():
    from prtnet.data import light

    sky, sun = light.by_name("sky"), light.by_name("sun")
    assert sky.image is not None
    keys = [
        exact.light_key(each) for each in (sky, sun, replace(sky, image=sky.image + 1), light.adjust(sun, rotation=9))
    ]
    assert len({store.content_key(key) for key in keys}) == 4
    assert exact.light_key(light.adjust(sky, window="hann")) == keys[0]
