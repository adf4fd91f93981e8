"""What a user gets from a run of data-driven transfer by itself: files, figures, resumption, refusals."""

import json
from pathlib import Path

import numpy as np
import pytest

from prtnet import PrtnetError, data_driven, score, store
from prtnet.pipeline import run
from prtnet.pipeline.data_driven import database as databases
from prtnet.pipeline.data_driven.learn import of_scene, operator
from prtnet.pipeline.job import open_job
from tests.pipeline.test_pipeline import artifacts, config

SETTINGS = {
    "methods": ["data_driven"],
    "data_driven__configurations": 12,
    "data_driven__unseen": 4,
    "data_driven__points": 32,
    "data_driven__supersampling": 4,
    "data_driven__elements": 6,
    "data_driven__size": 64,
    "data_driven__directions": 32,
    "data_driven__bounces": 2,
    "data_driven__samples": 8,
    "data_driven__tested_lights": 2,
    "data_driven__tested_views": 1,
    "render__size": 48,
}


def small(out: Path, **changes: object):
    return config(out, **(SETTINGS | changes))


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("driven")
    run(small(out), "prtnet scene=cornell method=data_driven")
    return out


def test_a_run_leaves_files_figures_and_pages(finished):
    names = ("data_driven.safetensors", "indirect.glsl", "indirect_basis.exr", "certificate.json", "curves.json")
    names += ("score.json", "card.md", "report.html", "contact_sheet.png", "basis.png", "config.yaml")
    for name in names:
        assert (finished / name).stat().st_size > 0, name
    rows, _ = score.read(finished / "score.json")
    psnr = {row.method: row.psnr or 0 for row in rows}
    assert set(psnr) == {"direct", "data_driven", "projection", "lightmap", score.NOISE_FLOOR}
    assert {row.reference for row in rows} == {"path_traced"}
    # what bounces is most of the picture of a box
    assert psnr["data_driven"] > psnr["direct"] + 2
    assert psnr["lightmap"] > psnr["direct"] + 4
    found = json.loads((finished / "score.json").read_text())["data_driven"]
    assert found["training"]["projection"] <= found["training"]["rmse"] < found["training"]["level"]
    assert found["unseen"]["projection"] <= found["unseen"]["rmse"]
    assert 0 < found["noise"] < 0.5 * found["level"]
    spec = data_driven.load(finished / "data_driven.safetensors")
    assert (spec.elements, spec.measurements[0].count, spec.size) == (6, 32, 64)
    assert "unseen spot" in (finished / "card.md").read_text()


def test_the_same_command_again_makes_nothing(finished, capsys):
    stages = ("lightmaps", "measured", "data_driven", "paths", "relit")
    before = {stage: artifacts(finished, stage) for stage in stages}
    pages = {name: (finished / name).stat().st_mtime_ns for name in ("report.html", "certificate.json")}
    run(small(finished))
    assert before == {stage: artifacts(finished, stage) for stage in stages}
    assert pages == {name: (finished / name).stat().st_mtime_ns for name in pages}
    assert "times that of the projection" in capsys.readouterr().out


def test_more_elements_keep_the_lightmaps(finished):
    before = artifacts(finished, "lightmaps"), artifacts(finished, "measured")
    made = operator(open_job(small(finished, data_driven__elements=8), "", None))
    assert made.spec.elements == 8
    assert before == (artifacts(finished, "lightmaps"), artifacts(finished, "measured"))
    fewer = json.loads((finished / "score.json").read_text())["data_driven"]["training"]["rmse"]
    assert made.facts["training"]["rmse"] <= fewer


def test_a_killed_database_goes_on_with_its_shards(tmp_path, monkeypatch):
    monkeypatch.setattr(databases, "GROUP", 4)
    whole = operator(open_job(small(tmp_path / "whole"), "", None))
    made, renderer = [], databases._renderer

    def dies(ground, keyframe, purpose):
        render = renderer(ground, keyframe, purpose)

        def some(lightings, number):
            if len(made) == 2:
                raise KeyboardInterrupt
            made.append(number)
            return render(lightings, number)

        return some

    monkeypatch.setattr(databases, "_renderer", dies)
    job = open_job(small(tmp_path / "killed"), "", None)
    with pytest.raises(KeyboardInterrupt):
        operator(job)
    monkeypatch.setattr(databases, "_renderer", renderer)
    again = operator(open_job(small(tmp_path / "killed"), "", None))
    assert made == [0, 1]
    np.testing.assert_array_equal(again.training.lightmaps, whole.training.lightmaps)
    np.testing.assert_array_equal(again.spec.basis, whole.spec.basis)


