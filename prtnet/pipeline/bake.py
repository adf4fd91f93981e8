"""Stage `bake`: training points, test points, the transfer texture and the vertices, with transfer by ray tracing."""

import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError, console, sh
from prtnet.data import mipmap, samples, texture, transfer, vertex
from prtnet.data.atlas import Atlas
from prtnet.data.samples import Samples
from prtnet.data.scene import Scene
from prtnet.data.texture import Page
from prtnet.pipeline.atlas import atlas_of, inputs_of, padding_of
from prtnet.pipeline.job import Job
from prtnet.render import camera
from prtnet.store import Artifact

log = logging.getLogger(__name__)
Array = np.ndarray

SHARD_RAYS = 1 << 26  # rays between two saves: a second or two of work that a kill can cost
CLEARANCE = 0.05  # in unit lengths (the scene is 2 long): less before a point than this and nobody looks at it
TEST_DIRECTIONS = 4  # times the training rays: the test set's noise is then half the training set's


@dataclass(frozen=True)
class PointSet:
    """Points in unit coordinates with their transfer."""

    key: str
    positions: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    transfer: Float[Array, "n k"]
    facts: Mapping[str, Any]


@dataclass(frozen=True)
class BakedTexture:
    """The baseline: an atlas and the transfer of its covered texels, in one texture or in one for each part."""

    key: str
    atlas: Atlas
    pages: tuple[Page, ...]  # dilated
    facts: Mapping[str, Any]


@dataclass(frozen=True)
class BakedMesh:
    """Vertex PRT: the mesh it draws, in unit coordinates, and the transfer of its vertices."""

    key: str
    mesh: Scene
    transfer: Float[Array, "v k"]
    facts: Mapping[str, Any]


@dataclass(frozen=True)
class NetPoints:
    """What a net is trained on and tested on."""

    training: PointSet
    areas: PointSet  # the independent test set
    vertices: PointSet  # the other test set


@dataclass(frozen=True)
class Baked:
    """The baseline, and what the other methods of the job need."""

    texture: BakedTexture
    mesh: BakedMesh | None
    points: NetPoints | None


def bake(job: Job) -> Baked:
    """Everything that rays are needed for, except the references of stage `score`."""
    points = _net_points(job) if "net" in job.config.methods else None
    return Baked(_texture(job), _mesh(job) if "vertex" in job.config.methods else None, points)


def _net_points(job: Job) -> NetPoints:
    options = job.config.samples

    def uniform(purpose: str, count: int) -> Samples:
        return samples.area_uniform(job.scene, count, job.rng(purpose), sequence=options.sequence)

    def vertices() -> Samples:
        found = samples.at_vertices(job.scene)
        few = job.rng("vertices").permutation(len(found.face))[: options.test_count]
        return samples.select(found, np.sort(few))

    rays = job.config.transfer.directions
    return NetPoints(
        _point_set(job, "training", lambda: uniform("training", options.count), options.count, rays),
        _point_set(
            job, "areas", lambda: uniform("areas", options.test_count), options.test_count, rays * TEST_DIRECTIONS
        ),
        _point_set(job, "vertices", vertices, options.test_count, rays * TEST_DIRECTIONS),
    )


