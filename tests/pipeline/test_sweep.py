"""The summary of a sweep: every point that ends joins it, and one that fails leaves the rest."""

import json
from dataclasses import replace

import pytest

from prtnet import score
from prtnet.chart import points, tables
from prtnet.pipeline import run, sweep
from tests.pipeline.test_pipeline import config
from tests.rows import FLOOR, NET, TEXTURE
from tests.small import overrides
from tests.test_cli import prtnet

SMALL = {"methods": ["texture", "vertex"], "vertex__subdivide": ["floor"]}
SUMMARY = ("score.json", "table.md", "chart.png")


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A sweep of two points, and its summary after each."""
    out = tmp_path_factory.mktemp("sweep")
    found = []
    for level in (0, 2):
        run(config(out, **SMALL, vertex__level=level), sweep_point=f"vertex.level={level}")
        found.append({name: (out / name).read_bytes() for name in SUMMARY})
    return out, found


def names(out) -> list[str | None]:
    return list(dict.fromkeys(row.point for row in score.read(out / "score.json")[0]))


def test_each_point_joins_the_summary_as_it_ends(swept):
    out, (first, both) = swept
    alone = json.loads(first["score.json"])["rows"]
    assert {row["point"] for row in alone} == {"vertex.level=0"}
    assert names(out) == ["vertex.level=0", "vertex.level=2"]
    assert all(first[name] != both[name] for name in SUMMARY)
    own, _ = score.read(out / "vertex.level=2" / "score.json")
    assert all(row.point is None for row in own)
    kept = [row for row in score.read(out / "score.json")[0] if row.point == "vertex.level=2"]
    assert kept == [replace(row, point="vertex.level=2") for row in own]


def test_the_table_tells_the_points_apart_and_lists_what_they_share_once(swept):
    text = swept[1][1]["table.md"].decode()
    assert "2 points" in text
    assert text.count("\n| vertex, level=0 |") == text.count("\n| vertex, level=2 |") == 1
    assert text.count("\n| texture |") == text.count("\n| noise floor |") == 1


def test_a_sweep_taken_up_again_leaves_the_same_summary(swept):
    out, (_, both) = swept
    (out / "score.json").unlink()
    run(config(out, **SMALL, vertex__level=0), sweep_point="vertex.level=0")
    assert {name: (out / name).read_bytes() for name in SUMMARY} == both
    assert not list(out.glob(".*.tmp"))


def test_rows_carry_what_tables_are_plotted_against(swept):
    rows, _ = score.read(swept[0] / "score.json")
    drawn = {(row.method, row.point): row for row in rows if row.is_method}
    coarse, fine = (drawn["vertex", f"vertex.level={level}"] for level in (0, 2))
    assert coarse.triangles < fine.triangles
    assert coarse.vertices < fine.vertices
    assert fine.bytes == score.vertex_bytes(fine.vertices, 9)
    assert drawn["texture", "vertex.level=0"].triangles == coarse.triangles
    assert 0 < coarse.covered == fine.covered < 1


def test_a_failed_point_leaves_the_rest_intact(tmp_path):
    job = overrides(tmp_path, methods="[texture]", transfer__kind="spiral,uniform")
    done = prtnet("-m", *job)
    assert done.returncode == 2, done.stderr
    assert "prtnet: transfer.kind: found 'spiral'" in done.stderr
    assert "Traceback" not in done.stderr
    assert names(tmp_path) == ["transfer.kind=uniform"]
    assert (tmp_path / "chart.png").exists()


def test_points_that_cannot_be_read_are_left_out(tmp_path, caplog):
    for name, rows in (("a=10", [NET]), ("a=9", [TEXTURE, FLOOR]), ("mesh=x/y.glb", [NET])):
        score.write(tmp_path / name / "score.json", rows, {})
    (tmp_path / "a=1").mkdir()
    (tmp_path / "a=1" / "score.json").write_text("{")
    score.write(tmp_path / "another_run" / "score.json", [NET], {})
    sweep.summary_of(tmp_path)
    assert names(tmp_path) == ["a=9", "a=10", "mesh=x/y.glb"]
    assert "a=1/score.json: not a score file" in caplog.text


def test_nothing_is_written_where_no_point_was_scored(tmp_path):
    (tmp_path / "a=1").mkdir()
    sweep.summary_of(tmp_path)
    assert not any((tmp_path / name).exists() for name in SUMMARY)


def test_words_are_those_that_points_do_not_share():
    names = ["model.width=8,scene=a,methods=[texture,net]", "model.width=16,scene=a,methods=[net,x]"]
    assert [", ".join(words) for words in points.own_words(names).values()] == [
        "width=8, methods=[texture,net]",
        "width=16, methods=[net,x]",
    ]
    names = ["train=default,atlas.mipmaps=true", "train=published,atlas.mipmaps=false"]
    assert list(points.own_words(names).values()) == [("default", "mipmaps=true"), ("published", "mipmaps=false")]


def test_rows_that_differ_stay_and_equal_ones_become_one():
    both = [
        replace(row, point=f"train={recipe},width={width}", ms=width)
        for recipe in ("a", "b")
        for width in (8, 16)
        for row in (TEXTURE, replace(NET, psnr=40.0 + width + (recipe == "a")))
    ]
    shown = points.side_by_side(both)
    assert {row.ms for row in shown} == {None}
    assert [tables.method_name(row) for row in shown] == [
        "texture",
        *(f"net, {recipe}, width={width}" for recipe in ("a", "b") for width in (8, 16)),
    ]
