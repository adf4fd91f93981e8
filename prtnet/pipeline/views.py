"""What every method is compared with: the views, and the transfer traced at each of their pixels."""

from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Bool, Float

from prtnet.data.samples import Samples
from prtnet.pipeline.bake import traced
from prtnet.pipeline.job import Job
from prtnet.render import camera
from prtnet.render import gbuffer as gbuffers
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import GBuffer
from prtnet.render.raster import Raster

Array = np.ndarray
Image = Float[Array, "h w 3"]


@dataclass(frozen=True)
class View:
    """One camera and what is known of its pixels before any method is drawn."""

    camera: Camera
    gbuffer: GBuffer
    covered: Bool[Array, "h w"]
    reference: Image
    exact: Image | None = None  # without SH, where there is one


def views_of(job: Job, drawing: Raster, coefficients: Array, *, most: int | None = None) -> list[View]:
    """The cameras of the scene's path with their references; the first `most` of them."""
    path = camera.path(job.scene, job.tracer, job.config.render.views, kind=job.config.scene.camera)
    found = []
    for index, eye in enumerate(path[:most]):
        gbuffer = drawing.gbuffer(eye)
        title = f"traced view {index + 1} of {len(path)}"
        baked = traced_view(job, title, eye, gbuffer, announce=0 if index else len(path))
        covered = np.zeros(gbuffer.size * gbuffer.size, bool)
        covered[gbuffer.pixel] = True
        reference = gbuffers.shade(gbuffer, baked, coefficients, job.material)
        found.append(View(eye, gbuffer, covered.reshape(gbuffer.size, -1), reference))
    return found


def traced_view(job: Job, title: str, eye: Camera, gbuffer: GBuffer, *, announce: int = 0, repeat: int = 0) -> Array:
    """The transfer of each covered pixel, at that very pixel. `repeat` turns every pixel's rays by other angles."""
    inputs = job.scene_key | {"camera": asdict(eye), "size": gbuffer.size, "repeat": repeat, "seed": job.config.seed}
    points = Samples(gbuffer.positions.astype(np.float64), gbuffer.normals, gbuffer.geometric_normals, gbuffer.face)
    directions = job.config.render.traced_directions
    baked = traced(job, "traced", inputs, points, directions, title=title, salt=repeat, announce=announce)
    return baked.arrays["transfer"]
