"""The scene of a job as a GLB with its light baked in: part of stage `export` with `export.lightmap=true`."""

import logging
from dataclasses import asdict
from math import pi, sqrt

import numpy as np
from jaxtyping import Float32

from prtnet import store
from prtnet.data.texture import Page
from prtnet.export import lightmap
from prtnet.export.lightmap import Lightmap, View
from prtnet.export.texture_file import CONVENTION
from prtnet.pipeline.bake import BakedTexture
from prtnet.pipeline.job import Job
from prtnet.pipeline.views import cameras_of
from prtnet.render.material import irradiance

log = logging.getLogger(__name__)
Array = np.ndarray

OPENNESS = sqrt(4 * pi) / pi  # times t_0


def write_lightmap(job: Job, baked: BakedTexture) -> None:
    """Write lightmap.glb, .png and .exr into the run folder, where they are not those of this bake and light yet."""
    bands, _ = job.material.orders(job.config.transfer.bands)
    light = job.light.coefficients(bands)
    first = cameras_of(job)[0]
    about = {
        "name": job.scene.name,
        "bands": job.config.transfer.bands,
        "groups": job.groups,
        "convention": CONVENTION,
        "light": {"name": job.light_name, "coefficients": light.tolist()},
    }
    made = {"format": lightmap.FORMAT, "bake": baked.key, "dilation": job.config.atlas.dilation}
    key, stamp = store.content_key(made | about | asdict(first)), job.out / ".lightmap.key"
    written = [lightmap.GLB, lightmap.EXR, *lightmap.names(len(baked.pages))]
    if stamp.exists() and stamp.read_text() == key and all((job.out / name).exists() for name in written):
        return
    pages = [of_page(page, light, job.groups) for page in baked.pages]
    view = View(first.eye, first.basis(), first.fov_y, first.near, first.far)
    lightmap.write(job.out, baked.atlas, pages, job.frame, fronts=len(job.scene.faces), about=about, view=view)
    store.write_text(stamp, key)
    log.info("export: %s with the light of the run", job.out / lightmap.GLB)


def of_page(page: Page, light: Float32[Array, "k 3"], groups: int) -> Lightmap:
    """What a page's transfer receives from a light; ringing below 0 is clipped."""
    transfer = page.levels[0]
    flat = transfer.reshape(-1, transfer.shape[2])
    received = np.maximum(irradiance(flat, light, groups), 0).astype(np.float32)
    return Lightmap(received.reshape(*transfer.shape[:2], 3), np.clip(OPENNESS * transfer[..., 0], 0, 1))
