"""Method `clusters`: a network for each cluster of the scene, trained as an artifact of its own.

What a cluster's training makes follows from the configuration, the baked points and the cluster's index alone, so that
clusters may be trained in any order and anywhere: `train_cluster`.
"""

import hashlib
import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Bool

from prtnet import clusters, console, netspec, store
from prtnet.chart import clusters as tables
from prtnet.clusters import ClusterSpec
from prtnet.data.scene import Frame, frame_of
from prtnet.netspec import NetSpec
from prtnet.pipeline import engine, split_options
from prtnet.pipeline.bake import Baked, NetPoints, PointSet, bake
from prtnet.pipeline.engine import Task
from prtnet.pipeline.job import Job
from prtnet.pipeline.split_plan import Plan, inside, plan_of
from prtnet.pipeline.train import Trained, train

log = logging.getLogger(__name__)
Array = np.ndarray


@dataclass(frozen=True)
class ClustersTrained:
    """`facts`: what the blend reaches, why leaves were merged, and of each cluster its size and training."""

    key: str
    spec: ClusterSpec
    facts: Mapping[str, Any]


def train_clusters(job: Job, points: NetPoints, baked: Baked | None = None) -> ClustersTrained:
    """All networks of the job's clusters, and what they reach together. `baked` as for `train_cluster`.

    Leaves clusters.md in the run folder.
    """
    plan = plan_of(job, points.training)
    _spread(job, points, len(plan.points))
    trained = [train_cluster(job, points, index, baked) for index in range(len(plan.points))]
    x, y, z = job.frame.centre.tolist()
    nets = tuple(each.net for each in trained)
    spec = ClusterSpec(plan.split, plan.cluster, job.config.split.delta, nets, (x, y, z), job.frame.scale, plan.merges)
    inputs = {"nets": [each.key for each in trained], "areas": points.areas.key, "vertices": points.vertices.key}
    inputs |= {"planes": plan.split.planes, "cluster": plan.cluster, "delta": spec.delta, "merges": plan.merges}
    kept = job.store.make("clusters", inputs, lambda: ({}, _reached(spec, points)))
    each = [_facts(plan, index, one) for index, one in enumerate(trained)]
    facts = kept.facts | {"clusters": each, "merges": list(plan.merges), "ended": plan.ended}
    facts["cpu_seconds"] = sum(one.facts["cpu_seconds"] for one in trained)
    store.write_text(job.out / "clusters.md", tables.markdown(job.scene.name, facts))
    log.info(
        "clusters: %d networks, %s of CPU time; transfer RMSE %.4f on held-out points, %.4f on vertices",
        len(nets),
        console.duration(facts["cpu_seconds"]),
        facts["areas_rmse"],
        facts["vertices_rmse"],
    )
    return ClustersTrained(kept.key, spec, facts)


def train_cluster(job: Job, points: NetPoints, index: int, baked: Baked | None = None) -> Trained:
    """The network of one cluster, in its own cube.

    Where each cluster gets a size of its own, `baked` has what the views are drawn with.
    """
    plan = plan_of(job, points.training)
    own_job, own_points, cube = _own(job, points, plan, index)
    log.info("clusters: network %d of %d, %d points", index + 1, len(plan.points), plan.points[index])
    if split_options.sized(job.config):
        from prtnet.pipeline.split_size import sized

        assert baked is not None
        own_job = sized(own_job, baked, own_points, plan, index, cube)
    return train(own_job, own_points)


def _spread(job: Job, points: NetPoints, count: int) -> None:
    """Have the networks trained by the engine's workers, where there are any; the caller finds them."""
    if engine.workers(job.config.cluster) < 2 or count < 2:
        return
    groups = ["model", "train", "split"]
    groups += ["size", "material", "light", "render"] if split_options.sized(job.config) else []
    inputs = {group: asdict(getattr(job.config, group)) for group in groups}
    inputs |= {"points": [points.training.key, points.areas.key, points.vertices.key]}
    key = store.content_key(inputs)
    tasks = [Task(f"cluster-{key}-{index + 1}-of-{count}", train_one, {"index": index}) for index in range(count)]

    def spread() -> tuple[store.Arrays, Mapping[str, Any]]:
        engine.spread(job, "clusters", tasks, unit="networks")
        return {}, {"networks": count}

    # kept, so that a run that has them all starts no jobs to look for them
    job.store.make("spread", inputs, spread)


def train_one(job: Job, *, index: int) -> None:
    """Train the network of one cluster of a job whose points are in the store."""
    baked = _baked(job)
    assert baked.points is not None
    train_cluster(job, baked.points, index, baked)


@lru_cache(maxsize=1)
def _baked(job: Job) -> Baked:
    """Kept until the next one: a process of a pool trains network after network of the same job."""
    return bake(job)


def _own(job: Job, points: NetPoints, plan: Plan, index: int) -> tuple[Job, NetPoints, Frame]:
    """The job and the points of one cluster, whose unit coordinates are its own cube, and that cube in the scene's."""
    masks = [inside(job, plan, each)[:, index] for each in (points.training, points.areas, points.vertices)]
    cube = frame_of(points.training.positions[masks[0]])
    training, areas, vertices = (
        _within(each, mask, cube)
        for each, mask in zip((points.training, points.areas, points.vertices), masks, strict=True)
    )
    own = Frame(job.frame.from_unit(cube.centre), job.frame.scale * cube.scale)
    config = split_options.of_one(job.config, plan.points[index] / sum(plan.points))
    out = job.out / "clusters" / f"{index:02d}"
    return replace(job, frame=own, config=config, out=out), NetPoints(training, areas, vertices), cube


def _within(points: PointSet, mask: Bool[Array, " n"], cube: Frame) -> PointSet:
    """Some of the points, in the coordinates of a cube; the key tells which."""
    which = {"points": points.key, "mask": hashlib.sha256(mask.tobytes()).hexdigest()}
    key = store.content_key(which | {"cube": [*cube.centre.tolist(), cube.scale]})
    return replace(
        points,
        key=key,
        positions=cube.to_unit(points.positions[mask]).astype(np.float32),
        normals=points.normals[mask],
        transfer=points.transfer[mask],
        part=None if points.part is None else points.part[mask],
    )


def _reached(spec: ClusterSpec, points: NetPoints) -> dict[str, float]:
    """Transfer RMSE of the blend over all coefficients of the test sets."""
    found = {}
    for name, tested in (("areas", points.areas), ("vertices", points.vertices)):
        blend = clusters.evaluate_unit(spec, tested.positions, tested.normals, tested.part)
        found[f"{name}_rmse"] = float(np.sqrt(np.mean((blend.astype(np.float64) - tested.transfer) ** 2)))
    return found


def _facts(plan: Plan, index: int, trained: Trained) -> dict[str, Any]:
    kept = {name: trained.facts[name] for name in ("steps", "cpu_seconds", "areas_rmse", "width", "depth")}
    return kept | {
        "leaves": [leaf for leaf, its in enumerate(plan.cluster) if its == index],
        "points": plan.points[index],
        "parameters": _parameters(trained.net),
        "macs": netspec.macs(trained.net),
        "bytes": netspec.byte_count(trained.net),
        "key": trained.key,
    }


def _parameters(net: NetSpec) -> int:
    """Numbers that training chose: weights, biases, features of grids."""
    return sum(each.size for each in (*net.weights, *net.biases, *net.grids, *(table for _, table in net.hashes)))
