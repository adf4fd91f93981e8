"""Stage `view`: the methods of a job in a window."""

import logging
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, replace

from prtnet import PrtnetError
from prtnet.config import MaterialOptions
from prtnet.data import light
from prtnet.data.light import Light
from prtnet.export import gloss
from prtnet.pipeline.bake import Baked
from prtnet.pipeline.export import Exported
from prtnet.pipeline.job import Job
from prtnet.pipeline.methods import makers
from prtnet.pipeline.train import Trained
from prtnet.pipeline.views import cameras_of, drawing_of
from prtnet.render.camera import Camera
from prtnet.render.material import Material
from prtnet.render.method import Shaded
from prtnet.view import window
from prtnet.view.picture import Show
from prtnet.view.state import Orbit, State

log = logging.getLogger(__name__)

LIGHTS = ("sky", "constant", "gradient", "sun", "directional", "green")
SHOWN = ("texture", "unshadowed", "vertex", "net", "clusters")
METERED = 2  # views by which the exposure is chosen
# of a run whose own material has no gloss; as configs/material/glossy.yaml
VARNISH = Material(0.5, (0.5, 0.5, 0.5), 20.0)


def view(job: Job, baked: Baked, trained: Trained | None, exported: Exported) -> None:
    """A window, until it is closed; what its keys do stands in `prtnet.view.state.KEYS`. Screenshots go to the run's
    folder. Raises PrtnetError where no window can be opened."""
    cameras = cameras_of(job)
    lights = lights_of(job)
    state = state_of(job, cameras[0], lights)
    log.info("view: H shows the keys, Esc ends")
    title = f"prtnet {job.scene.name}"
    window.run(title, lambda: show_of(job, baked, trained, exported, cameras, lights), state, job.out)


def lights_of(job: Job) -> dict[str, Light]:
    """By name: the run's own first, then those by formula."""
    found = {job.light_name: job.light}
    for name in LIGHTS:
        # one that holds no light, by this very configuration
        with suppress(PrtnetError):
            found.setdefault(name, light.by_name(name, job.config.light))
    return found


def state_of(job: Job, first: Camera, lights: Mapping[str, Light]) -> State:
    """The first view of the job's path in its material and light, by its net where it has one."""
    methods = [name for name in SHOWN if name in job.config.methods]
    return State(
        Orbit.of(first),
        methods,
        list(lights),
        method=methods[-1],
        glossy=job.material.glossy,
        has_gloss=_glossy(job) is not None,
    )


def show_of(
    job: Job,
    baked: Baked,
    trained: Trained | None,
    exported: Exported,
    cameras: list[Camera],
    lights: Mapping[str, Light],
) -> Show:
    """The scene with everything that the window may be asked for, on the graphics card of the context at hand."""
    drawing = drawing_of(job, baked)

    def make(name: str, material: Material) -> Shaded:
        return makers(_with_material(job, material), baked, trained, exported, drawing)[name]().shaded

    bands, _ = job.material.orders(job.config.transfer.bands)
    coefficients = {name: each.coefficients(bands) for name, each in lights.items()}
    return Show(drawing.scene, cameras[:METERED], coefficients, _diffuse(job.material), _glossy(job), make)


def _diffuse(material: Material) -> Material:
    parts = {name: replace(part, specular=None) for name, part in material.parts.items()}
    return replace(material, specular=(0.0, 0.0, 0.0), parts=parts)


def _glossy(job: Job) -> Material | None:
    """By the product that takes any light; None where the job has more bands than gloss can."""
    own = job.material
    found = own if own.glossy else replace(VARNISH, light_bands=own.light_bands, radiance_bands=own.radiance_bands)
    bands = job.config.transfer.bands
    with suppress(PrtnetError):
        gloss.check(bands, *found.orders(bands))
        return replace(found, product="full")
    return None


def _with_material(job: Job, material: Material) -> Job:
    """The job as if it had been configured so."""
    words = asdict(material)
    words["specular"] = list(material.specular)
    words["parts"] = {
        name: {word: value for word, value in asdict(part).items() if value is not None}
        for name, part in material.parts.items()
    }
    return replace(job, config=replace(job.config, material=MaterialOptions(**words)))
