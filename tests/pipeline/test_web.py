"""The page of a run: its texture, its lights, its certificate, and when there is none."""

import base64
import json
import re

import numpy as np
import pytest

from prtnet import PrtnetError, score
from prtnet.export import browser, glsl, packing
from prtnet.export.web import Certificate
from prtnet.pipeline import web
from prtnet.pipeline.bake import Baked, bake
from prtnet.pipeline.job import open_job
from prtnet.pipeline.train import Trained, train
from prtnet.pipeline.views import cameras_of, drawing_of
from prtnet.render import camera
from prtnet.render.method import NetMethod
from prtnet.render.raster import Raster
from tests.nets import random_net
from tests.pipeline.test_pipeline import config


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A job with what stages bake and train make of it."""
    job = open_job(config(tmp_path_factory.mktemp("run"), methods=["texture", "net"]), "", None)
    baked = bake(job)
    assert baked.points
    return job, baked, train(job, baked.points)


@pytest.fixture
def no_browser(monkeypatch):
    monkeypatch.setattr(browser, "find", lambda: None)


def about(path):
    return json.loads(re.search(r'id="about">(.*?)</script>', path.read_text(encoding="utf-8"))[1])


def block(path, name):
    """An array of a page."""
    said = about(path)["blocks"][name]
    data = re.search(rf'id="data-{name}">(.*?)</script>', path.read_text(encoding="utf-8"))[1]
    return packing.unpack(packing.Block(base64.b64decode(data), said["kind"], tuple(said["shape"]), said["delta"]))


def test_a_run_gets_a_page(trained, no_browser):
    job, _, _ = trained
    path = web.write_page(*trained, side=48)
    found = about(path)
    assert path == job.out / "page.html"
    assert [page["side"] for page in found["pages"]] == [48]
    names = [light["name"] for light in found["lights"]]
    assert names[0] == job.light.name
    assert len(set(names)) == len(names) > 4
    assert found["certificate"] is None
    assert "found no Chromium" in found["unmeasured"]
    assert about(web.write_page(*trained, side=None))["pages"][0]["side"] == job.config.atlas.size


def test_nets_with_texels_keep_the_atlas_of_their_training(tmp_path, no_browser):
    job = open_job(config(tmp_path, methods=["texture", "net"], train__texel_size=8), "", None)
    baked = bake(job)
    net = train(job, baked.points)
    assert net.net.texels
    found = about(web.write_page(job, baked, net, side=48))
    assert found["takes_uv"]
    own, page = (block(job.out / "page.html", name) for name in ("net_uv", "uv"))
    assert {*map(tuple, own)} == {*map(tuple, np.rint(65535 * baked.texture.atlas.uv.astype(np.float64)).astype(int))}
    assert {*map(tuple, own)} != {*map(tuple, page)}
    assert len(own) == len(page)
    with pytest.raises(PrtnetError, match=r"export.web_texture: found 16, expected more.*atlas.size"):
        web.write_page(job, baked, net, side=16)


def test_a_surface_without_an_atlas_gets_a_page(tmp_path, no_browser):
    """And exposures of what the page shows: those of the net drawn by rays."""
    (tmp_path / "ball.yaml").write_text("name: ball\nparts: {ball: {sphere: 0.4, albedo: [0.8, 0.3, 0.2]}}\n")
    options = {"methods": ["unshadowed", "net"], "scene__path": str(tmp_path / "ball.yaml"), "sdf__resolution": 32}
    job = open_job(config(tmp_path / "run", **options), "", None)
    baked, net = Baked(None, None, None, None), Trained("", random_net(width=8, depth=1, bands=3, residual=True), {})
    found = about(web.write_page(job, baked, net))
    assert "faces" not in found["blocks"]
    assert [part["name"] for part in found["parts"]] == ["ball"]
    assert len(found["lights"]) > 4
    drawing = drawing_of(job, baked, web.EXPOSED_SIZE)
    light, eye = found["lights"][0], cameras_of(job)[0]
    image = NetMethod(drawing, glsl.emit(net.net)).draw(eye, np.asarray(light["coefficients"], np.float32))
    assert light["exposure"] == pytest.approx(score.exposure([image], [(image != 0).any(axis=2)]), rel=0.01)


def test_exposures_suit_the_first_view(trained, no_browser):
    """By OpenGL and the shader, where the page's come from NumPy."""
    job, baked, net = trained
    eye = camera.path(job.scene, job.tracer, job.config.render.views, kind=job.config.scene.camera)[0]
    drawing = Raster(baked.texture.atlas, web.EXPOSED_SIZE)
    covered = drawing.faces(eye)[..., 0] > 0
    method = NetMethod(drawing, glsl.emit(net.net), grids=net.net.grids, hashes=net.net.hashes)
    found = about(web.write_page(*trained, side=None))["lights"]
    for light in found[:2]:
        image = method.draw(eye, np.asarray(light["coefficients"], np.float32))
        assert light["exposure"] == pytest.approx(score.exposure([image], [covered]), rel=0.01)


def test_a_page_that_computes_something_else_is_not_left(trained, monkeypatch):
    job, _, _ = trained
    for error in (2e-5, float("nan")):
        wrong = Certificate({"error_max": error, "error_mean": error})
        monkeypatch.setattr(web, "measured", lambda job, text, wrong=wrong: wrong)
        with pytest.raises(PrtnetError, match="no page was written"):
            web.write_page(*trained, side=None)
        assert not (job.out / "page.html").exists()


def test_without_a_net_there_is_no_page(trained):
    job, baked, _ = trained
    with pytest.raises(PrtnetError, match="net among them"):
        web.write_page(job, baked, None)


@pytest.mark.skipif(browser.find() is None, reason="needs Chromium: apt-get install chromium")
def test_the_certificate_is_on_the_page(trained, monkeypatch):
    path = web.write_page(*trained, side=None)
    found = about(path)["certificate"]
    # the same page is not measured again
    monkeypatch.setattr(browser, "find", lambda: None)
    assert about(web.write_page(*trained, side=None))["certificate"] == found
    assert 0 < found["error_max"] < 1e-5
    assert found["points"] == 1024
    assert found["net_ms"] > 0
    assert found["texture_ms"] > 0
    assert "Chrom" in found["browser"]
