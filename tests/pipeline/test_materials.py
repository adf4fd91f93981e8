"""Materials of a run: parts, roughness of the file, orders that differ; what cannot be, before any work."""

import numpy as np
import pytest
import trimesh

from prtnet import PrtnetError, score
from prtnet.export import gloss
from prtnet.pipeline import run
from tests.pipeline.test_pipeline import artifacts, config

METHODS = ["texture", "vertex"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("run")
    run(config(out, methods=METHODS))
    return out


def test_parts_and_orders_are_scored_from_the_same_bake(finished):
    before = artifacts(finished, "texture") | artifacts(finished, "vertex") | artifacts(finished, "traced")
    out, parts = (
        finished / "parts",
        {"floor": {"specular": [0.5, 0.5, 0.5], "exponent": 6}, "ceiling": {"diffuse": 0.5}},
    )
    changes = {"material__parts": parts, "material__light_bands": 4, "material__radiance_bands": 5}
    run(config(out, cache=str(finished / "cache"), methods=METHODS, **changes))
    rows, _ = score.read(out / "score.json")
    assert {row.material for row in rows} == {"glossy"}
    by_method = {row.method: row for row in rows if row.reference == "traced"}
    assert by_method["texture"].macs == 4 * 9 + score.diffuse_macs(9) + gloss.macs(3, "fixed_light", 4, 5)
    assert all(row.psnr is not None and row.psnr > 10 for row in rows)
    assert "floor: specular 0.5, 0.5, 0.5, exponent 6; ceiling: diffuse 0.5" in (out / "card.md").read_text()
    assert artifacts(finished, "texture") | artifacts(finished, "vertex") | artifacts(finished, "traced") == before


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"material__parts": {"roof": {"exponent": 5.0}}}, r"material\.parts: found roof, expected some of .*floor"),
        ({"material__parts": {"floor": {"exponent": 0}}}, r"material\.parts\.floor\.exponent: found 0\.0"),
        ({"material__roughness": "file"}, r"material\.roughness: found file, but cornell has no roughness"),
        ({"material__radiance_bands": 6}, r"radiance_bands: found 6 bands of radiance, expected at most 5"),
        (
            {"material__light_bands": 9, "material__exponent": 5.0, "material__specular": [1, 1, 1]},
            r"light_bands: found 9",
        ),
    ],
)
def test_materials_that_cannot_be_leave_nothing(tmp_path, changes, message):
    with pytest.raises(PrtnetError, match=message):
        run(config(tmp_path / "out", **changes))
    assert not (tmp_path / "out").exists()


def test_roughness_of_a_file_is_scored(tmp_path):
    """By every method, and with other figures than one exponent for all."""
    mesh = trimesh.creation.icosphere(3)
    mesh.vertex_attributes["roughness"] = np.where(mesh.vertices[:, 1] > 0, 0.4, 0.9).astype(np.float32)
    mesh.export(tmp_path / "ball.ply")
    found = {}
    for rule in ("config", "file"):
        changes = {"scene__path": str(tmp_path / "ball.ply"), "material__specular": [0.5, 0.5, 0.5]}
        out = tmp_path / rule
        run(config(out, cache=str(tmp_path / "cache"), methods=METHODS, **changes, material__roughness=rule))
        found[rule] = {row.method: row.psnr for row in score.read(out / "score.json")[0]}
        assert ("by the file's roughness" in (out / "card.md").read_text()) == (rule == "file")
    assert all((psnr or 0) > 20 for rule in found.values() for psnr in rule.values())
    assert found["config"] != found["file"]
