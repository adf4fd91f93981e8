"""The three files of a transfer texture: a round trip, the page's reader, and files that are not whole."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from prtnet import PrtnetError, sh, store
from prtnet.data import atlas, atlas_set, builtin, quantise, texture
from prtnet.data.scene import frame_of
from prtnet.export import texture_file

PAGE = Path(__file__).resolve().parents[2] / "docs" / "texture-transfer.md"
SIZE, BANDS = 96, 3
BARE = {"names": [""], "channels": texture_file.channel_names(BANDS)}


def made(sets: str = "one"):
    """(atlas in unit coordinates, pages, frame) of a scene far from the origin, with nothing occluded."""
    scene = builtin.make("tea_set", tessellation=0.3)
    moved = scene.vertices * 10 + [5e5, 0, -3e5]
    scene = replace(scene, vertices=moved, frame=frame_of(moved))
    unit = scene.centred()
    if sets == "parts":
        found = atlas_set.make(unit, size=SIZE, single_chart=False, unwrap_mode="auto", padding=1)
    else:
        found = atlas.make(unit, size=SIZE)
    pages = [texture.page(texels, sh.cosine_lobe(texels.normals, BANDS)) for texels in texture.gbuffers(found, SIZE)]
    return found, tuple(pages), scene.frame


@pytest.fixture(scope="module")
def one():
    return made()


@pytest.mark.parametrize("storage", list(quantise.FORMATS))
@pytest.mark.parametrize("sets", ["one", "parts"])
def test_round_trip(tmp_path, storage, sets):
    found, pages, frame = made(sets)
    texture_file.write(tmp_path, found, pages, frame, storage=storage)
    read = texture_file.read(tmp_path)
    assert len(read.pages) == len(pages) == len(found.sides or (SIZE,))
    for image, page in zip(read.pages, pages, strict=True):
        (expected,) = quantise.decode(quantise.encode(page.levels, page.used, storage))
        np.testing.assert_array_equal(image, expected)
    np.testing.assert_array_equal(read.centre, frame.centre)
    if storage == "uint8":
        entry, page = read.about["pages"][-1], pages[-1]
        byte = 255 * (read.pages[-1] - entry["least"]) / np.where(entry["span"], entry["span"], 1)
        stored = quantise.encode(page.levels, page.used, storage)
        np.testing.assert_allclose(byte, stored.levels[0], atol=1e-3)


def test_the_mesh_leads_back_to_the_file(one, tmp_path):
    found, pages, frame = one
    texture_file.write(tmp_path, found, pages, frame)
    arrays = store.load_arrays(tmp_path / texture_file.MESH)
    expected = frame.from_unit(found.scene.vertices)
    np.testing.assert_allclose(arrays["positions"].astype(np.float64) + frame.centre, expected, atol=2e-6)
    np.testing.assert_array_equal(arrays["faces"], found.scene.faces)
    np.testing.assert_array_equal(arrays["uv"], found.uv)


def test_layers_are_bands():
    names = texture_file.channel_names(5)
    assert names[:5] == ["l0.00", "l1.01", "l1.02", "l1.03", "l2.04"]
    for bands in (1, 5, 10, 12):
        names = texture_file.channel_names(bands)
        assert names == sorted(names)
        assert len(set(names)) == bands**2


@pytest.mark.parametrize("sets", ["one", "parts"])
def test_the_pages_reader(tmp_path, monkeypatch, sets):
    found, pages, frame = made(sets)
    texture_file.write(tmp_path, found, pages, frame, storage="float16")
    code = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    assert len([line for line in code.group(1).splitlines() if line.strip()]) <= 20
    monkeypatch.chdir(tmp_path)
    exec(compile(code.group(1), str(PAGE), "exec"), {})
    for place, page in enumerate(pages):
        image = np.asarray(oiio.ImageBuf(f"page{place}.exr").get_pixels(oiio.FLOAT))
        # nothing occluded under a white sky: white
        np.testing.assert_allclose(image[page.used], 1, atol=2e-3)


def test_the_page_names_what_is_in_the_files(one, tmp_path):
    texture_file.write(tmp_path, *one, storage="uint8")
    text = PAGE.read_text(encoding="utf-8")
    about = json.loads((tmp_path / texture_file.JSON).read_text())
    assert set(about) == set(texture_file.KEYS)
    for name in (*about, *about["pages"][0], *store.load_arrays(tmp_path / texture_file.MESH)):
        assert f"`{name}`" in text, name


def test_nothing_is_left_when_writing_fails(one, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError("disk full")

    monkeypatch.setattr("prtnet.store.os.fsync", refuse)
    with pytest.raises(PrtnetError, match="disk full"):
        texture_file.write_exr(
            tmp_path / "t.exr", list(one[1][0].levels), names=[""], channels=texture_file.channel_names(BANDS)
        )
    assert not list(tmp_path.iterdir())
    with pytest.raises(PrtnetError, match=r"folder\.exr: cannot be written, expected the folder"):
        texture_file.write_exr(
            tmp_path / "no" / "folder.exr",
            list(one[1][0].levels),
            names=[""],
            channels=texture_file.channel_names(BANDS),
        )


@pytest.mark.parametrize(
    ("harm", "message"),
    [
        ("absent", r"transfer_texture\.exr: no such file"),
        ("empty", r"transfer_texture\.exr: the file has 0 bytes"),
        ("header", r"transfer_texture\.exr: not a readable EXR texture \(EXR Error"),
        ("truncated", r"transfer_texture\.exr: the EXR texture is cut short"),
        ("not an image", r"transfer_texture\.exr: not a readable EXR texture"),
        ("nan", r"transfer_texture\.exr: found only NaN and infinite values"),
        ("other", r"transfer_texture\.exr: found images of \[\(8, 8, 9\)\], expected \[\(96, 96, 9\)\]"),
    ],
)
def test_textures_that_are_not_whole(one, tmp_path, harm, message):
    texture_file.write(tmp_path, *one)
    path = tmp_path / texture_file.EXR
    whole = path.read_bytes()
    contents = {"empty": b"", "header": whole[:200], "truncated": whole[: len(whole) // 2], "not an image": b"no"}
    if harm == "absent":
        path.unlink()
    elif harm in contents:
        path.write_bytes(contents[harm])
    else:
        value, size = (np.nan, SIZE) if harm == "nan" else (1.0, 8)
        texture_file.write_exr(
            path, [np.full((size, size, 9), value, np.float32)], names=[""], channels=texture_file.channel_names(3)
        )
    with pytest.raises(PrtnetError, match=message):
        texture_file.read(tmp_path)


def test_json_that_is_not_the_textures(one, tmp_path):
    with pytest.raises(PrtnetError, match=r"transfer_texture\.json: not a readable JSON file"):
        texture_file.read(tmp_path)
    path = tmp_path / texture_file.JSON
    path.write_text("[]")
    with pytest.raises(PrtnetError, match=r"found format None, expected 1"):
        texture_file.read(tmp_path)
    path.write_text('{"format": 1, "name": ""}')
    with pytest.raises(PrtnetError, match=r"found no bands, groups, channels"):
        texture_file.read(tmp_path)


def test_four_groups_keep_their_order(one, tmp_path):
    """EXR sorts channels by name: blue before direct."""
    found, (page,), frame = one
    image = np.concatenate([(group + 1) * page.levels[0] for group in range(4)], axis=2)
    texture_file.write(tmp_path, found, (replace(page, levels=(image,)),), frame, groups=4)
    read = texture_file.read(tmp_path)
    assert read.about["groups"] == ["direct", "red", "green", "blue"]
    assert read.about["bands"] == BANDS
    np.testing.assert_array_equal(read.pages[0], image)
