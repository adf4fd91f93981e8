"""What every method is compared with: the views, and the transfer traced at each of their pixels."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from prtnet import score
from prtnet.data.samples import Samples
from prtnet.pipeline.bake import Baked
from prtnet.pipeline.job import Job
from prtnet.pipeline.transport import Radiosity, incident, traced
from prtnet.render import camera
from prtnet.render import gbuffer as gbuffers
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import GBuffer
from prtnet.render.marched import Drawing, Marched
from prtnet.render.raster import Raster

Array = np.ndarray
Image = Float[Array, "h w 3"]

FEWER = 4  # times fewer rays look for light from surfaces: it has no hard edges, and rays that fetch are slower


@dataclass(frozen=True)
class View:
    """One camera and what is known of its pixels before any method is drawn."""

    camera: Camera
    gbuffer: GBuffer
    covered: Bool[Array, "h w"]
    reference: Image
    exact: Image | None = None  # without SH, where there is one


def cameras_of(job: Job) -> list[Camera]:
    """Of the scene's path, one for each view."""
    return camera.path(job.scene, job.tracer, job.config.render.views, kind=job.config.scene.camera)


def drawing_of(job: Job, baked: Baked, size: int | None = None) -> Drawing:
    """What the job's methods are drawn by: triangles, or rays through an implicit surface."""
    size = size or job.config.render.size
    if baked.texture:
        return Raster(baked.texture.atlas, size)
    assert job.implicit
    return Marched(job.implicit, size)


def views_of(
    job: Job, drawing: Drawing, coefficients: Array, radiosity: Radiosity | None, *, most: int | None = None
) -> list[View]:
    """The cameras of the scene's path with their references; the first `most` of them."""
    path = cameras_of(job)
    found = []
    for index, eye in enumerate(path[:most]):
        gbuffer = drawing.gbuffer(eye)
        title = f"traced view {index + 1} of {len(path)}"
        reference = reference_of(job, title, eye, gbuffer, coefficients, radiosity, announce=0 if index else len(path))
        found.append(View(eye, gbuffer, gbuffer.covered, reference))
    return found


def reference_of(
    job: Job,
    title: str,
    eye: Camera,
    gbuffer: GBuffer,
    coefficients: Array,
    radiosity: Radiosity | None,
    *,
    announce: int = 0,
    repeat: int = 0,
) -> Image:
    """Each covered pixel from transfer, and light from other surfaces, traced at that very pixel.

    `repeat` turns every pixel's rays by other angles.
    """
    transfer = traced_view(job, title, eye, gbuffer, announce=announce, repeat=repeat)
    seen = None
    if radiosity is not None:
        inputs, points = _at(job, eye, gbuffer, repeat)
        fewer = max(1, job.config.render.traced_directions // FEWER)
        title = f"{title}, bounces"
        made = incident(
            job, "traced_incident", inputs, points, fewer, radiosity, coefficients, title=title, salt=repeat
        )
        seen = made.arrays["transfer"].reshape(len(gbuffer.pixel), -1, 3)
    return gbuffers.shade(gbuffer, transfer, coefficients, job.material, incident=seen)


def traced_view(job: Job, title: str, eye: Camera, gbuffer: GBuffer, *, announce: int = 0, repeat: int = 0) -> Array:
    """The direct transfer of each covered pixel, "n k"; `repeat` as in `reference_of`."""
    inputs, points = _at(job, eye, gbuffer, repeat)
    directions = job.config.render.traced_directions
    rays = job.reference_tracer
    baked = traced(job, "traced", inputs, points, directions, title=title, salt=repeat, announce=announce, tracer=rays)
    return baked.arrays["transfer"]


def _at(job: Job, eye: Camera, gbuffer: GBuffer, repeat: int) -> tuple[dict[str, Any], Samples]:
    """What the transfer of a view's pixels depends on, and these as points."""
    inputs = job.scene_key | {"camera": asdict(eye), "size": gbuffer.size, "repeat": repeat, "seed": job.config.seed}
    points = Samples(gbuffer.positions.astype(np.float64), gbuffer.normals, gbuffer.geometric_normals, gbuffer.face)
    return inputs, points


def row_of(job: Job, metrics: score.Metrics, method: str, reference: str, costs: Mapping[str, Any]) -> score.Row:
    """A method's row in the scores of this job."""
    return score.row(
        metrics,
        scene=job.scene.name,
        method=method,
        material=job.material.name,
        light=job.light_name,
        reference=reference,
        **costs,
    )