def traced(
    job: Job,
    stage: str,
    inputs: Mapping[str, Any],
    points: Samples,
    directions: int,
    *,
    title: str | None = None,
    salt: int = 0,
    announce: int = 1,
) -> Artifact:
    """The transfer of points as an artifact {"transfer": "n k"}, shard by shard: a killed bake goes on where it was.

    `inputs` must tell the points and the `salt` of their rays' rotations; what the transfer depends on besides is
    added here. The estimate that is printed is for `announce` such bakes, 0 for none.
    """
    options, title = job.config.transfer, title or stage
    inputs = dict(inputs) | {"bands": options.bands, "directions": directions, "kind": options.kind}
    found = job.store.get(stage, inputs)
    if found is not None:
        return found
    count = len(points.positions)
    size = max(1, SHARD_RAYS // directions)
    shards = max(1, -(-count // size))
    if announce * count * directions > SHARD_RAYS // 4:
        _estimate(job, title, points, directions, announce)
    with console.progress(title, count, "points") as reach:

        def make(shard: int) -> tuple[dict[str, Array], dict[str, Any]]:
            first = shard * size
            part = samples.select(points, np.arange(first, min(count, first + size)))
            start = time.perf_counter()
            # a generator per shard: its points' rotations do not depend on which shards this process bakes
            rng = np.random.default_rng([job.config.seed, salt, shard])
            values = _bake(job, part, directions, rng, lambda done: reach(first + done))
            return {"transfer": values}, {"seconds": time.perf_counter() - start}

        parts = job.store.make_shards(stage, inputs, shards, make)
    seconds = sum(part.facts["seconds"] for part in parts)
    whole = np.concatenate([part.arrays["transfer"] for part in parts])
    artifact = job.store.make(stage, inputs, lambda: ({"transfer": whole}, {"seconds": seconds}))
    job.store.drop_shards(stage, inputs)
    rate = count * directions / max(seconds, 1e-9) / 1e6
    log.info("%s: %d points x %d rays in %s (%.1f Mray/s)", title, count, directions, console.duration(seconds), rate)
    return artifact


def _bake(job: Job, part: Samples, directions: int, rng: np.random.Generator, reach: Any) -> Array:
    options = job.config.transfer
    return transfer.bake(
        job.tracer,
        part.positions,
        part.normals,
        bands=options.bands,
        directions=directions,
        rng=rng,
        geometric_normals=part.geometric_normals,
        kind=options.kind,
        progress=reach,
        threads=job.config.threads,
    )


def _estimate(job: Job, title: str, points: Samples, directions: int, times: int) -> None:
    threads = job.config.threads or transfer.cores()
    rate = threads * job.tracer.measure(points.positions, points.normals)
    count, row = len(points.positions), 4 * sh.count(job.config.transfer.bands)
    title = f"{title}{f' and {times - 1} more' if times > 1 else ''}: {count} points x {directions} rays"
    title += f" at {rate / 1e6:.1f} Mray/s with the {job.tracer.kind} tracer"
    seconds = times * count * directions / rate
    console.estimate(title, seconds=seconds, memory=3 * count * row, disk=times * count * row)


def _point_set(job: Job, purpose: str, draw: Any, count: int, directions: int) -> PointSet:
    """Points with transfer, less those that no light reaches and nobody sees."""
    points = draw()
    inputs = job.scene_key | {"purpose": purpose, "count": count, "seed": job.config.seed}
    inputs["sequence"] = job.config.samples.sequence
    baked = traced(job, purpose, inputs, points, directions)
    values = baked.arrays["transfer"]
    free = ~_enclosed(job, points, values)
    enclosed = int(np.sum(~free))
    if enclosed == len(values):
        raise PrtnetError(f"{job.scene.name}: all {len(values)} samples are enclosed, expected some that see light")
    if enclosed:
        log.info("%s: %d of %d points are fully enclosed and left out", purpose, enclosed, len(values))
    return PointSet(
        baked.key,
        points.positions[free].astype(np.float32),
        points.normals[free],
        values[free],
        baked.facts | {"enclosed": enclosed, "points": len(values)},
    )


def _enclosed(job: Job, points: Samples, values: Array) -> Array:
    """Points from which no direction is free. Whoever sees one from outside would be such a direction; from inside a
    room dark walls are seen, and only points with no space before them are left out: the bottoms of things."""
    dark = values[:, 0] <= 0
    if dark.any() and camera.kind_of(job.scene, job.tracer, job.config.scene.camera) == "inside":
        hidden = job.tracer.clearance(points.positions[dark], points.geometric_normals[dark]) < CLEARANCE
        dark[dark] = hidden
    return dark


def _texture(job: Job) -> BakedTexture:
    options, inputs = job.config.atlas, inputs_of(job)
    atlas, seconds = atlas_of(job)
    texels = texture.gbuffers(atlas, options.size)
    points = texture.points(texels)
    baked = traced(job, "texture", inputs, points, job.config.transfer.directions)
    levels = mipmap.level_count(padding_of(options)) if options.mipmaps else 1
    parts = np.split(baked.arrays["transfer"], np.cumsum([len(page.index) for page in texels])[:-1])
    pages = [
        texture.page(page, part, dilation=options.dilation, levels=levels)
        for page, part in zip(texels, parts, strict=True)
    ]
    facts = baked.facts | {
        "texels": len(points.positions),
        "uv": atlas.source,
        "seconds": seconds + baked.facts["seconds"],
    }
    return BakedTexture(baked.key, atlas, tuple(pages), facts)


def _mesh(job: Job) -> BakedMesh:
    options = job.config.vertex
    start = time.perf_counter()
    mesh = vertex.mesh(job.scene, options.subdivide, options.level)
    cut = sorted(set(options.subdivide)) if options.level else []
    inputs = job.scene_key | {"subdivide": cut, "level": options.level if cut else 0}
    if options.kind == "unshadowed":
        bands = job.config.transfer.bands
        baked = job.store.make(
            "vertex",
            inputs | {"bands": bands, "kind": options.kind},
            lambda: ({"transfer": vertex.unshadowed(mesh, bands)}, {"seconds": time.perf_counter() - start}),
        )
    else:
        inputs["seed"] = job.config.seed
        baked = traced(job, "vertex", inputs, vertex.points(mesh), job.config.transfer.directions)
    return BakedMesh(baked.key, mesh, baked.arrays["transfer"], baked.facts)
