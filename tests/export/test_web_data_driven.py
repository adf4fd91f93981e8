"""The text of the page of data-driven transfer: whole, what it holds, what it refuses."""

import re
from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError, data_driven
from prtnet.export import data_driven as driven
from prtnet.export import packing
from prtnet.export.web_frame import Certificate
from tests.export.driven_pages import ELEMENTS, LAMPS, POINTS, SAMPLES, SIDE, made
from tests.export.test_web import HOSTILE, Parsed, about_of, block


@pytest.fixture(scope="module")
def small():
    return made()


@pytest.fixture(scope="module")
def text(small):
    return small.text(title="a box")


def halves(text, name):
    return packing.unpack(block(text, name)).astype(np.uint16).view(np.float16)


def test_nothing_is_left_open_and_nothing_leads_away(text):
    assert not re.findall(r"\{\{\w+\}\}", text)
    assert not re.search(r"https?://", text)
    found = Parsed(text)
    assert {tag for tag, _ in found.found}.isdisjoint({"iframe", "object", "embed", "base"})
    ids = [attributes["id"] for _, attributes in found.found if "id" in attributes]
    assert len(ids) == len(set(ids))


def test_hostile_names_stay_words(small, text):
    scene = small.atlas.scene
    parts = tuple(replace(each, name=HOSTILE) for each in scene.materials)
    atlas = replace(small.atlas, scene=replace(scene, name=HOSTILE, materials=parts))
    lights = [replace(small.lights[0], name=HOSTILE)]
    hostile = replace(small, atlas=atlas).text(lights=lights, notes=[HOSTILE], certificate=Certificate(reason=HOSTILE))
    tags = [[tag for tag, _ in Parsed(each).found if tag != "li"] for each in (hostile, text)]
    assert tags[0] == tags[1]
    assert about_of(hostile)["lights"][0]["name"] == HOSTILE
    assert Parsed(hostile).texts["h1"].replace("\r", "\n") == HOSTILE.replace("\r", "\n")


def test_blocks_hold_the_basis(small, text):
    about = about_of(text)
    assert (about["elements"], about["points"], about["samples"]) == (ELEMENTS, POINTS, SAMPLES)
    mask = np.unpackbits(packing.unpack(block(text, "mask")).astype(np.uint8))[: SIDE**2].astype(bool)
    assert mask[small.spec.texels].all()
    assert mask.sum() > 1.2 * len(small.spec.texels)
    rows = np.flatnonzero(mask)
    found = halves(text, "basis")[np.searchsorted(rows, small.spec.texels), :ELEMENTS].astype(np.float64)
    np.testing.assert_allclose(found.T / about["scale"], small.spec.basis[0], rtol=6e-4, atol=1e-6)
    lightmap = halves(text, "references")[np.searchsorted(rows, small.spec.texels), 3:6]
    np.testing.assert_allclose(lightmap, small.lights[1].lightmap, rtol=6e-4)


def test_what_lights_are_compared_with(text):
    lights = about_of(text)["lights"]
    assert [light["reference"] for light in lights] == [0, 1, None]
    assert [light["lamp"]["kind"] for light in lights] == [lamp.kind for lamp in LAMPS]
    assert about_of(text)["checked"]["lights"] == [0, 1, 2]


def test_costs_and_needs(small, text):
    about = about_of(text)
    assert about["costs"]["bytes"] == data_driven.byte_count(small.spec, 2)
    assert about["costs"]["lamp"] == 3 * ELEMENTS * POINTS
    assert about["needs"]["MAX_ARRAY_TEXTURE_LAYERS"] == 6
    many = about_of(made(banks=3).text())
    assert many["channels"] == 3 * driven.width(small.spec)


def test_what_cannot_be_shown_is_refused(small):
    with pytest.raises(PrtnetError, match="found no lamp"):
        small.text(lights=[])
    with pytest.raises(PrtnetError, match="atlas of 2 textures, expected one"):
        replace(small, atlas=replace(small.atlas, sides=(16, 16))).text()
    short = replace(small.lights[0], lightmap=np.zeros((5, 3), np.float32))
    with pytest.raises(PrtnetError, match=r"lightmap \(5, 3\) of point"):
        small.text(lights=[short])


def test_the_page_says_what_it_leaves_out(small):
    spec = small.spec
    two = replace(spec, matrices=np.repeat(spec.matrices, 2, axis=0), measurements=spec.measurements * 2)
    assert "The first of 2 keyframes is shown" in small.text(spec=two)
    assert "keyframes" not in "".join(re.findall(r"<li>.*?</li>", small.text()))
