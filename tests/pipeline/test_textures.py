"""Transfer textures in a run: formats, levels, sets and normal maps; keys that cannot be."""

import json

import numpy as np
import pytest
from PIL import Image

from prtnet import PrtnetError, score, store
from prtnet.export import texture_file
from prtnet.pipeline import run
from tests.pipeline.test_pipeline import artifacts, config

ALONE = {"methods": ["texture"]}


def texture_row(out):
    rows, _ = score.read(out / "score.json")
    return next(row for row in rows if row.method == "texture")


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    out = tmp_path_factory.mktemp("plain")
    run(config(out, **ALONE))
    return out


@pytest.mark.parametrize(
    ("changes", "macs", "size"),
    [
        ({"format": "float16"}, 4 * 9 + 27, 64**2 * 3 * 8),
        ({"format": "uint8"}, 5 * 9 + 27, 64**2 * 3 * 4),
        ({"mipmaps": True, "size": 128}, 8 * 9 + 27, (128**2 + 64**2 + 32**2) * 3 * 16),
        ({"mipmaps": True, "padding": 1}, 4 * 9 + 27, 64**2 * 3 * 16),
        (
            {"mipmaps": True, "level_of_detail": "distance", "format": "uint8", "padding": 2, "size": 128},
            9 * 9 + 27,
            (128**2 + 64**2) * 3 * 4,
        ),
        ({"dilation": 0}, 4 * 9 + 27, 64**2 * 3 * 16),
    ],
)
def test_another_texture(plain, changes, macs, size):
    before = {stage: artifacts(plain, stage) for stage in ("atlas", "texture", "traced")}
    run(config(plain, **ALONE, **{f"atlas__{key}": value for key, value in changes.items()}))
    row = texture_row(plain)
    assert row.macs == macs
    assert row.bytes == size
    assert row.psnr is not None
    assert row.psnr > 10
    wide = changes.get("padding", 4 if "mipmaps" in changes else 1) > 1
    assert ({stage: artifacts(plain, stage) for stage in before} == before) != wide
    about = texture_file.read(plain).about
    assert about["storage"] == changes.get("format", "float32")
    assert about["mipmaps"] == (row.macs in (8 * 9 + 27, 9 * 9 + 27))
    assert about["dilation"] == changes.get("dilation", 3)


def test_dilation_matters_at_chart_borders(plain):
    """Without it bilinear look-ups find the empty texels between charts."""
    found = {}
    for rings in (3, 0):
        run(config(plain, **ALONE, atlas__dilation=rings, scene__name="tea_set", atlas__size=128))
        found[rings] = texture_row(plain).psnr
    assert found[0] < found[3] - 0.1


def test_a_page_for_each_part(plain, tmp_path):
    run(config(tmp_path, **ALONE, atlas__sets="parts", atlas__size=96, cache=str(plain / "cache")))
    made = texture_file.read(tmp_path)
    sides = [page["size"] for page in made.about["pages"]]
    assert len(sides) > 2
    assert sum(side**2 for side in sides) <= 96**2
    assert texture_row(tmp_path).bytes == sum(side**2 for side in sides) * 3 * 16
    assert texture_row(tmp_path).psnr > 10
    mesh = store.load_arrays(tmp_path / texture_file.MESH)
    assert set(mesh["page"]) == set(range(len(sides)))
    # again: everything is found
    times = {path: path.stat().st_mtime_ns for path in tmp_path.glob("transfer_texture*")}
    run(config(tmp_path, **ALONE, atlas__sets="parts", atlas__size=96, cache=str(plain / "cache")))
    assert {path: path.stat().st_mtime_ns for path in tmp_path.glob("transfer_texture*")} == times


