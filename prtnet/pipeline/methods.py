"""The methods of a job, ready to draw, each with what it costs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from prtnet import clusters, data_driven, netspec, score, sh
from prtnet.data import quantise
from prtnet.export.bundle import Bundle
from prtnet.pipeline import drawn_by
from prtnet.pipeline.bake import Baked, BakedMesh, BakedTexture, NetPoints
from prtnet.pipeline.data_driven.learn import Operator
from prtnet.pipeline.export import Exported
from prtnet.pipeline.export_clusters import ClustersExported
from prtnet.pipeline.job import Job
from prtnet.pipeline.linear import methods as linear
from prtnet.pipeline.train import Trained
from prtnet.pipeline.views import cameras_of
from prtnet.render.clusters import ClusterMethod, DeferredClusters, shares, stack_method
from prtnet.render.data_driven import DataDrivenTexture
from prtnet.render.deferred import DeferredMethod
from prtnet.render.lit import LitTextureMethod
from prtnet.render.marched import Drawing
from prtnet.render.method import NetMethod, Shaded, TextureMethod
from prtnet.render.raster import Raster
from prtnet.render.unshadowed import UnshadowedMethod
from prtnet.render.vertex import VertexMethod

# covered pixels of a frame -> macs, bytes, bake_seconds, train_seconds
Costs = Callable[[float], dict[str, Any]]


@dataclass(frozen=True)
class Drawn:
    shaded: Shaded
    costs: Costs


def make_all(job: Job, baked: Baked, trained: Trained | None, exported: Exported, drawing: Drawing) -> dict[str, Drawn]:
    """By name, the baseline first."""
    return {name: make() for name, make in makers(job, baked, trained, exported, drawing).items()}


def makers(
    job: Job, baked: Baked, trained: Trained | None, exported: Exported, drawing: Drawing
) -> dict[str, Callable[[], Drawn]]:
    """What makes each of `make_all` when it is called."""
    found: dict[str, Callable[[], Drawn]] = {}
    if (texture := baked.texture) and isinstance(drawing, Raster):
        found["texture"] = lambda: _texture(job, texture, drawing)
    if "unshadowed" in job.config.methods:
        found["unshadowed"] = lambda: _unshadowed(job, drawing)
    if mesh := baked.mesh:
        found["vertex"] = lambda: _vertex(job, mesh)
    if (lit := baked.lit) and isinstance(drawing, Raster):
        found["lit_texture"] = lambda: _lit_texture(job, lit, drawing)
    if (points := baked.points) and (net := trained) and (drawn := exported.drawn):
        found["net"] = lambda: _net(job, points, net, drawn, exported.drawn_by, drawing)
    if (trained_on := baked.points) and (split := exported.clusters) and isinstance(drawing, Raster):
        found["clusters"] = lambda: _clusters(job, trained_on, split, drawing)
    if (direct := baked.texture) and (learned := baked.operator) and isinstance(drawing, Raster):
        found["data_driven"] = lambda: _data_driven(job, direct, learned, drawing)
    if isinstance(drawing, Raster):
        for name in linear.named(job):
            found[name] = partial(_linear, job, baked, trained, drawing, name)
    return found


def _unshadowed(job: Job, drawing: Drawing) -> Drawn:
    shaded = UnshadowedMethod(drawing, job.config.transfer.bands, material=job.material)
    costs = {"macs": shaded.macs + job.shading_macs, "bytes": 0, "bake_seconds": 0.0, "train_seconds": None}
    return Drawn(shaded, lambda pixels: costs)


def _texture(job: Job, baked: BakedTexture, drawing: Raster) -> Drawn:
    options, count = job.config.atlas, sh.count(job.config.transfer.bands)
    # with bounces a diffuse material needs no direct transfer
    fetched = 3 if job.groups == 4 and not job.material.glossy else job.groups
    shaded = TextureMethod(
        drawing,
        baked.pages,
        texels=options.format,
        level_of_detail=options.level_of_detail,
        material=job.material,
        groups=job.groups,
    )
    decoding = fetched * count if options.format == "uint8" else 0
    texel_bytes = quantise.FORMATS[options.format]
    pages = baked.pages
    filtering = "trilinear" if len(pages[0].levels) > 1 else "bilinear"
    costs = {
        "macs": score.fetch_macs(fetched * count, filtering) + decoding + job.shading_macs,
        "bytes": fetched
        * sum(
            score.texture_bytes(len(page.used), count, texel_bytes=texel_bytes, levels=len(page.levels))
            for page in pages
        ),
        "bake_seconds": baked.facts["seconds"],
        "train_seconds": None,
    }
    return Drawn(shaded, lambda pixels: costs)


def _lit_texture(job: Job, baked: BakedTexture, drawing: Raster) -> Drawn:
    options, count = job.config.atlas, sh.count(job.config.transfer.bands)
    shaded = LitTextureMethod(
        drawing,
        baked.pages,
        texels=options.format,
        level_of_detail=options.level_of_detail,
        material=job.material,
    )
    # a diffuse material looks at J_0 alone; a glossy one sums J with the lobe
    fetched, summed = (4 * count, 3 * count) if job.material.glossy else (count + 3, 3)
    decoding = fetched if options.format == "uint8" else 0
    filtering = "trilinear" if len(baked.pages[0].levels) > 1 else "bilinear"
    costs = {
        "macs": score.fetch_macs(fetched, filtering) + decoding + summed + job.shading_macs,
        "bytes": shaded.bytes,
        "bake_seconds": baked.facts["seconds"],
        "train_seconds": None,
    }
    return Drawn(shaded, lambda pixels: costs)


def _linear(job: Job, baked: Baked, trained: Trained | None, drawing: Raster, name: str) -> Drawn:
    return Drawn(*linear.drawn(job, linear.fitted(job, baked, trained, name), drawing))


def _data_driven(job: Job, baked: BakedTexture, learned: Operator, drawing: Raster) -> Drawn:
    """Direct transfer from the texture, what bounces from the operator."""
    options, count, spec = job.config.atlas, sh.count(job.config.transfer.bands), learned.spec
    direct = [replace(page, levels=tuple(level[..., :count] for level in page.levels)) for page in baked.pages]
    shaded = DataDrivenTexture(
        drawing,
        direct,
        spec,
        texels=options.format,
        level_of_detail=options.level_of_detail,
        material=job.material,
    )
    costs = {
        "macs": score.fetch_macs(count, "bilinear") + data_driven.macs(spec) + job.shading_macs,
        "bytes": shaded.bytes,
        "bake_seconds": baked.facts["seconds"] + learned.facts["training_seconds"],
        "train_seconds": learned.facts["cpu_seconds"],
    }
    return Drawn(shaded, lambda pixels: costs)


def _vertex(job: Job, baked: BakedMesh) -> Drawn:
    vertices, bands = len(baked.mesh.vertices), job.config.transfer.bands
    count = sh.count(bands)

    def costs(pixels: float) -> dict[str, Any]:
        # shared out among the pixels as the dot products are, and three more channels to interpolate
        gloss = round(vertices * job.material.gloss_macs(bands) / max(pixels, 1)) + 9 * job.material.glossy
        return {
            "macs": score.vertex_macs(vertices, count, pixels) + gloss,
            "bytes": job.groups * score.vertex_bytes(vertices, count),
            "bake_seconds": baked.facts["seconds"],
            "train_seconds": None,
        }

    size = job.config.render.size
    return Drawn(VertexMethod(baked.mesh, baked.transfer, size, material=job.material, groups=job.groups), costs)


def _net(job: Job, points: NetPoints, trained: Trained, exported: Bundle, by: str, drawing: Drawing) -> Drawn:
    costs = {
        "macs": netspec.macs(trained.net) + job.shading_macs,
        "bytes": netspec.byte_count(trained.net),
        "bake_seconds": points.training.facts["seconds"],
        "train_seconds": trained.facts["cpu_seconds"],
    }
    if by == drawn_by.DEFERRED:
        return Drawn(DeferredMethod(drawing, exported.net, material=job.material), lambda pixels: costs)
    shaded = NetMethod(
        drawing,
        exported.transfer,
        material=job.material,
        groups=job.groups,
        grids=trained.net.grids,
        hashes=trained.net.hashes,
        texels=trained.net.texels,
        weights=exported.weights,
        folding=(exported.net, exported.irradiance) if exported.irradiance else None,
    )
    return Drawn(shaded, lambda pixels: costs)


def _clusters(job: Job, points: NetPoints, exported: ClustersExported, drawing: Raster) -> Drawn:
    spec, words, material = exported.spec, job.config.split, job.material
    chosen = {"material": material, "border": words.border}
    if exported.drawn_by == drawn_by.DEFERRED:
        shaded = DeferredClusters(drawing, spec, select=words.select, **chosen)
    elif exported.stack:
        shaded = stack_method(drawing, spec, exported.stack, material=material)
    else:
        shaded = ClusterMethod(drawing, spec, exported.made, **chosen)

    def costs(pixels: float) -> dict[str, Any]:
        found = [drawing.gbuffer(camera) for camera in cameras_of(job)]
        share = np.concatenate([shares(spec, drawing.scene, each, words.border, words.select) for each in found])
        return {
            "macs": round(float(clusters.macs(spec, share).mean())) + job.shading_macs,
            "bytes": clusters.byte_count(spec),
            "bake_seconds": points.training.facts["seconds"],
            "train_seconds": exported.facts["cpu_seconds"],
        }

    return Drawn(shaded, costs)
