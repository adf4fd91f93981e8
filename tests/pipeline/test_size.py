"""Stage `size`: what it chooses, what it trains for that, and what it leaves."""

import json
import shlex
from pathlib import Path

import pytest

from prtnet import PrtnetError, netspec, score
from prtnet.config import Config
from prtnet.pipeline import candidates, run
from tests.small import SETTINGS

PLANE = """
v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
f 1 4 3
f 1 3 2
"""


def config(out: Path, **changes: object) -> Config:
    made = Config(out=str(out), stages=["size"], methods=["texture", "net"])
    for name, value in (SETTINGS | {key.replace("__", "."): value for key, value in changes.items()}).items():
        group, _, key = name.rpartition(".")
        setattr(getattr(made, group) if group else made, key, value)
    made.size.grids = ["none"]
    return made


def nets(out: Path) -> list[dict]:
    """The records of all trained nets."""
    return [json.loads(path.read_text()) for path in (out / "cache" / "net").glob("*.json")]


@pytest.fixture(scope="module")
def plane(tmp_path_factory):
    out = tmp_path_factory.mktemp("plane")
    (out / "plane.obj").write_text(PLANE)
    changes = {"scene__path": str(out / "plane.obj"), "train__steps": 500, "transfer__directions": 256}
    changes |= {"render__traced_directions": 256, "size__target_psnr": 50.0}
    run(config(out, **changes), "prtnet scene.path=plane.obj stages=[size] size.target_psnr=50")
    return out, changes


def test_a_bare_plane_needs_no_hidden_layer(plane):
    out, _ = plane
    found = json.loads((out / "size.json").read_text())
    assert found["choice"] == "lobe + linear"
    assert found["noise_floor"] > 50
    chosen = found["candidates"][0]
    assert (chosen["name"], chosen["depth"], chosen["macs"], chosen["bytes"]) == ("lobe + linear", 0, 6 * 9 + 27, 252)
    full = [record["inputs"] for record in nets(out) if record["inputs"]["train"]["steps"] == 500]
    assert [inputs["model"]["depth"] for inputs in full] == [0]
    assert found["cpu_seconds"] < 0.5 * found["sweep_cpu_seconds"]


def test_what_a_search_leaves(plane):
    out, _ = plane
    for name in ("size.md", "size.png"):
        assert (out / name).stat().st_size > 0
    text = (out / "size.md").read_text()
    assert "Found: lobe + linear" in text
    assert "![PSNR against cost](size.png)" in text
    words = shlex.split(json.loads((out / "size.json").read_text())["command"])
    assert words[:2] == ["prtnet", "scene.path=plane.obj"]
    assert set(words[2:]) == {
        "model.depth=0", "train.encoding=identity", "train.residual=True", "train.grid_cells=[]",
        "train.hash_cells=[]", "train.texel_size=0", "stages=[score]",
    }  # fmt: skip


def test_the_same_search_again_trains_nothing(plane, capsys):
    out, changes = plane
    before = {path: path.stat().st_mtime_ns for path in (out / "cache").rglob("*.*")}
    kept = (out / "size.json").read_bytes()
    run(config(out, **changes), "prtnet scene.path=plane.obj stages=[size] size.target_psnr=50")
    assert {path: path.stat().st_mtime_ns for path in (out / "cache").rglob("*.*")} == before
    assert (out / "size.json").read_bytes() == kept
    assert "chosen" in capsys.readouterr().out


@pytest.mark.parametrize("material", ["diffuse", "glossy"])
def test_the_stages_after_it_go_on_with_the_choice_and_agree(material, tmp_path):
    """Its PSNR, multiply-adds and bytes are those of the table, and the net is the one it has trained."""
    glossy = {"material__diffuse": 0.5, "material__specular": [0.5, 0.25, 0.5]} if material == "glossy" else {}
    changes = {"size__widths": [8, 12], "size__depths": [0, 1], "size__max_bytes": 2500, **glossy}
    run(config(tmp_path, **changes))
    found, trained = json.loads((tmp_path / "size.json").read_text()), len(nets(tmp_path))
    run(config(tmp_path, stages=["size", "score"], **changes))
    assert len(nets(tmp_path)) == trained
    rows = {row.method: row for row in score.read(tmp_path / "score.json")[0] if row.reference == "traced"}
    (chosen,) = (each for each in found["candidates"] if each["verdict"] == "chosen")
    (trial,) = (each for each in found["trials"] if each["candidate"] == chosen["name"] and each["share"] == 1)
    assert rows["net"].psnr == pytest.approx(trial["psnr"], abs=0.05)
    assert rows["net"].psnr_worst == pytest.approx(trial["psnr_worst"], abs=0.05)
    assert rows[score.NOISE_FLOOR].psnr == pytest.approx(found["noise_floor"], abs=1e-6)
    assert (rows["net"].macs, rows["net"].bytes) == (chosen["macs"], chosen["bytes"])
    assert netspec.load(tmp_path / "net.safetensors").residual == (chosen["name"] == "lobe + linear")


