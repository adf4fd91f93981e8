"""The page of an implicit surface: its text, and in Chromium its pixels against NumPy's."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError, netspec, score, sh
from prtnet.data import light
from prtnet.export import browser, packing, sphere_tracing, web
from prtnet.export.browser import Browser
from prtnet.export.web import PageLight
from prtnet.render.gbuffer import shade
from prtnet.render.marched import Marched
from prtnet.render.material import DIFFUSE, Material
from tests.export.pages import BANDS, EXPOSURES, LOOK
from tests.export.test_web import HOSTILE, about_of
from tests.export.test_web_browser import SIZE, assert_alike, camera_of, inside, pixels, start
from tests.nets import random_net, random_texels
from tests.render.surfaces import still_life

LIGHTS = [PageLight(name, light.by_name(name).coefficients(BANDS), exposure) for name, exposure in EXPOSURES.items()]
NET = random_net(width=8, depth=1, bands=BANDS, residual=True, output_scale=0.3)


def text(net=NET, **changes) -> str:
    return web.surface_page(
        net, changes.pop("surface", still_life()), lights=LIGHTS, look=replace(LOOK, eye=(0.8, 0.9, 2.2)), **changes
    )


def test_the_page_has_a_surface_and_no_mesh():
    about = about_of(text())
    assert set(about["blocks"]) == {"net", "gloss", "checks", "surface", "unshadowed"}
    assert [part["name"] for part in about["parts"]] == ["part 0", "part 1", "part 2"]
    np.testing.assert_allclose(about["parts"][0]["albedo"], [0.8, 0.2, 0.1], atol=1e-6)
    assert about["other"] == "unshadowed"
    assert about["costs"]["unshadowed"]["bytes"] == 0
    assert 0 < about["costs"]["unshadowed"]["macs"] < about["costs"]["net"]["macs"]


def test_hostile_names_stay_words():
    surface = still_life()
    parts = tuple(replace(part, name=HOSTILE) for part in surface.materials)
    found = text(surface=replace(surface, name=HOSTILE, materials=parts), title=HOSTILE)
    assert found.count("<script") == text().count("<script")
    assert "window.hacked" not in packing.pack_text(sphere_tracing.emit(surface.field)).text()
    assert about_of(found)["parts"][0]["name"] == HOSTILE


def test_what_needs_an_atlas_is_refused():
    for net in (random_net(bands=BANDS, texels=(random_texels(4, 4),)), random_net(bands=BANDS, groups=4)):
        with pytest.raises(PrtnetError, match="implicit surfaces have no atlas"):
            text(net)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    if browser.find() is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(text(), encoding="utf-8")
    with Browser(size=(900, 600)) as found:
        start(found, path.as_uri())
        yield found


def predicted(page, *, material=DIFFUSE, shadows=True):
    """The picture by NumPy, and where it is one: away from edges, which the page smooths."""
    gbuffer = Marched(still_life(), SIZE).gbuffer(camera_of(page))
    transfer = sh.cosine_lobe(gbuffer.normals, BANDS)
    if shadows:
        transfer = netspec.evaluate_unit(NET, gbuffer.positions.astype(np.float64), gbuffer.normals)
    image = shade(gbuffer, transfer, LIGHTS[0].coefficients, material)
    return score.tone_map(image, LIGHTS[0].exposure), inside(gbuffer)


def test_pixels_are_those_of_numpy(page):
    net, where = predicted(page)
    assert_alike(pixels(page), net, where)
    page.evaluate("prtnet.controls.set({ method: 'unshadowed' })")
    open_, where = predicted(page, shadows=False)
    assert_alike(pixels(page), open_, where)
    assert np.abs(net - open_)[where].mean() > 2 / 255
    page.evaluate("prtnet.controls.set({ method: 'net', specular: 0.6, diffuse: 0.3, exponent: 12 })")
    assert_alike(pixels(page), *predicted(page, material=Material(0.3, (0.6, 0.6, 0.6), 12.0)))


def test_a_nearer_view_is_the_same_surface(page):
    page.evaluate("prtnet.controls.set({ method: 'net', specular: 0, diffuse: 1 })")
    page.evaluate("prtnet.viewer.orbit.turn(0.7, 0.2)")
    page.evaluate("prtnet.viewer.orbit.zoom(0.6)")
    assert_alike(pixels(page), *predicted(page))
    assert page.evaluate("prtnet.certify().error_max") < 1e-5


def test_the_controls_name_what_is_beside_the_net(page):
    page.evaluate("document.dispatchEvent(new KeyboardEvent('keydown', { key: '2' }))")
    assert page.evaluate("document.querySelector('[name=method]:checked').value") == "unshadowed"
    assert page.evaluate("document.getElementById('tag-right').textContent") == "unshadowed"
    page.evaluate("prtnet.controls.act('t')")
    assert float(page.evaluate("document.getElementById('other-ms').textContent")) > 0
    assert set(page.evaluate("prtnet.viewer.time(1)")) == {"net", "unshadowed"}
    assert page.complaints() == []
