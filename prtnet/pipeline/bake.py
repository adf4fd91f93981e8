"""Stage `bake`: training points, test points, the transfer texture and the vertices, with transfer by ray tracing."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int

from prtnet import PrtnetError, sh
from prtnet.data import mipmap, samples, texture, vertex
from prtnet.data.atlas import Atlas
from prtnet.data.implicit import accuracy, project
from prtnet.data.implicit.march import MarchTracer
from prtnet.data.samples import Samples
from prtnet.data.scene import Scene
from prtnet.data.texture import Page, Texels
from prtnet.data.tracer import Tracer
from prtnet.pipeline.atlas import atlas_of, inputs_of, padding_of
from prtnet.pipeline.data_driven.learn import Operator, operator
from prtnet.pipeline.job import Job
from prtnet.pipeline.transport import Radiosity, incident, received, texels_and_radiosity, traced
from prtnet.render import camera

log = logging.getLogger(__name__)
Array = np.ndarray

CLEARANCE = 0.05  # in unit lengths (the scene is 2 long): less before a point than this and nobody looks at it
TEST_DIRECTIONS = 4  # times the training rays: the test set's noise is then half the training set's


@dataclass(frozen=True)
class PointSet:
    """Points in unit coordinates with their transfer."""

    key: str
    positions: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    transfer: Float[Array, "n c"]
    groups: int  # of SH coefficients in the transfer: see `pipeline.transport`
    facts: Mapping[str, Any]
    uv: Float[Array, "n 2"] | None = None  # in the job's atlas, where its nets take that
    part: Int[Array, " n"] | None = None  # of the scene, where it is split


@dataclass(frozen=True)
class BakedTexture:
    """The baseline: an atlas and the transfer of its covered texels, in one texture or in one for each part."""

    key: str
    atlas: Atlas
    pages: tuple[Page, ...]  # dilated
    texels: list[Texels]
    facts: Mapping[str, Any]
    radiosity: Radiosity | None  # where there are bounces


@dataclass(frozen=True)
class BakedMesh:
    """Vertex PRT: the mesh it draws, in unit coordinates, and the transfer of its vertices."""

    key: str
    mesh: Scene
    transfer: Float[Array, "v c"]
    facts: Mapping[str, Any]


@dataclass(frozen=True)
class NetPoints:
    """What a net is trained on and tested on."""

    training: PointSet
    areas: PointSet  # the independent test set
    vertices: PointSet  # the other test set
    # relative RMSE of the training set's coefficients, where it is of rays against an implicit surface's mesh
    strayed: float | None = None


@dataclass(frozen=True)
class Baked:
    """The baseline, and what the other methods of the job need."""

    texture: BakedTexture | None  # where the scene has an atlas
    lit: BakedTexture | None  # beside the transfer, light from other surfaces under the job's light
    mesh: BakedMesh | None
    points: NetPoints | None
    operator: Operator | None = None  # of the method data_driven

    @property
    def radiosity(self) -> Radiosity | None:
        """Where there are bounces."""
        return self.texture.radiosity if self.texture else None


def bake(job: Job) -> Baked:
    """Everything that rays are needed for, except the references of stage `score`."""
    baked = None if job.implicit else bake_texture(job)
    points = _net_points(job, baked) if {"net", "clusters"} & set(job.config.methods) else None
    lit = _lit(job, baked) if baked and "lit_texture" in job.config.methods else None
    mesh = bake_mesh(job, baked.radiosity) if baked and "vertex" in job.config.methods else None
    learned = operator(job) if "data_driven" in job.config.methods else None
    return Baked(baked, lit, mesh, points, learned)


def _net_points(job: Job, baked: BakedTexture | None) -> NetPoints:
    options, rays = job.config.samples, job.config.transfer.directions

    def uniform(purpose: str, count: int) -> Samples:
        return _on_surface(job, samples.area_uniform(job.scene, count, job.rng(purpose), sequence=options.sequence))

    vertices = _on_surface(job, samples.at_vertices(job.scene))
    few = job.rng("vertices").permutation(len(vertices.face))[: options.test_count]
    tested = {"areas": uniform("areas", options.test_count), "vertices": samples.select(vertices, np.sort(few))}
    learned = uniform("training", options.count)
    fewer = options.directions or rays
    training = _point_set(job, "training", learned, options.count, fewer, baked, job.training_tracer)
    areas, others = (
        _point_set(job, purpose, points, options.test_count, rays * TEST_DIRECTIONS, baked, job.reference_tracer)
        for purpose, points in tested.items()
    )
    return NetPoints(training, areas, others, _strayed(job, tested["areas"]))


def _strayed(job: Job, points: Samples) -> float | None:
    """How far transfer by rays against the mesh of an implicit surface is from that of the surface itself."""
    if not job.implicit or job.training_tracer is job.marched:
        return None
    options = job.config
    inputs = job.scene_key | {
        "bands": options.transfer.bands,
        "count": options.samples.test_count,
        "seed": options.seed,
    }

    def make() -> tuple[dict[str, Array], dict[str, float]]:
        error = accuracy.measured_error(job.tracer, job.marched, points, bands=options.transfer.bands)
        return {}, {"relative": error.relative}

    strayed = job.store.make("strayed", inputs, make).facts["relative"]
    log.info("rays against the mesh instead of the surface itself change coefficients by %.2f %%", 100 * strayed)
    return strayed


def _on_surface(job: Job, points: Samples) -> Samples:
    """Points of triangles, or of the surface that these are a mesh of."""
    return project.projected(job.implicit.field, points) if job.implicit else points


def _point_set(
    job: Job,
    purpose: str,
    points: Samples,
    count: int,
    directions: int,
    baked: BakedTexture | None,
    tracer: Tracer | MarchTracer,
) -> PointSet:
    """Points with transfer, less those that no light reaches and nobody sees."""
    inputs = job.scene_key | {"purpose": purpose, "count": count, "seed": job.config.seed}
    inputs["sequence"] = job.config.samples.sequence
    found = received(job, purpose, inputs, points, directions, baked.radiosity if baked else None, tracer)
    free = ~_enclosed(job, points, found.transfer)
    enclosed = int(np.sum(~free))
    if enclosed == len(free):
        raise PrtnetError(f"{job.scene.name}: all {len(free)} samples are enclosed, expected some that see light")
    if enclosed:
        log.info("%s: %d of %d points are fully enclosed and left out", purpose, enclosed, len(free))
    return PointSet(
        found.key,
        points.positions[free].astype(np.float32),
        points.normals[free],
        found.transfer[free],
        job.groups,
        {"seconds": found.seconds, "enclosed": enclosed, "points": len(free)},
        atlas_uv(baked.atlas, points)[free] if baked and job.config.train.texel_size else None,
        job.scene.split_sides().part[points.face[free]] if "clusters" in job.config.methods else None,
    )


def atlas_uv(atlas: Atlas, points: Samples) -> Float32[Array, "n 2"]:
    """Where points that are known by their barycentric weights are in the atlas, in [0, 1]^2, v up."""
    assert points.weights is not None
    return vertex.interpolate(atlas.uv, atlas.scene, points.face, points.weights).astype(np.float32)


def _enclosed(job: Job, points: Samples, values: Array) -> Array:
    """Points from which no direction is free. Whoever sees one from outside would be such a direction; from inside a
    room dark walls are seen, and only points with no space before them are left out: the bottoms of things."""
    dark = values[:, 0] <= 0
    if dark.any() and camera.kind_of(job.scene, job.tracer, job.config.scene.camera) == "inside":
        hidden = job.tracer.clearance(points.positions[dark], points.geometric_normals[dark]) < CLEARANCE
        dark[dark] = hidden
    return dark


def bake_texture(job: Job) -> BakedTexture:
    """The texture of a job's atlas, or what the store has of it."""
    options, inputs = job.config.atlas, inputs_of(job)
    atlas, seconds = atlas_of(job)
    texels = texture.gbuffers(atlas, options.size)
    points = texture.points(texels)
    found, radiosity = texels_and_radiosity(job, inputs, atlas, texels, points)
    facts = {"texels": len(points.positions), "uv": atlas.source, "seconds": seconds + found.seconds}
    return BakedTexture(found.key, atlas, _pages(job, texels, found.transfer), texels, facts, radiosity)


