"""Method clusters: which points train which network, what is kept, what is refused before any work."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from prtnet import PrtnetError, clusters, netspec
from prtnet.config import Config
from prtnet.pipeline import run
from prtnet.pipeline.bake import bake
from prtnet.pipeline.clusters import ClustersTrained, train_cluster, train_clusters
from prtnet.pipeline.job import Job, open_job
from prtnet.pipeline.split_plan import inside, plan_of
from tests.small import SETTINGS

SMALL = SETTINGS | {
    "methods": ["texture", "clusters"],
    "split.by": "grid",
    "split.cells": [2, 1, 1],
    "train.grid_cells": [],
    "train.hash_cells": [],
    "train.steps": 20,
}


def config(out: Path, **changes: object) -> Config:
    made = Config(out=str(out), stages=["train"])
    for name, value in (SMALL | {key.replace("__", "."): value for key, value in changes.items()}).items():
        group, _, key = name.rpartition(".")
        setattr(getattr(made, group) if group else made, key, value)
    return made


@pytest.fixture(scope="module")
def baked(tmp_path_factory: pytest.TempPathFactory):
    """The points are the same for all splits."""
    out = tmp_path_factory.mktemp("clusters")
    return out, bake(open_job(config(out), "", None))


def opened(out: Path, **changes: object) -> Job:
    return open_job(config(out, cache=str(out / "cache"), **changes), "", None)


def trained(baked, **changes: object) -> tuple[Job, ClustersTrained]:
    out, all_points = baked
    job = opened(out, **changes)
    return job, train_clusters(job, all_points.points, all_points)


def nets(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("net/*")}


def test_each_network_learns_its_side_and_the_border_both(baked):
    job, made = trained(baked, split__delta=0.1)
    points = baked[1].points
    (plane,) = made.spec.split.planes
    assert (plane.axis, plane.at) == (0, pytest.approx(0, abs=1e-6))
    share = clusters.weights(made.spec, points.training.positions)
    np.testing.assert_array_equal(inside(job, plan_of(job, points.training), points.training), share > 0)
    for index, each in enumerate(made.facts["clusters"]):
        x = points.training.positions[:, 0]
        assert each["points"] == np.sum((x > -0.1) if index else (x < 0.1))
        centre, scale = clusters.own_frame(made.spec, index)
        own = (points.training.positions[share[:, index] > 0] - centre) * scale
        np.testing.assert_allclose([own.min(), own.max()], [-1, 1], atol=1e-6)
        assert 4 * each["parameters"] == each["bytes"] == netspec.byte_count(made.spec.nets[index])
    assert made.spec.scale == job.frame.scale


def test_the_blend_is_judged_on_the_test_points(baked):
    _, made = trained(baked)
    for name in ("areas", "vertices"):
        points = getattr(baked[1].points, name)
        error = clusters.evaluate_unit(made.spec, points.positions, points.normals) - points.transfer
        assert made.facts[f"{name}_rmse"] == pytest.approx(float(np.sqrt(np.mean(error.astype(float) ** 2))))
    # 20 steps: better than no network at all
    assert made.facts["areas_rmse"] < 0.8 * np.sqrt(np.mean(baked[1].points.areas.transfer.astype(float) ** 2))


def test_any_order_gives_the_same_bytes_and_a_second_run_trains_nothing(baked, tmp_path):
    _, made = trained(baked)
    points = baked[1].points
    job = opened(tmp_path)
    alone = [train_cluster(job, points, index) for index in (1, 0)][::-1]
    assert [each.key for each in alone] == [each["key"] for each in made.facts["clusters"]]
    for one, other in zip(alone, made.spec.nets, strict=True):
        assert netspec.checksum(one.net) == netspec.checksum(other)
    before = nets(tmp_path)
    again = train_clusters(job, points)
    assert nets(tmp_path) == before
    assert again.key == made.key
    files = [
        (folder / "net" / f"{each.key}.safetensors").read_bytes()
        for each in alone
        for folder in (tmp_path / "cache", baked[0] / "cache")
    ]
    assert files[0] == files[1] != files[2] == files[3]


def test_a_merge_leaves_the_networks_of_other_clusters_as_they_are(baked):
    _, whole = trained(baked, split__cells=[3, 1, 1], split__delta=0.0)
    _, merged = trained(baked, split__cells=[3, 1, 1], split__delta=0.0, split__networks=2)
    keys = [{each["key"] for each in made.facts["clusters"]} for made in (whole, merged)]
    assert len(keys[0] & keys[1]) == 1
    (reason,) = merged.spec.merges
    text = (baked[0] / "clusters.md").read_text()
    assert reason.split(";")[0] in text
    assert "2 clusters are left, at most 2 were asked for" in text


def test_parts_have_networks_of_their_own(baked):
    job, made = trained(baked, split__by="parts", split__networks=2)
    points = baked[1].points
    assert made.spec.split.parts == len(job.scene.materials)
    part = points.training.part
    for index, each in enumerate(made.facts["clusters"]):
        assert each["points"] == np.isin(part, each["leaves"]).sum()
        assert index in made.spec.cluster
    with pytest.raises(PrtnetError, match=r"found \d+ training points in .*, expected at least 521, .* samples.count"):
        trained(baked, split__by="parts")


def test_a_cell_without_points_is_its_neighbours(baked, caplog):
    caplog.set_level("INFO")
    training = baked[1].points.training
    left = training.positions[:, 0] < 0
    values = {name: getattr(training, name)[left] for name in ("positions", "normals", "transfer", "part")}
    plan = plan_of(opened(baked[0], split__cells=[4, 1, 1], model__width=4), replace(training, key="left", **values))
    assert plan.cluster == (0, 1, 1, 1)
    assert "cell 3 has no points; cell 1, the nearest, takes its place" in caplog.text


def test_a_cluster_without_test_points_is_trained_as_well(baked):
    points = baked[1].points
    few = {name: getattr(points.vertices, name)[:0] for name in ("positions", "normals", "transfer", "part")}
    none = replace(points.vertices, key="none", **few)
    made = train_cluster(opened(baked[0], train__steps=2), replace(points, areas=none, vertices=none), 0)
    assert made.facts["areas_rmse"] is None
    assert made.facts["vertices_rmse"] is None


def test_grids_are_smaller_by_the_share_that_was_asked_for(baked):
    changes = {"train__grid_cells": [[8, 4, 8]], "train__hash_entries": 1024, "train__hash_cells": [8]}
    changes |= {"train__steps": 1}
    _, whole = trained(baked, **changes)
    _, quarter = trained(baked, split__grid_scale=0.25, **changes)
    features = [
        [each.size for net in made.spec.nets for each in (*net.grids, net.hashes[0].table)] for made in (whole, quarter)
    ]
    assert features[1] == [5 * 3 * 5 * 8, 256 * 4] * 2
    assert [net.hashes[0].cells for net in quarter.spec.nets] == [4, 4]
    assert 0.2 < sum(features[1]) / sum(features[0]) < 0.3


def test_the_budget_is_shared_by_the_points(baked):
    job, made = trained(baked, train__steps=None, train__cpu_seconds=0.1)
    kept = [baked[0] / "cache" / "net" / f"{each['key']}.json" for each in made.facts["clusters"]]
    shares = [json.loads(path.read_text())["inputs"]["train"]["cpu_seconds"] for path in kept]
    points = [each["points"] for each in made.facts["clusters"]]
    np.testing.assert_allclose(shares, 0.1 * np.array(points) / sum(points))
    assert job.config.train.cpu_seconds == 0.1


def test_each_cluster_gets_the_smallest_network_that_does(baked):
    changes = {"split__size": True, "size__target_psnr": 8.0, "size__depths": [0], "size__grids": ["none"]}
    made = train_cluster(opened(baked[0], **changes), baked[1].points, 1, baked[1])
    found = json.loads((baked[0] / "clusters" / "01" / "size.json").read_text())
    chosen = next(one for one in found["candidates"] if one["name"] == found["choice"])
    assert (chosen["depth"], chosen["bytes"]) == (0, netspec.byte_count(made.net))
    assert found["command"] is None
    # the pixels of the other half are not looked at
    (tried,) = {one["candidate"] for one in found["trials"] if one["share"] == 1}
    assert tried == found["choice"]


def test_the_export_leaves_a_set_that_loads(tmp_path):
    run(config(tmp_path, stages=["export"]))
    made = clusters.load(tmp_path / "clusters")
    assert len(made.nets) == 2
    assert not (tmp_path / "net.safetensors").exists()


REFUSED = [
    ({"split__by": "none"}, "split.by: found 'none', expected one of grid, parts, count"),
    ({"split__by": "cells"}, "split.by: found 'cells'"),
    ({"split__cells": [2, 2]}, r"split.cells: found \[2, 2\], expected three"),
    ({"split__cells": [2, 0, 2]}, "split.cells"),
    ({"split__cells": [50, 50, 50]}, "at most 1024 cells"),
    ({"split__count": 0}, "split.count: found 0, expected 1 to 1024"),
    ({"split__networks": 0}, "split.networks: found 0"),
    ({"split__delta": -0.1}, "split.delta: found -0.1"),
    ({"split__delta": float("nan")}, "split.delta: found nan"),
    ({"split__quality": 5.0}, "split.quality: found 5.0, expected a share"),
    ({"split__grid_scale": 0.0}, "split.grid_scale: found 0.0"),
    ({"split__border": "blur"}, "split.border: found 'blur', expected one of clip, assign"),
    ({"split__select": "pixel"}, "split.select: found 'pixel', expected one of draw, fragment"),
    ({"train__texel_size": 64}, "train.texel_size: found 64 with the method clusters"),
    ({"split__size": True}, "size: found neither a target nor a budget"),
    ({"split__size": True, "size__target_psnr": 20.0, "split__select": "fragment"}, "split.select: found fragment"),
]


@pytest.mark.parametrize(("changes", "message"), REFUSED)
def test_bad_words_are_refused_before_any_work(changes, message, tmp_path):
    with pytest.raises(PrtnetError, match=message):
        run(config(tmp_path, **changes))
    assert not (tmp_path / "cache").exists()
