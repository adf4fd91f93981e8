"""The lights of a database, the same whenever they are drawn; a longer list begins with the shorter one."""

import numpy as np
from jaxtyping import Bool

from prtnet.data.lighting import direct, placing, scenario
from prtnet.data.lighting.lamp import Lighting, from_dict, together
from prtnet.data.samples import Samples
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer
from prtnet.pipeline.data_driven import options as words
from prtnet.pipeline.job import Job

TRAINING, UNSEEN = "training", "unseen"
PROBES = 64  # lights that tell which surfaces are worth measuring


def lights_of(job: Job, scene: Scene, tracer: Tracer, purpose: str, keyframe: int = 0) -> list[Lighting]:
    """Those to learn from, or the unseen ones, of a keyframe: first the user's own.

    Raises PrtnetError for scenarios without light and own lamps inside geometry.
    """
    options, own = job.config.data_driven, own_of(job) if purpose == UNSEEN else []
    placing.check(together(own), scene, tracer)
    return own + scenario.draw(
        words.kinds(options, purpose),
        options.unseen if purpose == UNSEEN else options.configurations,
        scene,
        tracer,
        job.rng(purpose, keyframe),
        colours=options.colours,
        bands=job.config.transfer.bands,
    )


def own_of(job: Job) -> list[Lighting]:
    """The lamps that the options name, each by itself."""
    return [from_dict({"lamps": [dict(lamp)]}) for lamp in job.config.data_driven.lights]


def reached(job: Job, points: Samples) -> Bool[np.ndarray, " n"]:
    """Which points of the scene get light from any of the first lights that are learned from.

    What none of them reaches measures nothing: on a Cornell box that is lit from within, half of the surface.
    """
    lights = lights_of(job, job.scene, job.tracer, TRAINING)[:PROBES]
    if any(each.environment is not None for each in lights):
        return np.ones(len(points.face), bool)
    places = points.positions, points.normals, points.geometric_normals
    return np.any(direct.irradiances(lights, job.tracer, *places) > 0, axis=(0, 2))
