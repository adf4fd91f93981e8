"""The page's text: whole, one file, and deaf to what a scene calls itself."""

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data.light import about_y
from prtnet.export import browser, packing, web, web_content, web_data_driven, web_frame
from prtnet.export.web import Certificate, PageLight
from tests.export.pages import BANDS, over_atlas, small
from tests.nets import random_net, random_texels

HOSTILE = (
    """</script><script>window.hacked = 1</script><img src=x onerror="window.hacked = 1">{{script}}<!-- ' " \\ \r ü"""
)


class Parsed(HTMLParser):
    """Elements with their attributes, and the text of each id."""

    def __init__(self, text: str):
        super().__init__()
        self.found, self.texts, self._open = [], {}, None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        self._open = dict(attrs).get("id", tag)

    def handle_endtag(self, tag):
        self._open = None

    def handle_data(self, data):
        self.texts[self._open] = self.texts.get(self._open, "") + data


@pytest.fixture(scope="module")
def made():
    return small()


@pytest.fixture(scope="module")
def text(made):
    return made.text(title="a box")


def about_of(text):
    return json.loads(Parsed(text).texts["about"])


def test_nothing_is_left_open_and_nothing_leads_away(text):
    assert not re.findall(r"\{\{\w+\}\}", text)
    for tag, attributes in Parsed(text).found:
        assert tag not in ("iframe", "object", "embed", "base"), tag
        for name in ("src", "href", "action"):
            assert attributes.get(name, "data:,") == "data:,", (tag, attributes)
    assert not re.search(r"https?://", text)


PAGES = (web.MODULES, web_data_driven.MODULES)


@pytest.mark.parametrize("modules", PAGES)
def test_modules_share_one_room(modules):
    script = web_frame.script(modules)
    names = re.findall(r"^(?:async )?(?:function|class|const|let) (\w+)", script, re.MULTILINE)
    assert len(names) == len(set(names))
    assert "import" not in re.findall(r"^\w+", script, re.MULTILINE)


def test_every_module_is_of_a_page():
    files = {path.stem for path in web_frame.FOLDER.glob("*.js")}
    assert files == {name for modules in PAGES for name in modules}
    for path in web_frame.FOLDER.iterdir():
        assert path.read_text(encoding="utf-8").count("\n") <= 300, path
        assert "</script" not in path.read_text(encoding="utf-8") or path.suffix == ".html"


def test_hostile_names_stay_words(made):
    scene = made.atlas.scene
    parts = tuple(replace(each, name=HOSTILE) for each in scene.materials)
    atlas = replace(made.atlas, scene=replace(scene, name=HOSTILE, materials=parts))
    lights = [PageLight(HOSTILE, made.lights[0].coefficients, 1.0)]
    hostile = replace(made, atlas=atlas, net=replace(made.net, name=HOSTILE), lights=lights)
    text = hostile.text(certificate=Certificate(reason=HOSTILE, notes=[HOSTILE]))
    found, plain = Parsed(text), Parsed(made.text())
    assert [tag for tag, _ in found.found if tag != "li"] == [tag for tag, _ in plain.found if tag != "li"]
    about = about_of(text)
    assert about["lights"][0]["name"] == about["parts"][0]["name"] == HOSTILE
    assert found.texts["style"] == plain.texts["style"]
    # the HTML parser of browsers makes \r a \n
    assert found.texts["h1"].replace("\r", "\n") == HOSTILE.replace("\r", "\n")
    source = packing.unpack(block(text, "net")).tobytes().decode()
    assert "hacked" not in source


def block(text, name):
    about = about_of(text)["blocks"][name]
    data = base64.b64decode(Parsed(text).texts[f"data-{name}"])
    return packing.Block(data, about["kind"], tuple(about["shape"]), about["delta"])


def test_blocks_hold_the_mesh(made, text):
    box = packing.Box(**{key: np.array(v, np.float32) for key, v in about_of(text)["box"].items()})
    found = packing.from_steps(packing.unpack(block(text, "positions")), box)
    assert np.abs(found - made.atlas.scene.vertices).max() < 2e-5
    assert np.array_equal(packing.unpack(block(text, "faces")), made.atlas.scene.faces)


def test_upright_turns_y_into_z(made, text):
    matrix = np.array(about_of(text)["upright"]).reshape(BANDS**2, -1)
    light = made.lights[0].coefficients.astype(np.float64)
    up, straight = np.array([0.0, 1, 0]), np.array([0.0, 0, 1])
    at = sh.evaluate(straight, BANDS) @ (matrix @ light)
    np.testing.assert_allclose(at, sh.evaluate(up, BANDS) @ light, atol=1e-6)
    assert np.allclose(about_y(90) @ [0, 0, 1], [1, 0, 0])


def test_textured_parts_have_the_mean_of_their_surface(made):
    scene = made.atlas.scene
    texture = np.zeros((2, 2, 3), np.float32)
    texture[:, 0] = [0.2, 0.4, 0.8]
    textured = replace(scene.materials[0], texture=texture, albedo=np.full(3, 0.5, np.float32))
    uv = np.full((len(scene.vertices), 2), 0.25, np.float32)
    changed = replace(scene, uv=uv, materials=(textured, *scene.materials[1:]))
    np.testing.assert_allclose(web_content.palette(changed)[0], [0.1, 0.2, 0.4], atol=1e-6)
    np.testing.assert_array_equal(web_content.palette(changed)[1:], web_content.palette(scene)[1:])
    text = replace(made, atlas=replace(made.atlas, scene=changed)).text()
    assert "Albedo textures" in text


def test_nets_too_large_for_literals_have_a_texture(made):
    text = replace(made, net=random_net(width=256, depth=3, bands=BANDS)).text()
    assert about_of(text)["images"] == [{"name": "prt_weights", "size": [257, 195]}]


def test_the_page_says_what_a_small_device_lacks():
    made = over_atlas()
    wide = replace(made, net=random_net(bands=BANDS, texels=(random_texels(600, 2, channels=16),)))
    assert about_of(wide.text())["needs"]["MAX_TEXTURE_SIZE"] == 2400


def test_nets_with_texels_want_coordinates():
    made = over_atlas()
    for wrong in (None, made.more["net_uv"][:-1]):
        with pytest.raises(PrtnetError, match="place of each vertex in the atlas of the net's training"):
            made.text(net_uv=wrong)


def test_without_chromium_that_is_said(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(browser.NoBrowser, match="apt-get install chromium"):
        browser.Browser()


def test_a_browser_that_does_not_start_is_none(monkeypatch, tmp_path):
    broken = tmp_path / "chromium"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(browser, "find", lambda: str(broken))
    with pytest.raises(browser.NoBrowser, match="not to start"):
        browser.Browser()
