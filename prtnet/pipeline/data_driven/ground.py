"""Where lightmaps are and where light is measured, in each pose of an animated scene."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float32

from prtnet import sh
from prtnet.data import measurement, surface, texture
from prtnet.data import transfer as transfers
from prtnet.data.atlas import Atlas
from prtnet.data.lightmap import poses
from prtnet.data.lightmap.poses import Pose
from prtnet.data.samples import Samples
from prtnet.data.scene import Scene
from prtnet.data.surface import Surface
from prtnet.data.texture import Texels
from prtnet.data.tracer import Tracer
from prtnet.data_driven import Measurement
from prtnet.pipeline.atlas import atlas_of, inputs_of
from prtnet.pipeline.data_driven import options
from prtnet.pipeline.job import Job

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Keyframe:
    """The scene in one pose: where its texels are, and where light is measured."""

    number: int
    pose: tuple[Pose, ...]
    scene: Scene
    atlas: Atlas
    points: Samples
    measurement: Measurement
    kind: str  # of its tracer

    @cached_property
    def tracer(self) -> Tracer:
        return Tracer(self.scene, kind=self.kind)


@dataclass(frozen=True, eq=False)
class Ground:
    """What all keyframes share: the atlas's texels, what they reflect, how a ray finds them."""

    job: Job  # with an atlas of the lightmaps' size
    texels: Texels
    albedo: Float32[Array, "t 3"]
    surface: Surface
    keyframes: tuple[Keyframe, ...]

    @property
    def inputs(self) -> dict[str, Any]:
        """What the texels depend on."""
        return inputs_of(self.job)


def ground_of(job: Job) -> Ground:
    """Raises PrtnetError for poses of parts that are not there and more points than the surface holds."""
    chosen = job.config.data_driven
    job = replace(job, config=replace(job.config, atlas=replace(job.config.atlas, size=chosen.size)))
    atlas, _ = atlas_of(job)
    pages = texture.gbuffers(atlas, chosen.size)
    place = surface.of_atlas(job.scene, atlas, pages)
    points, measured = texture.points(pages), _measurement(job)
    every = [(poses.parse(words),) for words in chosen.keyframes] or [()]
    frames = [_keyframe(job, atlas, points, measured, number, pose) for number, pose in enumerate(every)]
    return Ground(job, pages[0], surface.texel_albedo(atlas, pages), place, tuple(frames))


def _measurement(job: Job) -> Measurement:
    chosen = job.config.data_driven
    place = {"surface": measurement.on_surface, "hull": measurement.on_hull}[chosen.place]
    return place(job.scene, chosen.points, chosen.supersampling, job.rng("measurement"))


def _keyframe(
    job: Job, atlas: Atlas, points: Samples, measured: Measurement, number: int, pose: tuple[Pose, ...]
) -> Keyframe:
    scene, drawn = job.scene, atlas.scene
    for each in pose:
        points = poses.posed_points(drawn, points, each)
        measured = poses.posed_measurement(scene, measured, each)
        scene, drawn = poses.posed(scene, each), poses.posed(drawn, each)
    kind = job.tracer.kind
    found = Keyframe(number, pose, scene, replace(atlas, scene=drawn), points, measured, kind)
    if options.environments(job.config.data_driven):
        found = replace(found, measurement=_with_transfer(job, found))
    return found


def _with_transfer(job: Job, keyframe: Keyframe) -> Measurement:
    """What light from far away adds at each measurement point: the mean of albedo / pi times transfer."""
    measured, options = keyframe.measurement, job.config.transfer
    flat = [getattr(measured, name).reshape(-1, 3) for name in ("positions", "normals", "geometric_normals")]
    found = transfers.bake(
        keyframe.tracer,
        flat[0],
        flat[1],
        bands=options.bands,
        directions=options.directions,
        rng=job.rng("measured transfer"),
        geometric_normals=flat[2],
        kind=options.kind,
        threads=job.config.threads,
    )
    shape = *measured.albedo.shape[:2], sh.count(options.bands)
    mean = np.einsum("msk,msc->mkc", found.reshape(shape), measured.albedo / np.pi, dtype=np.float64)
    return replace(measured, transfer=(mean / shape[1]).astype(np.float32))
