"""The study of a large scene: its words mean what they say, and its table says what scores and files say."""

import csv
import json
from itertools import pairwise

import pytest
from PIL import Image

from experiments.large_scene import report
from prtnet import PrtnetError, clusters, netspec, score, sh
from prtnet.models import recipe
from prtnet.pipeline import run, split_options
from tests.pipeline.test_pipeline import config
from tests.test_experiments import options_of, words_of

COMMON = {"train__grid_cells": [], "train__hash_cells": [], "train__steps": 20, "render__net": "deferred"}


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """One net of more parameters, and two of fewer in halves of the scene."""
    out = tmp_path_factory.mktemp("large_scene")
    for word, more in {
        "one_large": {"methods": ["texture", "net"], "model__width": 16},
        "clusters_12": {"methods": ["texture", "clusters"], "split__by": "grid", "split__cells": [2, 1, 1]},
    }.items():
        chosen = config(out, cache=str(out / "cache"), **COMMON, **more)
        run(chosen, sweep_point=f"ablation={word},scene=cornell", sweep_command="prtnet -m experiment=large_scene")
    return out


@pytest.fixture(scope="module")
def reported(swept, tmp_path_factory):
    results = tmp_path_factory.mktemp("study") / "results"
    report.report([swept], results)
    with (results / "networks.csv").open(newline="") as file:
        return results, {(row["point"], row["method"]): row for row in csv.DictReader(file)}


def parameters(options) -> int:
    sizes = recipe.layer_sizes(options.model, options.train, sh.count(options.transfer.bands))
    return recipe.feature_count(options.train) + sum(a * b + b for a, b in pairwise(sizes))


def test_words_are_one_net_and_clusters_of_about_as_many_parameters():
    found = {word: options_of("experiment=large_scene", f"ablation={word}") for word in words_of("large_scene")}
    for word, options in found.items():
        split_options.check(options)
        recipe.check(options.train)
        assert ("clusters" in options.methods) == word.startswith("clusters_")
    whole = found["clusters_12"]
    assert whole.split.cells[0] * whole.split.cells[1] * whole.split.cells[2] == 12
    assert 12 * parameters(split_options.of_one(whole, 1)) == pytest.approx(parameters(found["one_large"]), rel=0.1)
    assert found["one_small"].model == whole.model
    assert [options.split.networks for options in found.values() if "clusters" in options.methods] == [12, 8, 6, 4]


def test_a_row_has_what_files_and_scores_say(swept, reported):
    _, rows = reported
    assert set(rows) == {("one_large", "net"), ("clusters_12", "clusters")}
    point = swept / "ablation=clusters_12,scene=cornell"
    nets = clusters.load(point / "clusters").nets
    row = rows["clusters_12", "clusters"]
    assert int(row["networks"]) == len(nets) == 2
    # weights and biases are float32, and there are no grids
    assert 4 * int(row["parameters"]) == sum(netspec.byte_count(net) for net in nets) == int(row["bytes"])
    scored, _ = score.read(point / "score.json")
    traced = next(each for each in scored if (each.method, each.reference) == ("clusters", "traced"))
    assert float(row["psnr"]) == pytest.approx(traced.psnr, rel=1e-3)
    seams = json.loads((point / "score.json").read_text())["seams"]["clusters"]
    assert (row["border_worst"] == "") == (seams["worst"] is None)
    if seams["worst"]:
        assert float(row["border_worst"]) == pytest.approx(seams["worst"], rel=1e-3)
    assert int(rows["one_large", "net"]["parameters"]) > int(row["parameters"]) / 2


def test_the_sheet_is_cut_out_at_the_pictures(swept, reported):
    results, _ = reported
    point = swept / "ablation=clusters_12,scene=cornell"
    cells = report._cells(point)
    rows, _ = score.read(point / "score.json")
    (found,) = [row for row in rows if (row.method, row.reference) == ("clusters", "traced")]
    shown = [score.psnr(view["clusters"], view["traced"], None) for view in cells]
    # of 8 bits, and of the whole frame
    assert sum(shown) / len(shown) == pytest.approx(found.psnr_full, abs=0.3)
    with Image.open(results / "sheet.jpg") as image:
        assert image.size[0] > 6 * cells[0]["traced"].shape[1]
    assert (results / "chart.png").stat().st_size > 5000


def test_the_table_has_a_line_for_each_row(reported):
    results, rows = reported
    lines = (results / "networks.md").read_text().splitlines()
    assert len(lines) == 2 + len(rows)
    assert len({line.count("|") for line in lines}) == 1
    assert (results / "command.txt").read_text().startswith("prtnet -m experiment=large_scene\n# collected at commit ")


def test_a_folder_without_points_is_refused(tmp_path):
    with pytest.raises(PrtnetError, match="found no point"):
        report.report([tmp_path], tmp_path / "results")
    assert not (tmp_path / "results").exists()
