"""What a user gets from a run: files, keyed stages, resumption."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

from prtnet import PrtnetError, netspec, score, sh, store
from prtnet.config import Config
from prtnet.export import gloss, vertices
from prtnet.pipeline import run
from tests.small import SETTINGS, overrides


def config(out: Path, **changes: object) -> Config:
    made = Config(out=str(out))
    for name, value in (SETTINGS | {key.replace("__", "."): value for key, value in changes.items()}).items():
        group, _, key = name.rpartition(".")
        setattr(getattr(made, group) if group else made, key, value)
    return made


def artifacts(out: Path, stage: str) -> dict[str, float]:
    """File name -> time of writing."""
    return {path.name: path.stat().st_mtime_ns for path in (out / "cache" / stage).glob("*.safetensors")}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("run")
    run(config(out), "prtnet scene=cornell")
    return out


def test_a_run_leaves_everything_in_its_folder(finished):
    for name in (
        "net.safetensors",
        "transfer.glsl",
        "transfer.frag",
        "transfer_texture.exr",
        "transfer_vertices.safetensors",
        "transfer_vertices.glb",
        "certificate.json",
        "score.json",
        "card.md",
        "report.html",
        "contact_sheet.png",
        "chart.png",
        "lobes.png",
        "config.yaml",
    ):
        assert (finished / name).stat().st_size > 0, name
    assert list((finished / "tensorboard").glob("events.*"))


def test_rows_say_what_was_compared(finished):
    rows, versions = score.read(finished / "score.json")
    found = {(row.method, row.reference) for row in rows}
    traced = {(name, "traced") for name in ("texture", "vertex", "net", score.NOISE_FLOOR)}
    assert found == traced | {("net", "texture")}
    by_method = {row.method: row for row in rows if row.reference == "traced"}
    assert by_method["texture"].ms_ratio == 1.0
    assert by_method["net"].macs == netspec.macs(netspec.load(finished / "net.safetensors")) + 27
    count = len(vertices.read(finished / "transfer_vertices.safetensors").positions)
    assert by_method["vertex"].bytes == count * 3 * 16
    assert (by_method["vertex"].macs or 0) > 9 + count * 27 // 32**2
    assert (by_method["vertex"].bake_seconds or 0) > 0
    assert all(row.psnr is not None and row.psnr > 10 for row in rows)
    assert versions["torch"]


@pytest.mark.parametrize(("product", "macs"), [("fixed_light", 81 + 3 * 45), ("full", None)])
def test_gloss_is_scored_from_the_same_bake(finished, product, macs):
    """The rows are of the material; net and texture differ from `traced` no more than their transfer does."""
    before = artifacts(finished, "net") | artifacts(finished, "texture") | artifacts(finished, "traced")
    out = finished / f"glossy_{product}"
    glossy = {"diffuse": 0.5, "specular": [0.5, 0.25, 0.5], "exponent": 12.0, "product": product}
    changes = {f"material__{key}": value for key, value in glossy.items()}
    run(config(out, cache=str(finished / "cache"), **changes))
    rows, _ = score.read(out / "score.json")
    assert {row.material for row in rows} == {"glossy full" if product == "full" else "glossy"}
    assert {row.material for row in score.read(finished / "score.json")[0]} == {"diffuse"}
    by_method = {row.method: row for row in rows if row.reference == "traced"}
    assert by_method.keys() == {"texture", "vertex", "net", score.NOISE_FLOOR}
    # the lobe at the vertices costs, too
    plain = {row.method: row for row in score.read(finished / "score.json")[0]}
    assert (by_method["vertex"].macs or 0) > (plain["vertex"].macs or 0) + 9
    added = (by_method["texture"].macs or 0) - score.fetch_macs(9, "bilinear") - score.diffuse_macs(9)
    assert added == (macs or gloss.macs(3, "full"))
    assert all(row.psnr is not None and row.psnr > 10 for row in rows)
    assert "specular 0.5, 0.25, 0.5, exponent 12" in (out / "card.md").read_text()
    # nothing is traced or trained again for another material
    assert artifacts(finished, "net") | artifacts(finished, "texture") | artifacts(finished, "traced") == before


def test_the_shader_error_is_on_record(finished):
    record = json.loads((finished / "certificate.json").read_text())
    assert 0 < record["errors"]["coefficients"]["max"] <= 1e-5


def test_the_net_file_agrees_with_the_shader_function(finished):
    net = netspec.load(finished / "net.safetensors")
    points = np.zeros((3, 3)) + net.centre
    values = netspec.evaluate(net, points, np.array([[0, 1.0, 0]] * 3))
    assert values.shape == (3, 9)
    assert "void prt_transfer" in (finished / "transfer.glsl").read_text()


def test_the_same_command_again_only_prints(finished, capsys):
    before = {path: path.stat().st_mtime_ns for path in finished.rglob("*") if path.is_file()}
    run(config(finished), "prtnet scene=cornell")
    printed = capsys.readouterr().out
    assert "texture" in printed
    assert str(finished / "report.html") in printed
    after = {path: path.stat().st_mtime_ns for path in finished.rglob("*") if path.is_file()}
    # the shader and the configuration are written anew with the same bytes; nothing is computed
    kept = {path for path in before if "cache" in path.parts or path.suffix in (".png", ".html", ".exr")}
    assert {path: before[path] for path in kept} == {path: after[path] for path in kept}
    assert before.keys() == after.keys()


def test_another_width_keeps_the_bake(finished):
    stages = ("training", "texture", "vertex", "traced", "atlas", "net")
    before = {stage: artifacts(finished, stage) for stage in stages}
    run(config(finished, model__width=12))
    for stage in stages[:-1]:
        assert artifacts(finished, stage) == before[stage]
    assert len(artifacts(finished, "net")) == len(before["net"]) + 1
    run(config(finished))


def test_texels_keep_the_bake_and_belong_to_an_atlas(finished):
    stages = ("training", "areas", "vertices", "texture", "vertex", "traced", "atlas")
    before = {stage: artifacts(finished, stage) for stage in (*stages, "net")}
    out, cache = finished / "texels", str(finished / "cache")
    run(config(out, cache=cache, train__texel_size=8))
    assert {stage: artifacts(finished, stage) for stage in stages} == {stage: before[stage] for stage in stages}
    assert json.loads((out / "certificate.json").read_text())["errors"]["coefficients"]["max"] <= 1e-5
    assert "vec2 uv, out vec4 t0" in (out / "transfer.glsl").read_text()
    with_texels = artifacts(finished, "net")
    assert len(with_texels) == len(before["net"]) + 1
    # another atlas is another net with texels, and none without
    run(config(out, cache=cache, stages=["train"], atlas__size=48))
    assert artifacts(finished, "net") == with_texels
    run(config(out, cache=cache, stages=["train"], atlas__size=48, train__texel_size=8))
    assert len(artifacts(finished, "net")) == len(with_texels) + 1
    # of a net without, the key is what it was before there were texels
    records = [json.loads(path.read_text())["inputs"] for path in (finished / "cache" / "net").glob("*.json")]
    for inputs in records:
        assert ("atlas" in inputs) == ("texel_size" in inputs["train"]) == ("texel_channels" in inputs["train"])


def test_texels_need_one_atlas_for_the_whole_scene(tmp_path):
    with pytest.raises(
        PrtnetError, match=r"train\.texel_size: found 8 with atlas\.sets=parts, expected atlas\.sets=one"
    ):
        run(config(tmp_path, train__texel_size=8, atlas__sets="parts"))
    assert not list(tmp_path.iterdir())


def test_another_mesh_for_the_vertices_keeps_the_rest(finished):
    stages = ("training", "texture", "traced", "atlas", "net")
    before = {stage: artifacts(finished, stage) for stage in (*stages, "vertex", "score")}
    coarse = vertices.read(finished / "transfer_vertices.safetensors")
    # a level alone cuts nothing
    run(config(finished, vertex__level=2))
    assert artifacts(finished, "score") == before["score"]
    run(config(finished, vertex__subdivide=["floor"], vertex__level=2))
    fine = vertices.read(finished / "transfer_vertices.safetensors")
    floor = np.count_nonzero(coarse.part == coarse.parts.index("floor"))
    assert len(fine.faces) == len(coarse.faces) + 15 * floor
    assert {stage: artifacts(finished, stage) for stage in stages} == {stage: before[stage] for stage in stages}
    assert len(artifacts(finished, "vertex")) == len(before["vertex"]) + 1
    assert len(artifacts(finished, "score")) == len(before["score"]) + 1
    run(config(finished))


def test_unshadowed_transfer_is_the_lobe_and_is_held_against_the_truth(finished):
    before = {stage: artifacts(finished, stage) for stage in ("training", "texture", "vertex", "traced")}
    run(config(finished, methods=["texture", "vertex"], transfer__transport="unshadowed"))
    plain = vertices.read(finished / "transfer_vertices.safetensors")
    np.testing.assert_array_equal(plain.transfer, sh.cosine_lobe(plain.normals, 3))
    assert {stage: artifacts(finished, stage) for stage in before} == before
    rows, _ = score.read(finished / "score.json")
    assert all((row.psnr or 0) < 35 for row in rows if not row.is_noise_floor)
    run(config(finished))


def test_light_between_surfaces_reaches_every_method(finished):
    """Each method agrees with `traced` about as well as without bounces, and the picture is brighter."""
    before = {stage: artifacts(finished, stage) for stage in ("training", "texture", "vertex", "traced")}
    plain, _ = score.read(finished / "score.json")
    run(config(finished, transfer__transport="interreflected", transfer__bounces=2))
    assert {stage: artifacts(finished, stage) for stage in before} == before
    rows, _ = score.read(finished / "score.json")
    dark, bright = ({row.method: row for row in each if row.reference == "traced"} for each in (plain, rows))
    for method in ("texture", "vertex", "net"):
        assert (bright[method].psnr or 0) > (dark[method].psnr or 0) - 4, method
    assert bright["texture"].bytes == 64 * 64 * 9 * 16
    file = vertices.read(finished / "transfer_vertices.safetensors")
    assert (file.kind, file.groups, file.bands) == ("interreflected", 4, 3)
    direct, red = file.transfer[:, :9], file.transfer[:, 9:18]
    assert np.mean(red[:, 0] - direct[:, 0]) > 0.02
    net = netspec.load(finished / "net.safetensors")
    assert (net.groups, net.bands) == (4, 3)
    run(config(finished, transfer__transport="interreflected", transfer__bounces=1, methods=["texture", "vertex"]))
    once = vertices.read(finished / "transfer_vertices.safetensors").transfer
    assert np.mean(file.transfer[:, 9] - once[:, 9]) > 0.005
    run(config(finished))


def test_a_truncated_artifact_is_made_again(finished, caplog):
    path = next((finished / "cache" / "training").glob("*.safetensors"))
    whole = path.read_bytes()
    path.write_bytes(whole[:-100])
    run(config(finished, stages=["bake"]))
    assert "made again" in caplog.text
    assert path.read_bytes() == whole


def test_stages_stop_where_they_are_told(tmp_path):
    run(config(tmp_path, stages=["bake"]))
    assert artifacts(tmp_path, "training")
    assert not artifacts(tmp_path, "net")
    assert not (tmp_path / "score.json").exists()


def killed(arguments: list[str], out: Path, ready: str) -> None:
    """Run a job and kill it, -9, as soon as a file in its folder matches the pattern `ready`."""
    process = subprocess.Popen([sys.executable, "-m", "prtnet", *arguments], stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not list(out.glob(ready)):
        assert process.poll() is None, "ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()


@pytest.mark.parametrize(
    ("changes", "ready"),
    [
        ({"samples__count": 300_000, "transfer__directions": 1024}, "cache/training/*.shards/*.json"),
        (
            {"vertex__subdivide": ["floor"], "vertex__level": 6, "transfer__directions": 2816},
            "cache/vertex/*.shards/*.json",
        ),
        ({"train__steps": 3000, "train__checkpoint_seconds": 0.05}, "cache/net/*.checkpoint.safetensors"),
    ],
    ids=["bake", "vertex", "train"],
)
def test_a_killed_run_goes_on_to_the_same_bytes(tmp_path, changes, ready):
    last = "train" if "train__steps" in changes else "bake"
    interrupted, whole = tmp_path / "interrupted", tmp_path / "whole"
    arguments = overrides(interrupted, stages=f"[{last}]", **changes)
    killed(arguments, interrupted, ready)
    for out in (interrupted, whole):
        run(config(out, stages=[last], **changes))
    stages = ["training", "areas", "texture", "vertex"] + ["net"] * (last == "train")
    for stage in stages:
        for name in artifacts(whole, stage):
            same = (store.file_digest(out / "cache" / stage / name) for out in (interrupted, whole))
            assert len(set(same)) == 1, f"{stage}/{name}"
            assert name in artifacts(interrupted, stage)
    assert not list(interrupted.rglob("*.tmp"))


@pytest.mark.parametrize(("scale", "offset"), [(1e-3, 0.0), (1e6, 0.0), (1.0, 1e4)])
def test_the_same_mesh_scaled_and_moved_gives_the_same_picture(tmp_path, scale, offset):
    box, ball = trimesh.creation.box((2, 0.2, 2)), trimesh.creation.icosphere(2, 0.4)
    ball.apply_translation((0.2, 0.6, 0.1))
    mesh = trimesh.util.concatenate([box, ball])
    pictures = []
    for name, factor, move in (("plain", 1.0, 0.0), ("moved", scale, offset)):
        path = tmp_path / f"{name}.obj"
        vertices = np.asarray(mesh.vertices) * factor + move
        lines = [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in vertices]
        path.write_text("\n".join(lines + [f"f {a} {b} {c}" for a, b, c in np.asarray(mesh.faces) + 1]) + "\n")
        run(config(tmp_path / name, scene__path=str(path), render__traced_directions=1024, train__steps=300))
        kept = next((tmp_path / name / "cache" / "score").glob("*.safetensors"))
        pictures.append(store.load_arrays(kept))
    for method in ("traced", "texture", "net"):
        difference = pictures[0][method].astype(np.float32) - pictures[1][method]
        assert np.sqrt(np.mean(difference**2)) < 0.01, method


def test_without_a_net_nothing_is_trained(tmp_path):
    run(config(tmp_path, methods=["texture", "vertex"]))
    rows, _ = score.read(tmp_path / "score.json")
    assert {row.method for row in rows} == {"texture", "vertex", score.NOISE_FLOOR}
    assert not (tmp_path / "net.safetensors").exists()
    assert not (tmp_path / "cache" / "training").exists()
    assert "net.safetensors" not in (tmp_path / "card.md").read_text()


@pytest.mark.parametrize("methods", [["net"], ["texture", "voxels"]])
def test_methods_are_checked(tmp_path, methods):
    with pytest.raises(PrtnetError, match=r"methods: found .*, expected texture and some of vertex, net"):
        run(config(tmp_path, methods=methods))


def test_gloss_mirrors_light_between_surfaces_that_was_baked_under_the_light(tmp_path):
    """The texture for any light has no gloss of what other surfaces send; the one under this light has."""
    changes = {
        "methods": ["texture", "lit_texture"],
        "scene__camera": "inside",
        "transfer__transport": "interreflected",
        "material__specular": [0.5, 0.5, 0.5],
        "material__exponent": 4.0,
        "atlas__size": 128,
        "transfer__directions": 256,
        "render__traced_directions": 1024,
    }
    run(config(tmp_path, **changes))
    rows, _ = score.read(tmp_path / "score.json")
    psnr = {row.method: row.psnr or 0 for row in rows}
    assert psnr["lit_texture"] > psnr["texture"] + 1
    run(config(tmp_path, **changes | {"material__specular": [0.0, 0.0, 0.0]}))
    rows, _ = score.read(tmp_path / "score.json")
    by_method = {row.method: row for row in rows}
    assert abs((by_method["lit_texture"].psnr or 0) - (by_method["texture"].psnr or 0)) < 1.5
    assert (by_method["lit_texture"].bytes or 0) < (by_method["texture"].bytes or 0) / 2


def test_lit_textures_need_light_between_surfaces(tmp_path):
    with pytest.raises(PrtnetError, match=r"lit_texture.*expected transfer\.transport=interreflected"):
        run(config(tmp_path, methods=["texture", "lit_texture"]))


LARGE = {"model__width": 200, "model__depth": 4, "export__storage": "literal"}


@pytest.mark.parametrize("changes", [LARGE, {"render__net": "cuda"}, {"train__grid_cells": [[8, 8]]}])
def test_a_net_that_cannot_be_exported_is_refused_before_any_work(tmp_path, changes):
    expected = r"padded multiply-adds, expected at most 60000|render.net: found 'cuda'|train.grid_cells: found"
    with pytest.raises(PrtnetError, match=expected):
        run(config(tmp_path, **changes))
    assert not list(tmp_path.iterdir())
