"""The page of a run of data-driven transfer: its lights, its view, its certificate, and when there is none."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data import texture
from prtnet.data.lighting import direct
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.surface import texel_albedo
from prtnet.export import browser
from prtnet.export.web_data_driven import PageLamp
from prtnet.export.web_frame import Certificate
from prtnet.pipeline.data_driven import page
from prtnet.pipeline.job import open_job
from prtnet.render.camera import Camera
from tests.export.driven_pages import LAMPS, SIDE, by_rays, made
from tests.pipeline.test_pipeline import config
from tests.pipeline.test_web import about

GOOD = {"coefficients": 1e-7, "texels": 1e-4, "direct": 0.01, "shown": 0.01}
ENVIRONMENT = Lighting((), np.ones((9, 3), np.float32))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A job with a made-up operator of its scene, and an atlas."""
    job = open_job(config(tmp_path_factory.mktemp("run"), methods=["data_driven"]), "", None)
    small = made()
    return job, replace(small.spec, scene=job.scene.digest()), small.atlas


@pytest.fixture
def no_browser(monkeypatch):
    monkeypatch.setattr(browser, "find", lambda: None)


def lit(*lamps):
    return [Lighting((lamp,)) for lamp in lamps]


def test_a_run_gets_a_page(run, no_browser):
    job, spec, atlas = run
    point, spot, sun = LAMPS
    lightings = [*lit(point, point), Lighting((point, spot)), ENVIRONMENT, *lit(spot, sun, *[spot] * 4)]
    lightmaps = np.random.default_rng(0).random((len(lightings), len(spec.texels), 3), np.float32)
    path = page.write_page(job, spec, atlas, lightings, lightmaps)
    assert path == job.out / "data_driven.html"
    found = about(path)
    # one lamp each, of each kind in turns
    kinds = ["point", "spot", "directional", "point", "spot", "spot"]
    assert [light["lamp"]["kind"] for light in found["lights"]] == kinds
    assert [light["reference"] for light in found["lights"]] == list(range(6))
    assert found["certificate"] is None
    assert "found no Chromium" in found["unmeasured"]
    # exposed so that all but a twentieth of the texels have a colour
    texels = texture.gbuffer(atlas, SIDE)
    received = direct.irradiance(
        lightings[0], job.tracer, texels.positions, texels.normals, texels.geometric_normals
    ) + lightmaps[0]  # fmt: skip
    shown = found["lights"][0]["exposure"] * (texel_albedo(atlas, [texels]) / np.pi * received).max(axis=1)
    assert (shown > 0.9).mean() == pytest.approx(0.05, abs=0.005)


def test_a_database_without_lamps_has_a_page_with_one(run, no_browser):
    job, spec, atlas = run
    found = about(page.write_page(job, spec, atlas, [ENVIRONMENT]))
    assert [light["name"] for light in found["lights"]] == ["directional"]
    assert found["lights"][0]["reference"] is None
    assert "nothing to compare with" in (job.out / page.NAME).read_text(encoding="utf-8")


def test_the_basis_of_another_scene_is_refused(run, no_browser):
    job, spec, atlas = run
    (job.out / page.NAME).write_text("of an earlier run")
    with pytest.raises(PrtnetError, match="of another scene than cornell"):
        page.write_page(job, replace(spec, scene="elsewhere"), atlas, lit(*LAMPS))
    assert not (job.out / page.NAME).exists()


@pytest.mark.parametrize(
    ("name", "error"), [("coefficients", 1e-3), ("texels", 0.01), ("direct", 0.9), ("texels", np.nan)]
)
def test_a_browser_that_computes_something_else_gets_no_page(run, monkeypatch, name, error):
    job, spec, atlas = run
    wrong = Certificate({"errors": GOOD | {name: error}})
    monkeypatch.setattr(page, "measured", lambda *_: wrong)
    with pytest.raises(PrtnetError, match=f"{name}: found the browser .* no page was written"):
        page.write_page(job, spec, atlas, lit(*LAMPS))
    assert not (job.out / page.NAME).exists()


def test_the_view_is_of_what_is_lit(run):
    job, spec, _ = run
    back, front = (Camera((0.1, 0.2, z), (0.0, 0.0, 0.0)) for z in (-3.5, 3.5))
    lights = [PageLamp("", LAMPS[0], 1.0, direct=by_rays(job.tracer, spec.measurements[0], LAMPS[0]))]
    for cameras in ([back, front], [front, back]):
        assert page._clearest(cameras, spec.measurements[0], job.tracer, lights) is front


@pytest.mark.skipif(browser.find() is None, reason="needs Chromium: apt-get install chromium")
def test_the_certificate_is_what_chromium_finds(run):
    job, spec, atlas = run
    found = about(page.write_page(job, spec, atlas, lit(*LAMPS)))["certificate"]
    assert 0 < found["errors"]["texels"] < page.BOUNDS["texels"]
    assert 0 < found["errors"]["coefficients"] < page.BOUNDS["coefficients"]
    assert 0 < found["errors"]["direct"] < 0.03
    assert found["lights"] == 3
    assert min(found[f"{name}_ms"] for name in ("direct", "both", "lamp")) > 0
    assert "SwiftShader" in found["device"]
