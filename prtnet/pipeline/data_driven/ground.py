"""Where lightmaps are and where light is measured, in each pose of an animated scene."""

from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
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
from prtnet.data.texture import Page, Texels
from prtnet.data.tracer import Tracer
from prtnet.data_driven import Measurement
from prtnet.pipeline.atlas import atlas_of, inputs_of
from prtnet.pipeline.data_driven import lights, options
from prtnet.pipeline.job import Job
from prtnet.pipeline.transport import traced

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
    # of the texels, and as a texture, where there is light from far away
    transfer: Float32[Array, "t k"] | None = None
    pages: tuple[Page, ...] | None = None

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
    if options.environments(chosen):
        frames = [_under_a_sky(job, frame, pages[0]) for frame in frames]
    return Ground(job, pages[0], surface.texel_albedo(atlas, pages), place, tuple(frames))


def _measurement(job: Job) -> Measurement:
    chosen = job.config.data_driven
    wanted = (job.scene, chosen.points, chosen.supersampling, job.rng("measurement"))
    if chosen.place == "hull":
        return measurement.on_hull(*wanted)
    return measurement.on_surface(*wanted, reached=partial(lights.reached, job))


def _keyframe(
    job: Job, atlas: Atlas, points: Samples, measured: Measurement, number: int, pose: tuple[Pose, ...]
) -> Keyframe:
    scene, drawn = job.scene, atlas.scene
    for each in pose:
        points = poses.posed_points(drawn, points, each)
        measured = poses.posed_measurement(scene, measured, each)
        scene, drawn = poses.posed(scene, each), poses.posed(drawn, each)
    kind = job.tracer.kind
    return Keyframe(number, pose, scene, replace(atlas, scene=drawn), points, measured, kind)


def _under_a_sky(job: Job, keyframe: Keyframe, texels: Texels) -> Keyframe:
    """With the transfer of its texels and of its measurement points, for light from far away."""
    inputs = inputs_of(job) | ({"pose": [asdict(pose) for pose in keyframe.pose]} if keyframe.pose else {})
    rays = job.config.transfer.directions
    made = traced(job, "texture", inputs, keyframe.points, rays, announce=0, tracer=keyframe.tracer)
    transfer = made.arrays["transfer"]
    page = texture.page(texels, transfer, dilation=job.config.atlas.dilation)
    return replace(keyframe, measurement=_with_transfer(job, keyframe), transfer=transfer, pages=(page,))


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
