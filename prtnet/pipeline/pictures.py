"""The first view of each method as the display options show it: one PNG each in the run's folder `pictures`."""

import logging
from collections.abc import Mapping
from dataclasses import asdict

import numpy as np
from jaxtyping import Float
from PIL import Image

from prtnet import score, store
from prtnet.pipeline.bake import Baked
from prtnet.pipeline.exact import add_exact, light_key
from prtnet.pipeline.export import Exported
from prtnet.pipeline.job import Job
from prtnet.pipeline.methods import make_all
from prtnet.pipeline.score import Scored
from prtnet.pipeline.train import Trained
from prtnet.pipeline.views import drawing_of, traced_view, views_of
from prtnet.render import display
from prtnet.render.display import Display

log = logging.getLogger(__name__)
Array = np.ndarray

FOLDER = "pictures"


def write_pictures(job: Job, baked: Baked, trained: Trained | None, exported: Exported, scored: Scored) -> None:
    """Draw and write them where one of the options asks for it and they are not there yet."""
    if not job.config.render.pictures and job.display == Display():
        return
    folder = job.out / FOLDER
    stamp = folder / ".key"
    key = store.content_key({"score": scored.key, "display": asdict(job.display), "light": light_key(job.light)})
    if stamp.exists() and stamp.read_text() == key:
        return
    exposure = scored.facts["exposure"]
    for name, image in _frames(job, baked, trained, exported).items():
        shown = score.srgb_encode(display.show(job.display, image, exposure))
        with store.atomic(folder / f"{name}.png") as temporary:
            Image.fromarray(np.rint(255 * shown).astype(np.uint8)).save(temporary, format="PNG")
    store.write_text(stamp, key)
    log.info("pictures: %s", folder)


def _frames(job: Job, baked: Baked, trained: Trained | None, exported: Exported) -> Mapping[str, Float[Array, "h w 3"]]:
    """The first view of the references and of every method, linear RGB, the light mirrored in it where it shall be."""
    bands_light, _ = job.material.orders(job.config.transfer.bands)
    coefficients = job.light.coefficients(bands_light)
    drawing = drawing_of(job, baked)
    first = add_exact(job, views_of(job, drawing, coefficients, baked.radiosity, most=1))[0]
    frames = {"traced": first.reference} | ({} if first.exact is None else {"exact": first.exact})
    for name, method in make_all(job, baked, trained, exported, drawing).items():
        frames[name] = method.shaded.draw(first.camera, coefficients)
    if job.display.highlights:
        transfer = traced_view(job, "traced view 1", first.camera, first.gbuffer)
        mirrored = display.highlights(job.light, first.gbuffer, transfer, job.display.highlights)
        frames = {name: image + mirrored for name, image in frames.items()}
    return frames
