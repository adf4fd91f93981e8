"""What rays find at points, gathered shard by shard: here, or every n-th shard in one of n jobs of `pipeline.engine`.

A shard has a generator of its own, so that its bytes depend neither on who makes it nor on what was made before; a
killed bake goes on with the shards that are missing.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError, console, sh, store
from prtnet.data import transfer
from prtnet.data.implicit.march import MarchTracer
from prtnet.data.samples import Samples
from prtnet.data.surface import Surface
from prtnet.data.tracer import Tracer
from prtnet.pipeline import engine
from prtnet.pipeline.engine import Task
from prtnet.pipeline.job import Job
from prtnet.store import Arrays, Artifact

log = logging.getLogger(__name__)
Array = np.ndarray
Rays = Tracer | MarchTracer

SHARD_RAYS = 1 << 26  # rays between two saves: a second or two of work that a kill can cost


@dataclass(frozen=True, eq=False)
class Gather:
    """What the rays of a point bring: `kind` names the function of `prtnet.data.transfer`."""

    kind: str  # bake, or bounce and incident, which read what every point of `surface` has `sent`
    bands: int
    surface: Surface | None = None
    sent: Array | None = None

    def __call__(self, tracer: Any, positions: Array, normals: Array, **options: Any) -> Float32[Array, "n c"]:
        """What `prtnet.data.transfer` gives for the points, in one row each."""
        points = (tracer, positions, normals)
        if self.kind == "bake":
            return transfer.bake(*points, bands=self.bands, **options)
        assert self.surface is not None
        assert self.sent is not None
        if self.kind == "bounce":
            found = transfer.bounce(*points, self.surface, self.sent, **options)
        else:
            found = transfer.incident(*points, self.surface, self.sent, bands=self.bands, **options)
        return found.reshape(len(found), -1)


@dataclass(frozen=True, eq=False)
class Bake:
    """Rays from points, and the shards that they are cut into."""

    gather: Gather
    positions: Float[Array, "n 3"]
    normals: Float32[Array, "n 3"]
    geometric_normals: Float32[Array, "n 3"]
    directions: int
    salt: int  # of the rays' rotations
    size: int  # points of a shard

    def make(self, job: Job, tracer: Rays, shard: int, items: slice, progress: Callable[[int], None]) -> Arrays:
        """One shard: {"transfer": "n c"}."""
        values = self.gather(
            tracer,
            self.positions[items],
            self.normals[items],
            directions=self.directions,
            rng=np.random.default_rng([job.config.seed, self.salt, shard]),
            geometric_normals=self.geometric_normals[items],
            kind=job.config.transfer.kind,
            progress=lambda done: progress(items.start + done),
            threads=job.config.threads,
        )
        return {"transfer": values}


def in_shards(
    job: Job,
    stage: str,
    inputs: Mapping[str, Any],
    points: Samples,
    directions: int,
    gather: Gather,
    title: str,
    salt: int,
    announce: int,
    tracer: Rays | None = None,
) -> Artifact:
    """An artifact of what `gather` finds at the points by the rays of `tracer`, or the job's.

    The estimate is for `announce` such bakes, 0 for none.
    """
    inputs = dict(inputs) | {"directions": directions, "kind": job.config.transfer.kind}
    rays = tracer or job.tracer
    if job.implicit:
        inputs["tracer"] = rays.kind
    size = max(1, SHARD_RAYS // directions)
    work = Bake(gather, points.positions, points.normals, points.geometric_normals, directions, salt, size)

    def bake() -> Artifact:
        count = len(work.positions)
        if announce * count * directions > SHARD_RAYS // 4:
            _estimate(job, rays, title, points, directions, announce)
        _spread(job, rays, store.shards_folder(stage, inputs), title, work)
        with console.progress(title, count, "points") as reach:
            artifact = job.store.put_shards(
                stage, inputs, count, size, lambda shard, items: work.make(job, rays, shard, items, reach)
            )
        seconds = artifact.facts["seconds"]
        rate = count * directions / max(seconds, 1e-9) / 1e6
        log.info(
            "%s: %d points x %d rays in %s (%.1f Mray/s)", title, count, directions, console.duration(seconds), rate
        )
        return artifact

    return job.store.once(stage, inputs, bake)


def _spread(job: Job, rays: Rays, folder: str, title: str, work: Bake) -> None:
    """Have the shards made by the engine's workers, where there are enough of them; the caller finds them."""
    shards = store.shard_count(len(work.positions), work.size)

    def kept() -> int:
        return len(list((job.store.root / folder).glob("*.json")))

    jobs = engine.useful_workers(job, shards - kept())
    if jobs < 2:
        return
    handed = _handed(work)
    job.store.make(f"{folder}/handed", {}, lambda: (handed, {}))
    shared = {
        "folder": folder,
        "scene": job.scene_key,
        "tracer": rays.kind,
        "gather": work.gather.kind,
        "bands": work.gather.bands,
        "directions": work.directions,
        "salt": work.salt,
        "size": work.size,
    }
    key = folder.rpartition("/")[2].partition(".")[0]
    stage = folder.partition("/")[0]
    tasks = [
        Task(f"{stage}-{key}-{first + 1}-of-{jobs}", make_some, shared | {"first": first, "step": jobs})
        for first in range(jobs)
    ]
    engine.spread(job, title, tasks, total=shards, unit="shards", reached=kept)