def test_keyframes_environments_and_separate_bases_run(tmp_path):
    poses = [{"part": "small_box"}, {"part": "small_box", "move": [0.0, 0.3, 0.0], "turn": 40}]
    changes = {
        "data_driven__scenario": ["environment", "point"],
        "data_driven__keyframes": poses,
        "data_driven__channels": "separate",
        "data_driven__gamma": 2.2,
        "data_driven__tested_lights": 4,
        "data_driven__supersampling": 2,
    }
    run(small(tmp_path, **changes))
    spec = data_driven.load(tmp_path / "data_driven.safetensors")
    assert spec.matrices.shape[:2] == (2, 3)
    first, second = (each.positions for each in spec.measurements)
    assert 0 < np.mean(np.any(first != second, axis=(1, 2))) < 0.5
    rows, _ = score.read(tmp_path / "score.json")
    psnr = {row.method: row.psnr or 0 for row in rows}
    assert psnr["data_driven"] > psnr["direct"] + 1


def test_pictures_are_drawn_under_ones_own_lamps(finished, tmp_path):
    lamp = {"kind": "point", "position": [0.0, 0.4, 0.3], "colour": [2.0, 1.0, 0.5]}
    run(small(tmp_path, data_driven__lights=[lamp], data_driven__tested_views=2))
    pictures = store.load_arrays(next((tmp_path / "cache" / "relit").glob("*.safetensors")))
    assert len(pictures["path_traced"]) == 2
    inside = {"kind": "spot", "position": [-0.36, -0.6, -0.3]}
    with pytest.raises(PrtnetError, match=r"found the spot lamp 0 at \(-0\.36, -0\.6, -0\.3\) inside geometry"):
        run(small(tmp_path / "out", data_driven__lights=[inside]))
    with pytest.raises(PrtnetError, match=r"lighting: found .*expected lamps"):
        run(small(tmp_path / "out", data_driven__lights=[{"position": [0, 0, 0]}]))


def test_transfer_of_another_scene_is_refused(finished, tmp_path):
    job = open_job(small(tmp_path, scene__name="tea_set", scene__tessellation=0.1), "", None)
    with pytest.raises(PrtnetError, match=r"data-driven transfer of another scene than tea_set"):
        of_scene(finished / "data_driven.safetensors", job)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"data_driven__renderer": "magic"}, r"data_driven\.renderer: found 'magic', expected one of"),
        ({"data_driven__points": 0}, r"data_driven\.points: found 0, expected at least 1"),
        ({"data_driven__gamma": 0.0}, r"data_driven\.gamma: found 0\.0"),
        ({"data_driven__elements": 64}, r"data_driven\.configurations: found 12, expected at least one for each of"),
        ({"data_driven__scenario": ["moon"]}, r"data_driven\.scenario: found \['moon'\]"),
        ({"data_driven__keyframes": [{"part": "vase"}]}, r"found no part 'vase' in cornell"),
        ({"scene__name": "sdf_car"}, r"data_driven on an implicit surface"),
        ({"methods": ["texture", "data_driven"]}, r"data_driven stands beside other methods"),
    ],
)
def test_options_are_refused_with_nothing_half_written(changes, words, tmp_path):
    with pytest.raises(PrtnetError, match=words):
        run(small(tmp_path / "out", **changes))
    assert not list(tmp_path.rglob("*.safetensors")) or "keyframes" in str(changes)


def test_subsurface_without_mitsuba_is_refused_before_any_work(tmp_path, monkeypatch):
    from prtnet.data.lightmap import mitsuba

    monkeypatch.setattr(mitsuba.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(PrtnetError, match=r"expected the extra paths: type `pip install"):
        run(small(tmp_path / "out", data_driven__renderer="subsurface"))
    assert not (tmp_path / "out").exists()


def test_beside_other_methods_it_adds_what_bounces(tmp_path):
    changes = {
        "methods": ["texture", "data_driven"],
        "transfer__transport": "interreflected",
        "transfer__bounces": 2,
        "scene__camera": "inside",
        "data_driven__scenario": ["environment"],
        "data_driven__configurations": 24,
        "transfer__directions": 128,
        "data_driven__directions": 128,
    }
    run(small(tmp_path, **changes))
    rows, _ = score.read(tmp_path / "score.json")
    found = {row.method: row for row in rows}
    assert found["data_driven"].reference == "traced"
    assert (found["data_driven"].psnr or 0) > (found["texture"].psnr or 0) - 6
    assert (found["data_driven"].bytes or 0) < (found["texture"].bytes or 0)