@pytest.fixture
def bumpy(tmp_path):
    """A floor with a relief and a lid over half of it."""
    y, x = np.mgrid[:32, :32] / 32 * 2 * np.pi
    vectors = np.stack([0.5 * np.sin(4 * x), 0.5 * np.sin(4 * y), np.ones_like(x)], -1)
    vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
    Image.fromarray(np.rint((vectors + 1) * 127.5).astype(np.uint8)).save(tmp_path / "bumps.png")
    (tmp_path / "m.mtl").write_text("newmtl floor\nKd 0.8 0.8 0.8\nnewmtl lid\nKd 0.5 0.5 0.5\n")
    lines = ["mtllib m.mtl", "v -1 0 1", "v 1 0 1", "v 1 0 -1", "v -1 0 -1", "v -1 1 1", "v 0 1 1", "v 0 1 -1"]
    lines += ["v -1 1 -1", "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", "usemtl floor", "f 1/1 2/2 3/3 4/4"]
    lines += ["usemtl lid", "f 5/1 6/2 7/3 8/4"]
    (tmp_path / "m.obj").write_text("\n".join(lines) + "\n")
    return tmp_path


@pytest.mark.parametrize("sets", ["one", "parts"])
def test_a_normal_map_in_a_whole_run(bumpy, sets):
    common = {"scene__path": str(bumpy / "m.obj"), "atlas__size": 128, "cache": str(bumpy / "cache")}
    maps = {"floor": str(bumpy / "bumps.png")}
    frames = {}
    for name, given in (("smooth", None), ("bumpy", maps)):
        out = bumpy / name
        methods = ["texture", "vertex", "net"] if name == "bumpy" and sets == "one" else ["texture"]
        run(config(out, **common, atlas__sets=sets, scene__normal_maps=given, methods=methods, train__steps=200))
        key = (out / ".report.key").read_text()
        frames[name] = store.load_arrays(bumpy / "cache" / "score" / f"{key}.safetensors")
        rows, _ = score.read(out / "score.json")
        assert texture_row(out).psnr > 25
        assert {row.method for row in rows} >= set(methods)
    # the reference shows the relief
    assert np.abs(frames["bumpy"]["traced"] - frames["smooth"]["traced"]).max() > 0.05


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"atlas__format": "int4"}, r"atlas\.format: found 'int4', expected one of float32"),
        ({"atlas__sets": "many"}, r"atlas\.sets: found 'many'"),
        ({"atlas__unwrap": "xatlas"}, r"atlas\.unwrap: found 'xatlas'"),
        ({"atlas__level_of_detail": "size"}, r"atlas\.level_of_detail: found 'size'"),
        ({"atlas__dilation": -1}, r"atlas\.dilation: found -1, expected at least 0"),
        ({"atlas__size": 1 << 20}, r"atlas\.size: found 1048576, expected at most \d+ \(GL_MAX_TEXTURE_SIZE"),
        ({"atlas__size": 2048, "atlas__memory_limit": 0.1}, r"expected at most atlas\.memory_limit, 0\.1 GiB"),
        ({"transfer__bands": 0}, r"transfer\.bands: found 0, expected at least 1"),
        ({"transfer__bands": 300}, r"transfer\.bands: found 300, which takes 22500 layers .* at most \d+ bands"),
        ({"scene__normal_maps": {"floor": "x.png"}}, r"x\.png for part floor: found the built-in scene cornell"),
        ({"scene__normal_maps": ["x.png"]}, r"scene\.normal_maps: found \['x\.png'\], expected {part: image"),
    ],
)
def test_keys_that_cannot_be(tmp_path, changes, message):
    with pytest.raises(PrtnetError, match=message):
        run(config(tmp_path, **changes))
    assert not list(tmp_path.iterdir())


def test_unwrapping_can_be_refused(tmp_path):
    with pytest.raises(PrtnetError, match=r"cornell: atlas\.unwrap: found never, but the scene has no texture coord"):
        run(config(tmp_path, **ALONE, atlas__unwrap="never"))
    assert not list(tmp_path.rglob("*.safetensors"))


def test_the_json_is_written_last_and_whole(plain, monkeypatch):
    """A run that fails while it writes leaves no stamp, and the next one writes the files."""
    folder = plain / "fails"

    def refuse(*_, **__):
        raise PrtnetError("disk full")

    with monkeypatch.context() as patch:
        patch.setattr(texture_file, "write_exr", refuse)
        with pytest.raises(PrtnetError, match="disk full"):
            run(config(folder, **ALONE, cache=str(plain / "cache")))
    assert not (folder / texture_file.JSON).exists()
    assert not (folder / texture_file.EXR).exists()
    run(config(folder, **ALONE, cache=str(plain / "cache")))
    assert json.loads((folder / texture_file.JSON).read_text())["format"] == 1
