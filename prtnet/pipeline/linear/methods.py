"""The methods `pca` and `cpca` of a job: transfer of texels or vertices as a weighted sum of a few vectors."""

from collections.abc import Callable, Mapping
from typing import Any

from prtnet import score
from prtnet.pipeline.bake import Baked, BakedMesh, bake_mesh
from prtnet.pipeline.job import Job
from prtnet.pipeline.linear.fit import Fitted, fit, kept, pages_of, texture_of
from prtnet.pipeline.linear.options import METHODS
from prtnet.pipeline.linear.room import best, most_elements, room_of
from prtnet.pipeline.train import Trained
from prtnet.render.linear import LinearTextureMethod, LinearVertexMethod
from prtnet.render.raster import Raster

# covered pixels of a frame -> macs, bytes, bake_seconds, train_seconds
Costs = Callable[[float], dict[str, Any]]


def fits(job: Job, baked: Baked, trained: Trained | None) -> dict[str, Fitted]:
    """Those of `pca` and `cpca` that the job asks for, by name. Raises PrtnetError where bytes leave no room."""
    return {name: fitted(job, baked, trained, name) for name in named(job)}


def named(job: Job) -> list[str]:
    """Those that the job asks for."""
    return [name for name in METHODS if name in job.config.methods]


def fitted(job: Job, baked: Baked, trained: Trained | None, name: str) -> Fitted:
    """One of them, or what the store has of it. Raises PrtnetError where bytes leave no room."""
    options = job.config.linear
    assert baked.texture
    room = room_of(job, baked.texture, trained)
    if options.store == "vertex":
        mesh = baked.mesh or bake_mesh(job, baked.texture.radiosity)
        elements = options.elements if room is None else most_elements(job, name, len(mesh.transfer), room)
        return fit(job, name, mesh, elements)
    if room is None:
        return fit(job, name, texture_of(job, baked.texture, options.size or job.config.atlas.size), options.elements)
    return best(job, baked.texture, name, room)


def keys(found: Mapping[str, Fitted]) -> dict[str, dict[str, str]]:
    """What a score depends on, where there is any of them."""
    return {"linear": {name: each.key for name, each in found.items()}} if found else {}


def words(found: Mapping[str, Fitted]) -> dict[str, dict[str, str]]:
    """What the report says of them, where there is any."""
    return {"linear": {name: each.words for name, each in found.items()}} if found else {}


def drawn(job: Job, method: Fitted, drawing: Raster) -> tuple[LinearTextureMethod | LinearVertexMethod, Costs]:
    """What draws a method, and what that costs by the covered pixels of a frame."""
    made = _method(job, method, drawing)

    def costs(pixels: float) -> dict[str, Any]:
        spent = {"bake_seconds": method.seconds, "train_seconds": None}
        return {"macs": _macs(job, method, made.table.vectors, pixels), "bytes": made.bytes} | spent

    return made, costs


def _macs(job: Job, method: Fitted, outputs: int, pixels: float) -> int:
    """Multiply-adds per pixel; of texels in clusters at worst, where the four of a look-up are of as many."""
    source, elements, glossy = method.source, method.linear.elements, job.material.glossy
    # a diffuse sum is over the vectors under the light; gloss puts the transfer together, padding and all
    channels, shading = (4 * outputs, job.shading_macs) if glossy else (3, 0)
    if isinstance(source, BakedMesh):
        # shared out among the pixels, and what is interpolated at each
        at_vertices = len(source.transfer) * (channels * elements + shading)
        return round(at_vertices / max(pixels, 1)) + 9 * (1 + glossy)
    decoding = elements if job.config.atlas.format == "uint8" else 0
    if method.linear.clusters > 1:
        fetched = score.fetch_macs(elements, "nearest") + decoding
        return 4 * (fetched + channels * elements + channels) + shading
    filtering = "trilinear" if len(source.pages[0].levels) > 1 else "bilinear"
    return score.fetch_macs(elements, filtering) + decoding + channels * elements + shading


def _method(job: Job, method: Fitted, drawing: Raster) -> LinearTextureMethod | LinearVertexMethod:
    source, more = method.source, {"groups": method.groups, "material": job.material}
    if isinstance(source, BakedMesh):
        values = kept(job, source.transfer)
        return LinearVertexMethod(source.mesh, method.linear, values, job.config.render.size, **more)
    options = job.config.atlas
    raster = drawing if source.atlas is drawing.atlas else Raster(source.atlas, job.config.render.size)
    more |= {"texels": options.format, "level_of_detail": options.level_of_detail}
    return LinearTextureMethod(raster, method.linear, pages_of(job, source), **more)
