"""The files of a run's operator with their certificate, and its page with a light to move."""

import logging

import numpy as np

from prtnet import store
from prtnet.export import data_driven as files
from prtnet.pipeline.data_driven.learn import Operator
from prtnet.pipeline.job import Job
from prtnet.render import data_driven_check

log = logging.getLogger(__name__)

CHECKED_LIGHTS = 8


def export(job: Job, made: Operator) -> None:
    """Write what is not of this operator yet. Raises PrtnetError where the shaders do not compute what NumPy does."""
    stamp, version = job.out / ".data_driven.key", job.config.export.version
    key = store.content_key({"operator": made.key, "version": version})
    written = all((job.out / name).exists() for name in files.NAMES)
    if not (written and stamp.exists() and stamp.read_text() == key):
        stamp.unlink(missing_ok=True)
        unseen = made.unseen
        few = np.unique(np.linspace(0, len(unseen.direct) - 1, CHECKED_LIGHTS).round().astype(int))
        measured = data_driven_check.errors_and_timing(made.spec, unseen.direct[few], unseen.keyframe[few])
        files.write(job.out, made.spec, measured, version=version)
        store.write_text(stamp, key)
        log.info("export: %s and the shaders that read it", job.out / files.SPEC)
