"""Nets drawn on the CPU, from the bake to the report."""

import pytest

from prtnet import netspec, score
from prtnet.pipeline import drawn_by, run
from prtnet.pipeline.drawn_by import DEFERRED, SHADER
from tests.nets import random_net
from tests.pipeline.test_pipeline import artifacts, config

WIDE = {"model__width": 600, "model__depth": 2, "train__steps": 3, "train__batch": 64}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run with a shader."""
    out = tmp_path_factory.mktemp("run")
    run(config(out))
    return out


def net_row(out, reference="traced"):
    (row,) = (row for row in score.read(out / "score.json")[0] if (row.method, row.reference) == ("net", reference))
    return row


def test_a_net_too_large_for_literals_is_scored_and_reported(finished):
    """Its shader has a weight texture, and the CPU draws it."""
    out = finished / "wide"
    run(config(out, cache=str(finished / "cache"), **WIDE))
    assert (out / "transfer_weights.bin").exists()
    net, row = netspec.load(out / "net.safetensors"), net_row(out)
    assert (row.macs, row.bytes) == (netspec.macs(net) + 27, netspec.byte_count(net))
    assert (row.ms or 0) > 0
    assert (row.psnr or 0) > 5
    assert net_row(out, "texture").psnr
    assert "the CPU, from the G-buffer" in (out / "card.md").read_text()


@pytest.mark.parametrize(("transport", "specular"), [("shadowed", 0.0), ("interreflected", 0.5)])
def test_the_scores_are_those_of_the_shader(finished, transport, specular):
    found = {}
    changes = {"transfer__transport": transport, "material__specular": [specular] * 3, "methods": ["texture", "net"]}
    for name in (SHADER, DEFERRED):
        out = finished / f"{name}_{transport}_{specular}"
        run(config(out, cache=str(finished / "cache"), render__net=name, **changes))
        found[name] = net_row(out)
        assert (out / "transfer.glsl").exists()
    assert found[SHADER].psnr == pytest.approx(found[DEFERRED].psnr, abs=2e-3)
    assert (found[SHADER].macs, found[SHADER].bytes) == (found[DEFERRED].macs, found[DEFERRED].bytes)


def test_the_choice_is_part_of_what_a_score_is_kept_under(finished):
    """A shader that auto finds is the one that is asked for."""
    before = artifacts(finished, "score")
    run(config(finished, render__net=SHADER))
    assert artifacts(finished, "score") == before
    run(config(finished, render__net=DEFERRED))
    assert len(artifacts(finished, "score")) == len(before) + 1


def test_auto_takes_the_shader_of_what_fits_into_literals():
    small, large = random_net(), random_net(width=400)
    assert [drawn_by.chosen(wanted, small) for wanted in ("auto", SHADER, DEFERRED)] == [SHADER, SHADER, DEFERRED]
    assert [drawn_by.chosen(wanted, large) for wanted in ("auto", SHADER, DEFERRED)] == [DEFERRED, SHADER, DEFERRED]
