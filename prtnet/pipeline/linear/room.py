"""The methods `pca` and `cpca` at equal bytes: how many vectors, and how many texels to keep their weights in.

More texels with fewer vectors are held against fewer texels with more: every number of vectors that fills whole RGBA
texels is fitted in a texture as large as the bytes allow, with an atlas and a bake of its own, and the one whose
bilinear look-up is nearest to the transfer of points that were never fitted is taken.
"""

import logging
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError, netspec, score, sh
from prtnet.data import mipmap, quantise, samples
from prtnet.data.bilinear import bilinear
from prtnet.data.samples import Samples
from prtnet.export.linear import index_bytes
from prtnet.pipeline.atlas import padding_of
from prtnet.pipeline.bake import BakedTexture, atlas_uv
from prtnet.pipeline.job import Job
from prtnet.pipeline.linear.fit import Fitted, channels_of, fit, kept, pages_of, texture_of
from prtnet.pipeline.linear.options import clusters_of
from prtnet.pipeline.train import Trained
from prtnet.pipeline.transport import received
from prtnet.render.linear import decoded_page

log = logging.getLogger(__name__)
Array = np.ndarray

LEAST_SIDE = 16
MOST_SIDE = 2  # times atlas.size: what is larger takes minutes of rays to find out that it gains nothing


def room_of(job: Job, baked: BakedTexture, trained: Trained | None) -> int | None:
    """Bytes that a method may take; None: any."""
    if job.config.linear.bytes == "free":
        return None
    if job.config.linear.bytes == "net":
        assert trained
        return netspec.byte_count(trained.net)
    count, texel = sh.count(job.config.transfer.bands), quantise.FORMATS[job.config.atlas.format]
    groups = channels_of(job)[1]
    return groups * sum(
        score.texture_bytes(len(page.used), count, texel_bytes=texel, levels=len(page.levels)) for page in baked.pages
    )


def _table_bytes(job: Job, name: str, elements: int) -> int:
    """Of means and vectors."""
    return 4 * clusters_of(job.config, name) * (1 + elements) * channels_of(job)[0]


def _numbers(job: Job) -> list[int]:
    """Numbers of vectors that leave no padding: those that fill vec4, and all."""
    channels = channels_of(job)[0]
    return sorted({min(4 * layers, channels) for layers in range(1, 1 + -(-channels // 4))})


def most_elements(job: Job, name: str, vertices: int, room: int) -> int:
    index = index_bytes(clusters_of(job.config, name))
    fitting = [
        elements
        for elements in _numbers(job)
        if vertices * (16 * -(-elements // 4) + index) + _table_bytes(job, name, elements) <= room
    ]
    if not fitting:
        raise PrtnetError(
            f"linear.bytes: found {room} bytes of {job.config.linear.bytes}, expected at least 16 for each of"
            f" {vertices} vertices; choose linear.store=texel or linear.bytes=free"
        )
    return fitting[-1]


def best(job: Job, baked: BakedTexture, name: str, room: int) -> Fitted:
    """The fit with the least error among those that take no more than `room` bytes. Raises PrtnetError for none."""
    sides = {elements: _side(job, name, elements, room) for elements in _numbers(job)}
    most = MOST_SIDE * job.config.atlas.size
    tried = {elements: min(side, most) for elements, side in sides.items() if side >= LEAST_SIDE}
    inputs = job.scene_key | {"source": baked.key, "seed": job.config.seed, "tried": list(tried.items())}
    inputs |= {"clusters": clusters_of(job.config, name), "channels": channels_of(job)[0]}
    inputs |= {"dilation": job.config.atlas.dilation, "count": job.config.samples.test_count}

    def make() -> tuple[dict[str, Array], dict[str, Any]]:
        errors = _errors(job, baked, name, tried)
        return {}, {"elements": min(errors, key=errors.__getitem__) if errors else None, "errors": errors}

    chosen = job.store.make("linear_bytes", inputs, make).facts["elements"]
    if chosen is None:
        raise PrtnetError(
            f"linear.bytes: found {room} bytes of {job.config.linear.bytes}, too few for the vectors of {name} and a"
            " texture that the charts of the scene fit into; atlas.format=uint8 takes a quarter of float32, and"
            " linear.store=vertex or linear.bytes=free ask for no charts in few texels"
        )
    return fit(job, name, texture_of(job, baked, tried[chosen]), chosen)


def _errors(job: Job, baked: BakedTexture, name: str, tried: Mapping[int, int]) -> dict[int, float]:
    """RMSE by number of vectors, of textures of the sides `tried`; those that the charts do not fit into are passed
    over."""
    count, errors = job.config.samples.test_count, {}
    points = samples.area_uniform(job.scene, count, job.rng("linear points"))
    own = job.scene_key | {"count": count, "seed": job.config.seed}
    found = received(job, "linear_points", own, points, job.config.transfer.directions, baked.radiosity)
    truth = kept(job, found.transfer)
    for elements, side in tried.items():
        try:
            source = texture_of(job, baked, side)
        except PrtnetError as error:
            log.info("%s: no %d vectors at %d^2 texels: %s", name, elements, side, error)
            continue
        errors[elements] = _error(job, fit(job, name, source, elements), points, truth)
        log.info("%s: %d vectors at %d^2 texels, RMSE of points %.4f", name, elements, side, errors[elements])
    return errors


def _side(job: Job, name: str, elements: int, room: int) -> int:
    """Texels along one side of a texture that fits beside its table, 0 for none."""
    options, clusters = job.config.atlas, clusters_of(job.config, name)
    levels = mipmap.level_count(padding_of(options)) if options.mipmaps and clusters == 1 else 1
    texel = 4 * quantise.FORMATS[options.format] * -(-elements // 4) * sum(0.25**level for level in range(levels))
    left = room - _table_bytes(job, name, elements)
    side = math.isqrt(max(0, int(left / (texel + index_bytes(clusters)))))
    # sides that halve evenly
    return side >> (levels - 1) << (levels - 1)


def _error(job: Job, fitted: Fitted, points: Samples, truth: Float[Array, "p d"]) -> float:
    """RMSE of the transfer that points look up."""
    source = fitted.source
    assert isinstance(source, BakedTexture)
    uv, found = atlas_uv(source.atlas, points), np.empty_like(truth)
    number = source.atlas.page_of_face[points.face]
    for place, page in enumerate(pages_of(job, source)):
        own = number == place
        found[own] = bilinear(decoded_page(fitted.linear, page), uv[own], repeat=False)
    return float(np.sqrt(np.mean((found.astype(np.float64) - truth) ** 2)))
