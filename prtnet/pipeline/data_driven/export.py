"""The files of a run's operator with their certificate, and its page with a light to move."""

import logging

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
        measured = data_driven_check.errors_and_timing(
            made.spec, made.unseen.direct[:CHECKED_LIGHTS], made.unseen.keyframe[:CHECKED_LIGHTS]
        )
        files.write(job.out, made.spec, measured, version=version)
        store.write_text(stamp, key)
        log.info("export: %s and the shaders that read it", job.out / files.SPEC)
