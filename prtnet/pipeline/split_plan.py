"""Which leaf of the scene belongs to which cluster, and which points train it."""

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Int

from prtnet import PrtnetError, clusters
from prtnet.clusters import Plane, Split
from prtnet.data import merge, split
from prtnet.pipeline import split_options
from prtnet.pipeline.bake import PointSet
from prtnet.pipeline.job import Job

log = logging.getLogger(__name__)
Array = np.ndarray


@dataclass(frozen=True)
class Plan:
    """The clusters of a job; the facts that it is kept as are plain values."""

    split: Split
    cluster: tuple[int, ...]  # of each leaf
    points: tuple[int, ...]  # that train each cluster
    merges: tuple[str, ...]  # why leaves were merged
    ended: str  # why no more were


def plan_of(job: Job, training: PointSet) -> Plan:
    """The plan of this job, or what the store has of it. Raises PrtnetError where a cluster has too few points."""
    options = job.config.split
    cut = {"grid": options.cells, "count": options.count, "parts": None}[options.by]
    inputs = job.scene_key | {
        "training": training.key,
        "points": len(training.positions),
        "by": [options.by, cut],
        "merging": [options.networks, options.quality],
        "delta": options.delta,
        "least": _least(job, training),
    }
    facts = job.store.make("split", inputs, lambda: ({}, _made(job, training))).facts
    made = Split(tuple(Plane(*plane) for plane in facts["planes"]), facts["parts"])
    return Plan(made, tuple(facts["cluster"]), tuple(facts["points"]), tuple(facts["merges"]), facts["ended"])


def inside(job: Job, plan: Plan, points: PointSet) -> Bool[Array, "n c"]:
    """Which points train or test each cluster: those where its weight is above 0."""
    return _inside(plan.split, plan.cluster, job.config.split.delta, points)


def _inside(cut: Split, cluster: tuple[int, ...], delta: float, points: PointSet) -> Bool[Array, "n c"]:
    found, size = np.empty((len(points.positions), max(cluster) + 1), bool), max(1, split.CHUNK // cut.leaves)
    for start in range(0, len(found), size):
        chunk = slice(start, start + size)
        found[chunk] = clusters.blend(cut, cluster, delta, points.positions[chunk], _part(points)[chunk]) > 0
    return found


def _part(points: PointSet) -> Int[Array, " n"]:
    assert points.part is not None
    return points.part


def _least(job: Job, training: PointSet) -> int:
    return split_options.least_points(job.config, training.transfer.shape[1])


def _made(job: Job, training: PointSet) -> dict[str, Any]:
    options, least = job.config.split, _least(job, training)
    cut = _cut(job, training)
    leaf = split.leaf_of(cut, training.positions, _part(training))
    boxes, count = split.boxes(cut, job.scene), np.bincount(leaf, minlength=cut.leaves)
    home, names = split.nearest(boxes, count > 0), _names(job, cut)
    for empty in np.flatnonzero(count == 0):
        log.info("split: %s has no points; %s, the nearest, takes its place", names[empty], names[home[empty]])
    found = merge.merge(
        leaf,
        training.transfer,
        split.touching(cut, boxes),
        home,
        names,
        networks=options.networks,
        quality=options.quality,
        least=least,
    )
    for each in found.merges:
        log.info("split: %s", each.reason)
    log.info("split: %d leaves in %d clusters: %s", cut.leaves, max(found.cluster) + 1, found.ended)
    points = _inside(cut, found.cluster, options.delta, training).sum(axis=0)
    _refuse_few(points, found, names, least)
    return {
        "planes": [list(plane) for plane in cut.planes],
        "parts": cut.parts,
        "cluster": list(found.cluster),
        "points": points.tolist(),
        "merges": [each.reason for each in found.merges],
        "ended": found.ended,
    }


def _cut(job: Job, training: PointSet) -> Split:
    options, vertices = job.config.split, job.scene.vertices
    if options.by == "parts":
        return Split(parts=len(job.scene.materials))
    if options.by == "count":
        return split.by_count(training.positions, options.count)
    x, y, z = options.cells
    return split.grid(vertices.min(axis=0), vertices.max(axis=0), (x, y, z))


def _names(job: Job, cut: Split) -> list[str]:
    if cut.parts:
        return [material.name for material in job.scene.materials]
    return [f"cell {index}" for index in range(cut.leaves)]


def _refuse_few(points: Int[Array, " c"], found: merge.Merged, names: list[str], least: int) -> None:
    few = int(points.argmin())
    if points[few] < least:
        leaves = " + ".join(name for name, its in zip(names, found.cluster, strict=True) if its == few)
        raise PrtnetError(
            f"split: found {points[few]} training points in {leaves}, expected at least {least}, the weights and biases"
            " of its network: merge clusters with split.networks or split.quality, or choose a coarser split, a"
            " smaller model or more points with samples.count"
        )