def _pages(job: Job, texels: list[Texels], values: Array) -> tuple[Page, ...]:
    options = job.config.atlas
    levels = mipmap.level_count(padding_of(options)) if options.mipmaps else 1
    parts = np.split(values, np.cumsum([len(page.index) for page in texels])[:-1])
    return tuple(
        texture.page(page, part, dilation=options.dilation, levels=levels)
        for page, part in zip(texels, parts, strict=True)
    )


def _lit(job: Job, baked: BakedTexture) -> BakedTexture:
    """Groups of coefficients: the transfer, and SH of the light from other surfaces in red, green and blue."""
    assert baked.radiosity is not None
    bands, points = job.config.transfer.bands, texture.points(baked.texels)
    rays, light = job.config.transfer.directions, job.light.coefficients(job.config.transfer.bands)
    inputs = inputs_of(job)
    direct = traced(job, "texture", inputs, points, rays)
    made = incident(job, "texture_incident", inputs, points, rays, baked.radiosity, light, title="texture, lit")
    seen = made.arrays["transfer"].reshape(len(points.positions), sh.count(bands), 3)
    values = np.concatenate([direct.arrays["transfer"], *np.moveaxis(seen, -1, 0)], axis=1)
    facts = {"seconds": baked.facts["seconds"] + made.facts["seconds"]}
    return BakedTexture(made.key, baked.atlas, _pages(job, baked.texels, values), baked.texels, facts, baked.radiosity)


def bake_mesh(job: Job, radiosity: Radiosity | None) -> BakedMesh:
    """The vertices of a job, or what the store has of them."""
    options = job.config.vertex
    mesh = vertex.mesh(job.scene, options.subdivide, options.level)
    cut = sorted(set(options.subdivide)) if options.level else []
    inputs = job.scene_key | {"subdivide": cut, "level": options.level if cut else 0, "seed": job.config.seed}
    found = received(job, "vertex", inputs, vertex.points(mesh), job.config.transfer.directions, radiosity)
    return BakedMesh(found.key, mesh, found.transfer, {"seconds": found.seconds})
