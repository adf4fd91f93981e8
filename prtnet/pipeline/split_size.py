"""The size of each cluster's network: the search of stage `size`, by the cluster's own pixels of the views."""

import logging
from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from prtnet import clusters, store
from prtnet.data.scene import Frame
from prtnet.pipeline import candidates
from prtnet.pipeline.bake import Baked, NetPoints
from prtnet.pipeline.job import Job
from prtnet.pipeline.size import chosen
from prtnet.pipeline.split_plan import Plan
from prtnet.pipeline.trials import Region, Trials
from prtnet.render.gbuffer import GBuffer

log = logging.getLogger(__name__)
Array = np.ndarray


def sized(job: Job, baked: Baked, points: NetPoints, plan: Plan, index: int, cube: Frame) -> Job:
    """The cluster's job with the network that was chosen for it; unchanged where no view shows the cluster.

    Leaves size.md in the folder of that job. Raises PrtnetError where no candidate meets the target.
    """

    def inside(seen: GBuffer) -> Bool[Array, " n"]:
        """Pixels in which no other cluster weighs more."""
        weights = clusters.blend(plan.split, plan.cluster, job.config.split.delta, seen.positions, seen.part)
        return weights.argmax(axis=1) == index

    key = store.content_key({"cluster": index, "points": points.training.key})
    trials = Trials(job, baked, points, Region(key, cube, inside))
    if not trials.visible():
        log.info("clusters: no view shows cluster %d, whose network keeps the size of model.*", index)
        return job
    return replace(job, config=candidates.configured(job.config, chosen(job, trials, alone=False)))
