"""The study of exports: its words can be exported, and its table says what the certificates and scores say."""

import csv
import json
import shutil

import pytest

from experiments.exports import frames, report
from prtnet import PrtnetError, score, sh
from prtnet.export import form
from prtnet.models import recipe
from prtnet.pipeline import run
from prtnet.pipeline.candidates import form_of
from tests.pipeline.test_pipeline import config
from tests.test_experiments import options_of, words_of

LITERAL, DEFERRED = "ablation=literal_8", "ablation=deferred_8"


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """One net, exported as literals and as a texture; the CPU draws the second."""
    out = tmp_path_factory.mktemp("exports")
    common = {
        "methods": ["texture", "net"],
        "cache": str(out / "cache"),
        "train__grid_cells": [],
        "train__hash_cells": [],
    }
    forms = {LITERAL: ("literal", "shader"), DEFERRED: ("texture", "deferred")}
    for name, (storage, by) in forms.items():
        chosen = config(out, **common, export__storage=storage, render__net=by)
        run(chosen, sweep_point=name, sweep_command="prtnet -m experiment=exports")
    return out


@pytest.fixture(scope="module")
def reported(swept, tmp_path_factory):
    results = tmp_path_factory.mktemp("study") / "results"
    results.mkdir()
    (results / "page.png").write_bytes(b"kept")
    frames.main(swept)
    report.report(swept, results)
    with (results / "certificates.csv").open(newline="") as file:
        return results, {row["form"]: row for row in csv.DictReader(file)}


def test_words_are_the_forms_that_can_be_exported():
    found = {word: options_of("experiment=exports", f"ablation={word}") for word in words_of("exports")}
    for word, options in found.items():
        named, width = word.split("_")
        assert options.model.width == int(width)
        sizes = recipe.layer_sizes(options.model, options.train, sh.count(options.transfer.bands))
        chosen = form_of(options).of_sizes(sizes)
        assert chosen.storage == {"deferred": "texture"}.get(named, named)
        assert (options.render.net == "deferred") == (named == "deferred")
        # literals as far as they go
        assert (named == "literal") or f"literal_{width}" in found or form.padded_macs_of(sizes, 1) > 60_000
    assert {word.split("_")[1] for word in found} == {"16", "32", "64", "128"}


def test_a_row_has_what_the_certificate_says(swept, reported):
    _, rows = reported
    assert set(rows) == {"literal", "deferred"}
    row, facts = rows["literal"], json.loads((swept / LITERAL / "certificate.json").read_text())
    for key, name in report.ERRORS.items():
        for what, value in facts["errors"][key].items():
            assert float(row[f"{name}_{what}"]) == pytest.approx(value, rel=1e-3)
    assert float(row["coefficients_max"]) <= float(row["coefficients_bound"]) == 1e-5
    assert float(row["first_draw_cpu_s"]) == pytest.approx(facts["timing"]["first_draw_cpu_seconds"], rel=1e-3)
    assert row["device"] == facts["device"]
    for name in ("transfer.glsl", "irradiance.glsl", "net.safetensors"):
        assert int(row[f"bytes_{name}"]) == (swept / LITERAL / name).stat().st_size


def test_a_row_has_what_the_scores_say(swept, reported):
    _, rows = reported
    for form_name, point in (("literal", LITERAL), ("deferred", DEFERRED)):
        scored, _ = score.read(swept / point / "score.json")
        net = next(each for each in scored if each.method == "net" and each.reference == "traced")
        for key in ("psnr", "ms_ratio"):
            assert float(rows[form_name][key]) == pytest.approx(getattr(net, key), rel=1e-3)


def test_a_row_has_the_cpu_time_of_frames(swept, reported):
    for form_name, point in (("literal", LITERAL), ("deferred", DEFERRED)):
        found = json.loads((swept / point / frames.NAME).read_text())
        assert float(reported[1][form_name]["cpu_ratio"]) == pytest.approx(found["ratio"], rel=1e-3)
        assert found["ratio"] > 0
        assert found["size"] == 32


def test_what_the_cpu_draws_has_no_shader_of_its_own(swept, reported):
    row = reported[1]["deferred"]
    facts = json.loads((swept / DEFERRED / "certificate.json").read_text())
    assert float(row["coefficients_max"]) == pytest.approx(facts["errors"]["torch"]["max"], rel=1e-3)
    assert row["first_draw_cpu_s"] == row["bytes_transfer.glsl"] == row["diffuse_max"] == ""


def test_the_table_has_a_line_for_each_point_and_pictures_stay(reported):
    results, rows = reported
    lines = (results / "certificates.md").read_text().splitlines()
    assert len(lines) == 2 + len(rows)
    assert len({line.count("|") for line in lines}) == 1
    assert lines[2].startswith("| 8 x 1 | literal |")
    assert (results / "command.txt").read_text().startswith("prtnet -m experiment=exports\n# collected at commit ")
    assert (results / "chart.png").stat().st_size > 5000
    assert (results / "page.png").read_bytes() == b"kept"


def test_files_that_were_edited_are_refused(swept, tmp_path):
    shutil.copytree(swept / LITERAL, tmp_path / LITERAL)
    with (tmp_path / LITERAL / "shading.glsl").open("a") as file:
        file.write("// edited\n")
    with pytest.raises(PrtnetError, match=r"shading\.glsl: found other bytes"):
        report.gather(tmp_path)


def test_frames_that_were_not_timed_are_refused(swept, tmp_path):
    shutil.copytree(swept / LITERAL, tmp_path / LITERAL)
    (tmp_path / LITERAL / frames.NAME).unlink()
    with pytest.raises(PrtnetError, match=r"frames\.py writes; run it first"):
        report.gather(tmp_path)


def test_a_folder_without_points_is_refused(tmp_path):
    with pytest.raises(PrtnetError, match="found no point"):
        report.report(tmp_path, tmp_path / "results")
    assert not (tmp_path / "results").exists()
