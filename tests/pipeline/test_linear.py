"""The methods pca and cpca in a run: what they cost, equal bytes, keys that cannot be."""

import pytest

from prtnet import PrtnetError, netspec, score
from prtnet.pipeline import run
from tests.pipeline.test_pipeline import artifacts, config

METHODS = ["texture", "pca", "cpca"]
FEW = {"methods": METHODS, "linear__elements": 4, "linear__clusters": 5}


def rows_of(out):
    rows, _ = score.read(out / "score.json")
    return {row.method: row for row in rows if row.reference == "traced" and row.is_method}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    out = tmp_path_factory.mktemp("linear")
    run(config(out, **FEW))
    return out


def again(plain, out, **changes):
    run(config(out, **(FEW | {"cache": str(plain / "cache")} | changes)))
    return rows_of(out)


def test_rows_and_costs(plain):
    rows = rows_of(plain)
    assert set(rows) == set(METHODS)
    table = 4 * 5 * 9  # floats of a mean and four vectors
    assert rows["pca"].bytes == 64**2 * 16 + table
    assert rows["cpca"].bytes == 64**2 * (16 + 1) + 5 * table
    assert rows["pca"].macs == 4 * 4 + 3 * 4
    assert rows["cpca"].macs == 4 * (4 + 3 * 4 + 3)
    assert rows["texture"].psnr > rows["cpca"].psnr > rows["pca"].psnr > 20
    assert rows["pca"].bake_seconds > rows["texture"].bake_seconds
    text = (plain / "card.md").read_text()
    assert "4 vectors at 64^2 texels, RMSE" in text
    assert "5 clusters of 4 vectors at 64^2 texels, RMSE" in text


def test_a_second_run_finds_everything(plain, tmp_path):
    before = {stage: artifacts(plain, stage) for stage in ("linear", "score")}
    assert len(before["linear"]) == 2
    again(plain, tmp_path)
    assert {stage: artifacts(plain, stage) for stage in before} == before


def test_all_vectors_are_the_texture(plain, tmp_path):
    rows = again(plain, tmp_path, linear__elements=9)
    for name in ("pca", "cpca"):
        assert rows[name].psnr == pytest.approx(rows["texture"].psnr, abs=0.01)


@pytest.mark.parametrize(
    "changes",
    [
        {"atlas__sets": "parts", "atlas__format": "uint8"},
        {"transfer__transport": "interreflected", "material__specular": [0.3, 0.3, 0.3]},
    ],
)
def test_more_clusters_of_more_vectors_are_near_the_texture(plain, tmp_path, changes):
    """Enough of both, and the error left is that of the texture."""
    rows = again(plain, tmp_path, linear__elements=8, linear__clusters=16, methods=["texture", "cpca"], **changes)
    assert rows["cpca"].psnr == pytest.approx(rows["texture"].psnr, abs=0.3)


def test_at_vertices(plain, tmp_path):
    chosen = {"methods": [*METHODS, "vertex"], "linear__store": "vertex", "linear__elements": 8}
    rows = again(plain, tmp_path, **chosen, transfer__transport="interreflected")
    for name, table in (("pca", 1), ("cpca", 5)):
        assert rows[name].psnr == pytest.approx(rows["vertex"].psnr, abs=0.2)
        index = name == "cpca"
        assert rows[name].bytes == rows["vertex"].vertices * (2 * 16 + index) + 4 * table * 9 * 27
        assert rows[name].vertices == rows["vertex"].vertices


def test_another_side_is_another_texture(plain, tmp_path):
    rows = again(plain, tmp_path, linear__size=32)
    assert rows["pca"].bytes == 32**2 * 16 + 4 * 5 * 9
    assert rows["pca"].psnr != rows_of(plain)["pca"].psnr
    # with all vectors the texture of that side
    small = again(plain, tmp_path / "small", methods=["texture"], atlas__size=32)
    full = again(plain, tmp_path / "full", linear__size=32, linear__elements=9)
    assert full["pca"].psnr == pytest.approx(small["texture"].psnr, abs=0.02)


def test_equal_bytes(plain, tmp_path):
    """The best of what fits is no worse than what the same bytes buy at one's own choice of vectors."""
    rows = again(plain, tmp_path, linear__bytes="texture", linear__clusters=2, transfer__directions=128)
    room = 64**2 * 3 * 16
    for name in ("pca", "cpca"):
        assert 0.8 * room < rows[name].bytes <= room
    assert rows["pca"].psnr > rows_of(plain)["pca"].psnr + 3
    # without the method vertex its bake is made for them
    at_vertices = again(plain, tmp_path / "vertex", linear__bytes="texture", linear__store="vertex")
    assert at_vertices["pca"].bytes <= room


def test_the_bytes_of_a_net(plain, tmp_path):
    grids = {"train__grid_cells": [[12, 12, 12]], "train__grid_channels": 4, "train__steps": 5}
    rows = again(plain, tmp_path, methods=["texture", "net", "pca"], linear__bytes="net", **grids)
    assert rows["net"].bytes == netspec.byte_count(netspec.load(tmp_path / "net.safetensors"))
    assert 0.5 * rows["net"].bytes < rows["pca"].bytes <= rows["net"].bytes


def test_bytes_without_room(plain, tmp_path):
    with pytest.raises(
        PrtnetError, match=r"linear\.bytes: found \d+ bytes of texture, too few for the vectors of cpca"
    ):
        again(plain, tmp_path, linear__bytes="texture", linear__clusters=4096, atlas__size=32)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"linear__store": "face"}, r"linear\.store: found 'face', expected one of texel, vertex"),
        ({"linear__bytes": "half"}, r"linear\.bytes: found 'half', expected one of free, net, texture"),
        ({"linear__bytes": "net"}, r"linear\.bytes: found net without the method net"),
        ({"linear__elements": 10}, r"linear\.elements: found 10, expected 1 to 9"),
        ({"linear__clusters": 0}, r"linear\.clusters: found 0"),
        ({"linear__size": 8}, r"linear\.size: found 8, expected at least 16"),
        ({"linear__size": 32, "linear__bytes": "texture"}, r"linear\.size: found 32 with linear\.bytes=texture"),
        ({"linear__size": 32, "linear__store": "vertex"}, r"linear\.size: found 32 with linear\.store=vertex"),
        ({"scene__name": "sdf_fish"}, r"methods: found \['texture', 'pca', 'cpca'\], expected unshadowed"),
    ],
)
def test_keys_that_cannot_be(tmp_path, changes, message):
    with pytest.raises(PrtnetError, match=message):
        run(config(tmp_path, **(FEW | changes)))
    assert not list(tmp_path.iterdir())
