"""The transfer of points as artifacts, made shard by shard: what is seen of the light, and what of other surfaces.

With `transfer.transport=interreflected` transfer has four groups of k channels: direct, for gloss, and direct with all
bounces for red, green and blue, for the diffuse part. Otherwise it has one, direct.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from prtnet import sh
from prtnet.data import surface
from prtnet.data.atlas import Atlas
from prtnet.data.implicit.march import MarchTracer
from prtnet.data.samples import Samples
from prtnet.data.surface import Surface
from prtnet.data.texture import Texels
from prtnet.data.tracer import Tracer
from prtnet.pipeline.job import Job
from prtnet.pipeline.shards import Gather, in_shards
from prtnet.store import Artifact

Array = np.ndarray


@dataclass(frozen=True)
class Received:
    """Transfer of points and what it took."""

    key: str
    transfer: Float32[Array, "n c"]
    seconds: float


@dataclass(frozen=True)
class Radiosity:
    """What every surface point sends back: albedo / pi times the transfer it receives with one bounce less."""

    key: str
    surface: Surface
    sent: Float32[Array, "t k 3"]


def traced(
    job: Job,
    stage: str,
    inputs: Mapping[str, Any],
    points: Samples,
    directions: int,
    *,
    title: str | None = None,
    salt: int = 0,
    announce: int = 1,
    tracer: Tracer | MarchTracer | None = None,
) -> Artifact:
    """The direct transfer of points as an artifact {"transfer": "n k"}, by the rays of `tracer`, or the job's.

    `inputs` must tell the points and the `salt` of their rays' rotations; what the transfer depends on besides is
    added here. The estimate that is printed is for `announce` such bakes, 0 for none.
    """
    inputs = dict(inputs) | {"bands": job.config.transfer.bands}
    gather = Gather("bake", job.config.transfer.bands)
    return in_shards(job, stage, inputs, points, directions, gather, title or stage, salt, announce, tracer)


def received(
    job: Job,
    stage: str,
    inputs: Mapping[str, Any],
    points: Samples,
    directions: int,
    radiosity: Radiosity | None,
    tracer: Tracer | MarchTracer | None = None,
) -> Received:
    """The transfer of points in the job's transport; `radiosity` where there are bounces. `inputs` as for `traced`."""
    bands = job.config.transfer.bands
    if job.config.transfer.transport == "unshadowed":
        key = job.store.path(stage, dict(inputs) | {"bands": bands, "transport": "unshadowed"}).stem
        return Received(key, sh.cosine_lobe(points.normals, bands), 0.0)
    direct = traced(job, stage, inputs, points, directions, tracer=tracer)
    found = Received(direct.key, direct.arrays["transfer"], direct.facts["seconds"])
    if radiosity is None:
        return found
    bounced = _bounced(job, f"{stage}_bounced", inputs, points, directions, radiosity, f"{stage}, bounces")
    total = grouped(found.transfer, bounced.arrays["transfer"])
    return Received(bounced.key, total, found.seconds + bounced.facts["seconds"])


def texels_and_radiosity(
    job: Job, inputs: Mapping[str, Any], atlas: Atlas, texels: Sequence[Texels], points: Samples
) -> tuple[Received, Radiosity | None]:
    """The transfer of the atlas's texels, and with bounces what they send back: each bounce gathers from the last."""
    directions = job.config.transfer.directions
    first = received(job, "texture", inputs, points, directions, None)
    if not job.bounces:
        return first, None
    albedo = surface.texel_albedo(atlas, texels)
    place = surface.of_atlas(job.scene, atlas, texels)
    sent = surface.outgoing(albedo, first.transfer)
    radiosity = Radiosity(first.key, place, sent)
    bounces, key, seconds = np.zeros_like(sent), first.key, first.seconds
    for bounce in range(1, job.bounces + 1):
        last = Radiosity(key, place, sent)
        made = _bounced(job, "texture_bounced", inputs, points, directions, last, f"texture, bounce {bounce}")
        one = made.arrays["transfer"].reshape(sent.shape)
        bounces, key, seconds = bounces + one, made.key, seconds + made.facts["seconds"]
        if bounce < job.bounces:
            sent = surface.outgoing(albedo, one)
            radiosity = Radiosity(key, place, radiosity.sent + sent)
    total = grouped(first.transfer, bounces.reshape(len(bounces), -1))
    return Received(key, total, seconds), radiosity


def incident(
    job: Job,
    stage: str,
    inputs: Mapping[str, Any],
    points: Samples,
    directions: int,
    radiosity: Radiosity,
    light: Float[Array, "k 3"],
    *,
    title: str | None = None,
    salt: int = 0,
) -> Artifact:
    """{"transfer": "n 3k"}: SH of the light from other surfaces, under one fixed light; `inputs` as for `traced`."""
    bands = job.config.transfer.bands
    inputs = dict(inputs) | {"radiosity": radiosity.key, "light": light.tolist(), "bands": bands}
    both = min(radiosity.sent.shape[1], len(light))
    sent = np.einsum("tkc,kc->tc", radiosity.sent[:, :both], light[:both]).astype(np.float32)
    gather = Gather("incident", bands, radiosity.surface, sent)
    return in_shards(job, stage, inputs, points, directions, gather, title or stage, salt, 0)


def grouped(direct: Float[Array, "n k"], bounced: Float[Array, "n _"]) -> Float32[Array, "n _"]:
    """Four groups of channels: direct, then direct with what is `bounced` ("n k 3", flat) in red, green and blue."""
    coloured = bounced.reshape(*direct.shape, 3) + direct[..., None]
    return np.concatenate([direct, *np.moveaxis(coloured, -1, 0)], axis=1).astype(np.float32)


def _bounced(
    job: Job,
    stage: str,
    inputs: Mapping[str, Any],
    points: Samples,
    directions: int,
    radiosity: Radiosity,
    title: str,
) -> Artifact:
    """{"transfer": "n 3k"}: what comes to points from other surfaces, as responses to the light's coefficients."""
    inputs = dict(inputs) | {"radiosity": radiosity.key, "bands": job.config.transfer.bands}
    gather = Gather("bounce", job.config.transfer.bands, radiosity.surface, radiosity.sent)
    return in_shards(job, stage, inputs, points, directions, gather, title, 1, 1)