def test_grids_and_texels_count_and_show_as_in_the_table(tmp_path):
    """The trial is the NumPy twin at the places in the atlas that pixels show, the table the shader."""
    changes = {"size__widths": [8], "size__depths": [1], "size__max_macs": 10**6, "train__steps": 300}
    made = config(tmp_path, stages=["size", "score"], **changes)
    made.size.grids = ["recipe"]
    made.train.texel_size, made.train.texel_channels = 12, 4
    made.train.grid_cells, made.train.hash_cells, made.train.hash_entries = [[4, 3, 2], [5, 2, 2]], [8], 256
    run(made)
    found = json.loads((tmp_path / "size.json").read_text())
    (chosen,) = found["candidates"]
    (row,) = (row for row in score.read(tmp_path / "score.json")[0] if (row.method, row.reference) == ("net", "traced"))
    assert (row.macs, row.bytes) == (chosen["macs"], chosen["bytes"])
    (trial,) = (each for each in found["trials"] if each["share"] == 1)
    assert row.psnr == pytest.approx(trial["psnr"], abs=0.02)
    assert [each.shape for each in netspec.load(tmp_path / "net.safetensors").texels] == [(12, 12, 4)]


def test_texels_go_with_the_grids(tmp_path):
    made = config(tmp_path, size__widths=[8], size__depths=[0, 1], size__max_macs=10**6, train__texel_size=6)
    made.size.grids = ["none", "dense", "recipe"]
    fit, _ = candidates.space(made, 9, 27)
    found = {each.name: candidates.configured(made, each).train.texel_size for each in fit}
    without = ("lobe + linear", "linear", "8 x 1", "linear + dense grids", "8 x 1 + dense grids")
    assert found == dict.fromkeys(without, 0) | {"linear + grids": 6, "8 x 1 + grids": 6}
    made.train.grid_cells, made.train.hash_cells = [], []
    assert "8 x 1 + grids" in {each.name for each in candidates.space(made, 9, 27)[0]}


def test_a_target_that_no_net_reaches_is_an_error_after_the_report(tmp_path):
    changes = {"size__widths": [8], "size__depths": [0, 1]}
    with pytest.raises(PrtnetError, match="noise floor") as caught:
        run(config(tmp_path, stages=["size", "score"], size__target_psnr=95.0, **changes))
    assert "render.traced_directions" in str(caught.value)
    assert not nets(tmp_path), "nothing is trained for it"
    floor = json.loads((tmp_path / "size.json").read_text())["noise_floor"]
    with pytest.raises(PrtnetError, match=r"none of 3 candidates meets .* the best, .*, reached .* Limit: ") as caught:
        run(config(tmp_path, stages=["size", "score"], size__target_psnr=floor - 0.01, **changes))
    assert str(tmp_path / "size.md") in str(caught.value)
    assert "Found: none." in (tmp_path / "size.md").read_text()
    assert (tmp_path / "size.png").exists()
    for name in ("net.safetensors", "transfer.glsl", "score.json"):
        assert not (tmp_path / name).exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, "neither a target nor a budget"),
        ({"size__target_psnr": -3.0}, "size.target_psnr: found -3"),
        ({"size__max_macs": 0}, "size.max_macs: found 0"),
        ({"size__max_macs": 50}, "found 50, but the cheapest candidate, lobe [+] linear, takes 81"),
        ({"size__max_bytes": 1000, "size__depths": [2]}, "found 1000, but the cheapest candidate, 8 x 2, takes"),
        ({"size__target_psnr": 30.0, "size__widths": []}, "size.widths"),
        ({"size__target_psnr": 30.0, "size__widths": [8, -8]}, r"size.widths: found \[8, -8\]"),
        ({"size__target_psnr": 30.0, "size__depths": []}, "size.depths"),
        ({"size__target_psnr": 30.0, "size__depths": [-1]}, "size.depths"),
        ({"size__target_psnr": 30.0, "size__view": "best"}, "size.view: found 'best', expected one of mean, worst"),
        ({"size__target_psnr": 30.0, "size__cost": "time"}, "size.cost: found 'time', expected one of macs, bytes"),
        (
            {"size__target_psnr": 30.0, "size__widths": [2000], "size__depths": [2], "export__storage": "literal"},
            "too large to export",
        ),
        ({"size__target_psnr": 30.0, "methods": ["texture"]}, "expected net or clusters among them"),
    ],
)
def test_bad_words_are_refused_before_any_work(changes, message, tmp_path):
    with pytest.raises(PrtnetError, match=message):
        run(config(tmp_path, **changes))
    assert not (tmp_path / "cache").exists()


def test_networks_too_large_to_export_are_left_out(tmp_path, caplog):
    changes = {"size__widths": [8, 2000], "size__depths": [2], "size__max_macs": 10**9, "export__storage": "literal"}
    caplog.set_level("INFO")
    run(config(tmp_path, **changes))
    assert "size: 2000 x 2 is too large to export as literals, and left out" in caplog.text
    assert json.loads((tmp_path / "size.json").read_text())["choice"] == "8 x 2"
