"""Transfer of texels or vertices fitted as a weighted sum of a few vectors."""

import time
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64

from prtnet import sh
from prtnet.data.texture import Page
from prtnet.data.unwrap import uv_areas
from prtnet.models import pca
from prtnet.models.pca import Linear
from prtnet.pipeline.bake import BakedMesh, BakedTexture, bake_texture
from prtnet.pipeline.job import Job
from prtnet.pipeline.linear.options import clusters_of

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Fitted:
    """One of the methods, ready to be drawn."""

    name: str
    key: str
    linear: Linear
    groups: int  # of channels: 1; 3, red, green and blue with bounces; or, for gloss, 4, the direct one before these
    source: BakedTexture | BakedMesh
    rmse: float  # of what was fitted, all channels
    seconds: float  # of the bake and the fit

    @property
    def words(self) -> str:
        """For the report."""
        if isinstance(self.source, BakedMesh):
            place = f"{len(self.source.transfer)} vertices"
        else:
            place = f"{' and '.join(f'{len(page.used)}^2' for page in self.source.pages)} texels"
        many = f"{self.linear.clusters} clusters of " if self.linear.clusters > 1 else ""
        return f"{many}{self.linear.elements} vectors at {place}, RMSE {self.rmse:.4f}"


def texture_of(job: Job, baked: BakedTexture, size: int) -> BakedTexture:
    """The job's texture, or one of another size with an atlas of its own."""
    if size == job.config.atlas.size:
        return baked
    return bake_texture(replace(job, config=replace(job.config, atlas=replace(job.config.atlas, size=size))))


def channels_of(job: Job) -> tuple[int, int]:
    """(channels that are kept, groups of coefficients in them)."""
    groups = job.groups if job.groups == 1 or job.material.glossy else 3
    return groups * sh.count(job.config.transfer.bands), groups


def kept(job: Job, transfer: Float[Array, "*p c"]) -> Float[Array, "*p d"]:
    """With bounces a diffuse material needs no direct transfer."""
    return transfer[..., transfer.shape[-1] - channels_of(job)[0] :]


def pages_of(job: Job, source: BakedTexture) -> tuple[Page, ...]:
    return tuple(replace(page, levels=tuple(kept(job, level) for level in page.levels)) for page in source.pages)


def _points(job: Job, source: BakedTexture | BakedMesh) -> tuple[Float[Array, "p d"], Float64[Array, " p"]]:
    """Transfer of the texels or vertices, and the area of the surface that each of them stands for."""
    if isinstance(source, BakedMesh):
        scene = source.mesh.centred()
        areas = np.bincount(scene.faces.ravel(), np.repeat(scene.face_areas / 3, 3), len(scene.vertices))
        return kept(job, source.transfer), areas
    scene, areas = source.atlas.scene.centred(), []
    flat = uv_areas(source.atlas.uv[scene.faces].astype(np.float64))
    for texels in source.texels:
        # a sliver that grazes a texel has none of its own
        each = np.where(flat > 0, scene.face_areas / np.maximum(flat, 1e-30) / texels.size**2, 0)[texels.face]
        areas.append(np.minimum(each, scene.face_areas[texels.face]))
    values = [
        page.levels[0].reshape(-1, page.levels[0].shape[2])[texels.index]
        for page, texels in zip(pages_of(job, source), source.texels, strict=True)
    ]
    return np.concatenate(values), np.concatenate(areas)


def fit(job: Job, name: str, source: BakedTexture | BakedMesh, elements: int) -> Fitted:
    clusters, (channels, groups) = clusters_of(job.config, name), channels_of(job)
    inputs = job.scene_key | {"source": source.key, "seed": job.config.seed}
    inputs |= {"elements": elements, "clusters": clusters, "channels": channels}

    def make() -> tuple[dict[str, Array], dict[str, float]]:
        start, (values, areas) = time.perf_counter(), _points(job, source)
        found = pca.fit(values, areas, elements=elements, clusters=clusters, rng=job.rng("linear"))
        facts = {"rmse": pca.rmse(found, values, areas), "seconds": time.perf_counter() - start}
        return {"means": found.means, "bases": found.bases}, facts

    made = job.store.make("linear", inputs, make)
    linear = Linear(made.arrays["means"], made.arrays["bases"])
    seconds = source.facts["seconds"] + made.facts["seconds"]
    return Fitted(name, made.key, linear, groups, source, made.facts["rmse"], seconds)
