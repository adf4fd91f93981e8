"""The operator of a job: learned from its database, and how near it comes under lights it has not seen."""

import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError, data_driven
from prtnet.data_driven import DataDriven
from prtnet.models.data_driven import Learned, Pairs, learn
from prtnet.pipeline.data_driven import options as words
from prtnet.pipeline.data_driven.database import Database, database
from prtnet.pipeline.data_driven.errors import errors, learned_from
from prtnet.pipeline.data_driven.ground import Ground, ground_of
from prtnet.pipeline.data_driven.lights import TRAINING, UNSEEN
from prtnet.pipeline.job import Job

log = logging.getLogger(__name__)
Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Operator:
    """Basis and matrices of a job with what they come from."""

    key: str
    spec: DataDriven
    ground: Ground
    training: Database
    unseen: Database
    facts: Mapping[str, Any]


def operator(job: Job) -> Operator:
    """The operator of a job's options, and its errors."""
    options = job.config.data_driven
    ground = ground_of(job)
    training, unseen = (database(ground, purpose) for purpose in (TRAINING, UNSEEN))
    names = ("elements", "ridge", "channels", "gamma", "matrices", "renderer")
    inputs = {name: getattr(options, name) for name in names}
    inputs |= {"training": training.key, "unseen": unseen.key, "scene": job.scene.digest()}
    kept = job.store.get("data_driven", inputs)
    if kept is None:
        spec, facts = _learned(ground, training, unseen)
        kept = job.store.put("data_driven", inputs, lambda path: data_driven.save(spec, path), facts)
    spec = of_scene(kept.path, job)
    if dark := kept.facts["dark"]:
        total = kept.facts["used"] + dark
        log.info("data-driven: measurement points miss %d of %d lights in a colour; not learned from", dark, total)
    log.info(
        "data-driven: %d elements, RMSE %.4g on unseen lights, %.2f x the projection's",
        spec.elements, kept.facts["unseen"]["rmse"], kept.facts["unseen"]["ratio"],
    )  # fmt: skip
    return Operator(kept.key, spec, ground, training, unseen, kept.facts)


def of_scene(path: Path, job: Job) -> DataDriven:
    """What a file holds. Raises PrtnetError where it was made for another scene."""
    spec = data_driven.load(path)
    if spec.scene != job.scene.digest():
        raise PrtnetError(
            f"{path}: found data-driven transfer of another scene than {job.scene.name}, expected that of this one;"
            " learn it anew (methods=[data_driven])"
        )
    return spec


def _learned(ground: Ground, training: Database, unseen: Database) -> tuple[DataDriven, dict[str, Any]]:
    job, options = ground.job, ground.job.config.data_driven
    start = time.process_time()
    pairs = Pairs(training.lightmaps, training.direct, training.keyframe)
    found = learn(
        pairs,
        elements=options.elements,
        ridge=options.ridge,
        channels=options.channels,
        gamma=options.gamma,
        matrices=options.matrices,
    )
    seconds = time.process_time() - start
    matrices = _of_keyframes(found, len(ground.keyframes))
    spec = DataDriven(
        found.basis,
        matrices,
        tuple(keyframe.measurement for keyframe in ground.keyframes),
        ground.texels.index.astype(np.int32),
        ground.texels.size,
        job.scene.digest(),
        options.gamma,
        "radiance" if options.renderer == words.SUBSURFACE else "irradiance",
    )
    sizes = learned_from(training.lightmaps, training.direct)
    measured = {TRAINING: _errors(spec, training, sizes), UNSEEN: _errors(spec, unseen, None)}
    level = float(np.sqrt(np.mean(training.lightmaps.astype(np.float64) ** 2)))
    facts = measured | {
        "cpu_seconds": seconds,
        "database_seconds": training.seconds + unseen.seconds,
        "training_seconds": training.seconds,
        "used": found.used,
        "dark": found.dark,
        "noise": float(np.sqrt(np.mean(training.noise**2))),
        "level": level,
    }
    return spec, facts


def _of_keyframes(found: Learned, count: int) -> Array:
    """One matrix for all keyframes is that of each."""
    return np.broadcast_to(found.matrices, (count, *found.matrices.shape[1:])).copy()


def _errors(spec: DataDriven, found: Database, sizes: Float[Array, "c 3"] | None) -> dict[str, float]:
    chosen = {"gamma": spec.gamma, "keyframe": found.keyframe, "sizes": sizes}
    return errors(spec.basis, spec.matrices, found.lightmaps, found.direct, **chosen).words()
