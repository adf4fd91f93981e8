"""Jobs on implicit surfaces: from a description to a report, without triangles of their own."""

import numpy as np
import pytest

from prtnet import PrtnetError, score
from prtnet.pipeline import run
from prtnet.pipeline.job import open_job
from tests.pipeline.test_pipeline import config

BALL = """
bounds: [[-1.1, -0.8, -1.1], [1.1, 0.8, 1.1]]
parts:
  plate: {albedo: [0.6, 0.6, 0.6], box: [1, 0.1, 1], moved: [0, -0.5, 0]}
  ball: {albedo: [0.8, 0.3, 0.2], sphere: 0.4}
"""


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    path = tmp_path_factory.mktemp("described") / "ball.yaml"
    path.write_text(BALL)
    return path


@pytest.fixture(scope="module")
def finished(tmp_path_factory, described):
    out = tmp_path_factory.mktemp("implicit")
    run(settings(out, described, transfer__tracer="fused"))
    return out


def settings(out, described, **changes):
    return config(out, scene__path=str(described), sdf__resolution=48, train__steps=600, **changes)


def test_a_report_without_an_atlas(finished):
    rows, _ = score.read(finished / "score.json")
    assert {row.method for row in rows if row.reference == "traced"} == {"unshadowed", "net", score.NOISE_FLOOR}
    by_name = {row.method: row for row in rows}
    # shadows are what a network adds
    assert by_name["net"].psnr > by_name["unshadowed"].psnr + 2
    assert by_name["unshadowed"].ms_ratio == 1
    for name in ("report.html", "contact_sheet.png", "net.safetensors", "transfer.glsl"):
        assert (finished / name).exists()
    assert not (finished / "transfer_texture.exr").exists()


def test_the_quick_way_is_held_against_the_surface(finished):
    assert "against the surface itself" in (finished / "report.html").read_text()


def test_rays_through_the_surface_itself(finished, described, tmp_path):
    quick = open_job(settings(tmp_path / "a", described, transfer__tracer="fused"), "", None)
    itself = open_job(settings(tmp_path / "b", described), "", None)
    assert quick.training_tracer.kind != itself.training_tracer.kind == quick.reference_tracer.kind == "marched"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"methods": ["texture", "net"]}, r"methods: found .*texture.*, expected unshadowed and some of net"),
        (
            {"transfer__transport": "interreflected"},
            "transfer.transport: found interreflected on an implicit",
        ),
        ({"train__texel_size": 8}, "train.texel_size: found 8 on an implicit surface"),
        ({"render__exact_samples": 8}, "render.exact_samples: found 8 on an implicit surface"),
        ({"export__lightmap": True}, "export.lightmap: found True on an implicit surface"),
    ],
)
def test_what_needs_triangles_is_refused(tmp_path, described, changes, words):
    with pytest.raises(PrtnetError, match=words):
        run(settings(tmp_path, described, **changes))


def test_marching_needs_a_surface(tmp_path):
    with pytest.raises(PrtnetError, match=r"transfer.tracer: found marched on triangles"):
        run(config(tmp_path, transfer__tracer="marched"))


def test_points_lie_on_the_surface(finished, described, tmp_path):
    job = open_job(settings(tmp_path, described), "", None)
    assert job.implicit is not None
    assert np.abs(job.implicit.field.distance(job.scene.vertices)).max() < 1e-5
