"""What pictures of data-driven transfer are held against: paths that begin at each pixel, or Mitsuba's camera."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from prtnet import console
from prtnet.data import transfer
from prtnet.data.lighting import lamp
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.lightmap import paths
from prtnet.data.samples import Samples
from prtnet.pipeline.data_driven import options
from prtnet.pipeline.data_driven.ground import Keyframe
from prtnet.pipeline.data_driven.learn import Operator
from prtnet.pipeline.job import Job
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import GBuffer

Array = np.ndarray
Image = Float[Array, "h w 3"]


@dataclass(frozen=True, eq=False)
class Lit:
    """One picture: a view of a keyframe under an unseen light. `number`: of that light in the database."""

    camera: Camera
    gbuffer: GBuffer
    lighting: Lighting
    number: int
    keyframe: int


def references(job: Job, made: Operator, pictures: Sequence[Lit], *, repeat: int = 0) -> list[Image]:
    """Each pixel by paths that begin at that very pixel, the same paths for all lights; `repeat` takes others."""
    found: dict[int, Image] = {}
    together: dict[tuple[Camera, int], list[int]] = {}
    for number, each in enumerate(pictures):
        together.setdefault((each.camera, each.keyframe), []).append(number)
    for numbers in together.values():
        few = [pictures[number] for number in numbers]
        if job.config.data_driven.renderer == options.SUBSURFACE:
            images = [_through_media(job, made, each, repeat) for each in few]
        else:
            irradiance = _path_traced(job, made, few, repeat)
            images = [
                each.gbuffer.image(each.gbuffer.albedo / np.pi * values)
                for each, values in zip(few, irradiance, strict=True)
            ]
        found |= dict(zip(numbers, images, strict=True))
    return [found[number] for number in range(len(pictures))]


def _through_media(job: Job, made: Operator, shown: Lit, repeat: int) -> Image:
    """By Mitsuba's own camera and integrator; what is not covered stays black, as in every method."""
    from prtnet.data.lightmap import subsurface

    chosen, eye = job.config.data_driven, shown.camera
    keyframe, size = made.ground.keyframes[shown.keyframe], shown.gbuffer.size
    inputs = _picture_inputs(job, keyframe, [shown]) | {"paths": [chosen.samples, chosen.density, repeat]}

    def make() -> tuple[dict[str, Array], dict[str, Any]]:
        places = (np.asarray(eye.eye), np.asarray(eye.target), np.asarray(eye.up), eye.fov_y)
        found = subsurface.view(
            keyframe.scene,
            places,
            shown.lighting,
            size=size,
            samples=chosen.samples,
            density=chosen.density,
            seed=int(job.rng("paths", repeat).integers(1 << 31)),
        )
        return {"radiance": np.where(shown.gbuffer.covered[..., None], found, 0).astype(np.float32)}, {}

    return job.store.make("paths", inputs, make).arrays["radiance"]


def _picture_inputs(job: Job, keyframe: Keyframe, pictures: Sequence[Lit]) -> dict[str, Any]:
    """What references of one view depend on, but for their paths."""
    return job.scene_key | {
        "camera": asdict(pictures[0].camera),
        "size": pictures[0].gbuffer.size,
        "lights": [lamp.to_dict(each.lighting) for each in pictures],
        "pose": [asdict(pose) for pose in keyframe.pose],
        "seed": job.config.seed,
    }


def _path_traced(job: Job, made: Operator, pictures: Sequence[Lit], repeat: int) -> Float32[Array, "l n 3"]:
    """Irradiance of the covered pixels of one view under several lights."""
    chosen, gbuffer = job.config.data_driven, pictures[0].gbuffer
    keyframe = made.ground.keyframes[pictures[0].keyframe]
    points = Samples(gbuffer.positions.astype(np.float64), gbuffer.normals, gbuffer.geometric_normals, gbuffer.face)
    inputs = _picture_inputs(job, keyframe, pictures) | {"paths": [chosen.samples, chosen.bounces, repeat]}

    def make() -> tuple[dict[str, Array], dict[str, Any]]:
        distant = _transfer(job, keyframe, points, repeat) if keyframe.pages else None
        with console.progress("path-traced reference", len(gbuffer.pixel), "pixels") as reach:
            found = paths.radiance(
                keyframe.tracer,
                keyframe.scene,
                points,
                gbuffer.albedo,
                [each.lighting for each in pictures],
                samples=chosen.samples,
                bounces=chosen.bounces,
                rng=job.rng("paths", repeat),
                transfer_of=distant,
                threads=job.config.threads,
                progress=reach,
            )
        return {"irradiance": found.direct + found.indirect}, {"noise": float(np.mean(found.noise))}

    return job.store.make("paths", inputs, make).arrays["irradiance"]


def _transfer(job: Job, keyframe: Keyframe, points: Samples, repeat: int) -> Float[Array, "n k"]:
    """Of pixels, so that light from far away is exact where it is direct."""
    places, options = (points.positions, points.normals), job.config.transfer
    rays = {"directions": job.config.render.traced_directions, "rng": job.rng("pixels", repeat)}
    chosen = {"bands": options.bands, "kind": options.kind, "threads": job.config.threads}
    return transfer.bake(keyframe.tracer, *places, geometric_normals=points.geometric_normals, **rays, **chosen)