def make_some(
    job: Job,
    *,
    folder: str,
    scene: Mapping[str, Any],
    tracer: str,
    gather: str,
    bands: int,
    first: int,
    step: int,
    **plan: int,
) -> None:
    """Every `step`-th shard from `first` on, of a bake that `_spread` has handed over.

    Raises PrtnetError where this process has another scene or tracer than the one that asks.
    """
    rays = job.marched if job.implicit and tracer == MarchTracer.kind else job.tracer
    for name, found, expected in (("scene", job.scene_key, scene), ("tracer", rays.kind, tracer)):
        if found != expected:
            raise PrtnetError(
                f"{job.scene.name}: found the {name} {found}, expected {expected} as where the run was started; "
                "let all machines see the same files and have the same packages"
            )
    kept = job.store.get(f"{folder}/handed", {})
    if kept is None:
        raise PrtnetError(
            f"{job.store.root / folder}: found no points, expected those of the run; share cache= with it"
        )
    work = _of_handed(kept.arrays, gather, bands, **plan)
    count = len(work.positions)
    mine = range(first, store.shard_count(count, work.size), step)

    def make(shard: int, items: slice) -> Arrays:
        log.info("shard %d of %d to %d", shard, mine[0], mine[-1])
        return work.make(job, rays, shard, items, lambda done: None)

    for shard in mine:
        job.store.shard(folder, shard, count, work.size, make)


def _handed(work: Bake) -> Arrays:
    """The arrays of a bake by name. Inverse of `_of_handed`."""
    made = {name: getattr(work, name) for name in ("positions", "normals", "geometric_normals")}
    if work.gather.surface is not None and work.gather.sent is not None:
        made["sent"] = work.gather.sent
        made |= {field.name: getattr(work.gather.surface, field.name) for field in fields(Surface)}
    return made


def _of_handed(arrays: Arrays, kind: str, bands: int, **plan: int) -> Bake:
    named = {field.name: arrays[field.name] for field in fields(Surface) if field.name in arrays}
    gather = Gather(kind, bands, Surface(**named) if named else None, arrays.get("sent"))
    return Bake(gather, arrays["positions"], arrays["normals"], arrays["geometric_normals"], **plan)


def _estimate(job: Job, rays: Rays, title: str, points: Samples, directions: int, times: int) -> None:
    rate = engine.threads(job) * rays.measure(points.positions, points.normals)
    count, row = len(points.positions), 4 * sh.count(job.config.transfer.bands)
    title = f"{title}{f' and {times - 1} more' if times > 1 else ''}: {count} points x {directions} rays"
    title += f" at {rate / 1e6:.1f} Mray/s with the {rays.kind} tracer"
    seconds = times * count * directions / rate
    console.estimate(title, seconds=seconds, memory=3 * count * row, disk=times * count * row)
