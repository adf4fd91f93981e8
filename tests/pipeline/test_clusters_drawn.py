"""Method clusters from its export to its scores."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from prtnet import PrtnetError, clusters, netspec, score
from prtnet.export import certificate, cuda_host
from prtnet.pipeline import run
from prtnet.render import verify
from tests.pipeline.test_clusters import config

SMALL = {"split__delta": 0.1, "model__width": 4}  # two clusters


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("drawn")
    run(config(out, stages=["score"], **SMALL))
    return out


def again(drawn: Path, out: Path, **changes: object) -> Path:
    """With what the first run has kept."""
    run(config(out, **({"stages": ["score"], "cache": str(drawn / "cache")} | SMALL | changes)))
    return out


def row(out: Path) -> score.Row:
    rows, _ = score.read(out / "score.json")
    return next(each for each in rows if (each.method, each.reference) == ("clusters", "traced"))


def test_a_row_counts_what_is_evaluated(drawn):
    made, spec = row(drawn), clusters.load(drawn / "clusters")
    assert made.bytes == sum(netspec.byte_count(net) for net in spec.nets)
    assert made.train_seconds > 0
    # one net at most pixels, two near borders, and the shading
    one = netspec.macs(spec.nets[0])
    assert one < made.macs - score.diffuse_macs(9) < 2 * one


def test_seams_of_all_methods_stand_beside_the_scores(drawn):
    found = json.loads((drawn / "score.json").read_text())["seams"]
    assert set(found) == {"texture", "clusters"}
    for each in found.values():
        assert all(border["ratio"] > 0 for border in each["borders"])
    assert "seams of clusters" in (drawn / "card.md").read_text()
    shape = np.asarray(Image.open(drawn / "clusters.png")).shape
    assert shape == (32, 64, 3)


def test_the_certificate_knows_every_shader(drawn):
    folder = drawn / "clusters"
    facts = certificate.check(folder)
    names = {f"coefficients of {index:02d}" for index in range(2)} | {"weights"}
    assert set(facts["errors"]) == names
    assert all(each["max"] <= each["bound"] for each in facts["errors"].values())
    assert {"clusters.json", "clusters.glsl", "net_01.safetensors", "transfer_01.glsl"} <= set(facts["files"])
    (folder / "transfer_01.glsl").write_text("")
    with pytest.raises(PrtnetError, match=r"transfer_01.glsl: found other bytes"):
        certificate.check(folder)


def test_one_program_and_the_cpu_draw_the_same(drawn, tmp_path):
    expected = row(drawn)
    for name, changes in (("fragment", {"split__select": "fragment"}), ("cpu", {"render__net": "deferred"})):
        found = row(again(drawn, tmp_path / name, **changes))
        assert found.psnr == pytest.approx(expected.psnr, abs=0.01)
        assert found.macs == expected.macs
    facts = certificate.check(tmp_path / "fragment" / "clusters")
    assert "coefficients of all in one" in facts["errors"]
    assert {"stack.glsl", "stack.bin"} <= set(facts["files"])


def test_assigned_triangles_run_one_net_each(drawn, tmp_path):
    made = row(again(drawn, tmp_path, split__border="assign"))
    spec = clusters.load(tmp_path / "clusters")
    assert made.macs - score.diffuse_macs(9) == netspec.macs(spec.nets[0])


def test_a_shader_that_is_wrong_leaves_nothing(drawn, tmp_path, monkeypatch):
    shutil.copytree(drawn / "clusters", tmp_path / "clusters")
    monkeypatch.setattr(verify, "TOLERANCE", 0.0)
    with pytest.raises(PrtnetError, match=r"export: coefficients of 00: found an error of .*; nothing was exported"):
        again(drawn, tmp_path, stages=["export"], export__precision="float16")
    assert not [path.name for path in (tmp_path / "clusters").iterdir() if path.is_file()]


def test_kernels_are_written_and_measured(drawn, tmp_path):
    again(drawn, tmp_path, stages=["export"], export__cuda=True)
    facts = certificate.check(tmp_path / "clusters")
    assert len(facts["cuda"]) == 2
    assert {"00/transfer.cu", "01/transfer_cuda.bin"} <= set(facts["files"])
    if cuda_host.compiler():
        assert all(each["errors"]["coefficients"]["max"] <= verify.TOLERANCE for each in facts["cuda"])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"export__storage": "ubo"}, r"export.storage: found ubo with the method clusters, expected"),
        ({"split__by": "parts", "split__select": "fragment"}, r"split.select: found fragment with split.by=parts"),
    ],
)
def test_what_cannot_be_drawn_is_refused_before_any_work(changes, message, tmp_path):
    with pytest.raises(PrtnetError, match=message):
        run(config(tmp_path, stages=["export"], **changes))
    assert not (tmp_path / "cache").exists()
