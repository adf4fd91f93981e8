"""Data-driven transfer beside interreflected PRT under a directional light, which five SH bands cannot resolve.

    python -m experiments.data_driven.directional runs/data_driven/ablation=trained_on_directional \
        runs/data_driven/ablation=trained_on_all

takes finished points of the sweep; each adds a row. PRT is that of the same texels, and of vertices of all parts cut
finely, with as many bounces; "indirect" has what it adds to direct light, beside direct light with shadow maps as
data-driven transfer has it. Writes directional.md and directional.jpg into experiments/data_driven/results/.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from omegaconf import OmegaConf

from experiments.data_driven.report import HERE, markdown
from prtnet import PrtnetError, data_driven, score, sh, store
from prtnet.chart import sheet, tables
from prtnet.config import Config
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.lightmap import paths
from prtnet.data.samples import Samples
from prtnet.pipeline.bake import BakedMesh, BakedTexture, bake_mesh, bake_texture
from prtnet.pipeline.data_driven.learn import Operator, operator
from prtnet.pipeline.data_driven.score import TEXEL_BYTES
from prtnet.pipeline.job import Job, opened
from prtnet.pipeline.views import cameras_of
from prtnet.render.camera import Camera
from prtnet.render.data_driven import DataDrivenMethod
from prtnet.render.gbuffer import GBuffer
from prtnet.render.lamps import LampMethod
from prtnet.render.method import Shaded, TextureMethod
from prtnet.render.raster import Raster
from prtnet.render.shadow_maps import ShadowMaps
from prtnet.render.vertex import VertexMethod

Array = np.ndarray
Image = Float[Array, "h w 3"]

LIGHTS, LEVEL = 6, 4  # lights that are drawn; each triangle is cut into 4^LEVEL
REFERENCE = "path traced"


@dataclass(frozen=True, eq=False)
class Shown:
    """What is drawn: one view under some directional lights."""

    job: Job
    raster: Raster
    shadows: ShadowMaps
    camera: Camera
    gbuffer: GBuffer
    lightings: Sequence[Lighting]


def job_of(point: Path) -> Job:
    """The job of a finished point, with its folder and cache."""
    found = OmegaConf.merge(OmegaConf.structured(Config), OmegaConf.load(point / "config.yaml"))
    config = OmegaConf.to_object(found)
    assert isinstance(config, Config)
    return opened(replace(config, out=str(point)), "", None)


def shown_of(made: Operator, job: Job) -> Shown:
    """Raises PrtnetError for a point that is not lit by directional lights."""
    lightings = [each for each in made.unseen.lightings if [lamp.kind for lamp in each.lamps] == ["directional"]]
    if not lightings:
        raise PrtnetError(f"{job.out}: found no directional light among the unseen ones, expected some in lit_by")
    keyframe = made.ground.keyframes[0]
    raster = Raster(keyframe.atlas, job.config.render.size)
    eye = cameras_of(job)[0]
    return Shown(job, raster, ShadowMaps(keyframe.scene), eye, raster.gbuffer(eye), lightings[:LIGHTS])


def interreflected(job: Job) -> Job:
    """The same scene with PRT: texels of the lightmaps' atlas, vertices of all parts cut finely, as many bounces."""
    config, chosen = job.config, job.config.data_driven
    parts = [part.name for part in job.scene.materials]
    words = {
        "methods": ["texture", "vertex"],
        "transfer": replace(config.transfer, transport="interreflected", bounces=chosen.bounces),
        "atlas": replace(config.atlas, size=chosen.size),
        "vertex": replace(config.vertex, subdivide=parts, level=LEVEL),
    }
    return replace(job, config=replace(config, **words))


def coefficients(lighting: Lighting, bands: int) -> Float[Array, "k 3"]:
    """SH of directional lamps: colour times Y in the direction that light comes from."""
    return np.sum(
        [
            sh.evaluate(-np.asarray(lamp.aim)[None], bands)[0][:, None] * np.asarray(lamp.colour)
            for lamp in lighting.lamps
        ],
        axis=0,
    )


def references(shown: Shown) -> list[Image]:
    """Path traced, direct light and all bounces."""
    chosen, gbuffer = shown.job.config.data_driven, shown.gbuffer
    points = Samples(gbuffer.positions.astype(np.float64), gbuffer.normals, gbuffer.geometric_normals, gbuffer.face)
    found = paths.radiance(
        shown.job.tracer,
        shown.job.scene,
        points,
        gbuffer.albedo,
        shown.lightings,
        samples=chosen.samples,
        bounces=chosen.bounces,
        rng=shown.job.rng("directional"),
    )
    images = np.zeros((len(shown.lightings), gbuffer.size**2, 3), np.float32)
    images[:, gbuffer.pixel] = gbuffer.albedo / np.pi * (found.direct + found.indirect)
    return list(images.reshape(-1, gbuffer.size, gbuffer.size, 3))


def by_texture(shown: Shown, baked: BakedTexture) -> tuple[list[Image], list[Image], int]:
    """(pictures, of them what is not direct, bytes)."""
    count = sh.count(shown.job.config.transfer.bands)
    direct = [replace(page, levels=(page.levels[0][..., :count],)) for page in baked.pages]
    whole = TextureMethod(shown.raster, baked.pages, groups=4)
    return *_both(shown, whole, TextureMethod(shown.raster, direct)), whole.bytes


def by_vertex(shown: Shown, baked: BakedMesh) -> tuple[list[Image], list[Image], int]:
    """As `by_texture`."""
    count, size = sh.count(shown.job.config.transfer.bands), shown.job.config.render.size
    whole = VertexMethod(baked.mesh, baked.transfer, size, groups=4)
    pictures = _both(shown, whole, VertexMethod(baked.mesh, baked.transfer[:, :count], size))
    return *pictures, 4 * score.vertex_bytes(len(baked.mesh.vertices), count)


def _both(shown: Shown, whole: Shaded, direct: Shaded) -> tuple[list[Image], list[Image]]:
    bands = shown.job.config.transfer.bands
    lit = [coefficients(each, bands) for each in shown.lightings]
    pictures = [whole.draw(shown.camera, each) for each in lit]
    return pictures, [image - direct.draw(shown.camera, each) for image, each in zip(pictures, lit, strict=True)]


def frames_of(points: Sequence[Path]) -> tuple[dict[str, list[Image]], dict[str, int], Array]:
    """Pictures by name, bytes by name, and the covered pixels."""
    job = job_of(points[0])
    shown = shown_of(operator(job), job)
    direct = LampMethod(shown.raster, shadows=shown.shadows)
    lit = [direct.draw(shown.camera, each) for each in shown.lightings]
    frames, sizes = {REFERENCE: references(shown), "direct light alone": lit}, {"direct light alone": 0}
    for point in points:
        spec = operator(job_of(point)).spec
        method = DataDrivenMethod(shown.raster, spec, shadows=shown.shadows)
        name = f"data-driven, {point.name.rpartition('=')[2].removeprefix('trained_on_')}"
        frames[name] = [method.draw(shown.camera, each) for each in shown.lightings]
        sizes[name] = data_driven.byte_count(spec, TEXEL_BYTES)
    other = interreflected(job)
    baked = bake_texture(other)
    for name, made in {
        "texture": by_texture(shown, baked),
        "vertex": by_vertex(shown, bake_mesh(other, baked.radiosity)),
    }.items():
        pictures, indirect, size = made
        frames[f"{name} PRT"] = pictures
        frames[f"{name} PRT, indirect"] = [a + b for a, b in zip(lit, indirect, strict=True)]
        sizes |= {f"{name} PRT": size, f"{name} PRT, indirect": size}
    covered = np.zeros(shown.gbuffer.size**2, bool)
    covered[shown.gbuffer.pixel] = True
    return frames, sizes, covered.reshape(shown.gbuffer.size, -1)


def main(points: Sequence[Path], results: Path) -> None:
    frames, sizes, covered = frames_of(points)
    masks = [covered] * len(frames[REFERENCE])
    exposure = score.exposure(frames[REFERENCE], masks)
    rows: list[list[Any]] = []
    for name, size in sizes.items():
        found = score.score_views(frames[name], frames[REFERENCE], masks, exposure)
        mean = float(np.mean([view.psnr for view in found.per_view]))
        worst = min(view.psnr for view in found.per_view)
        rows.append([name, f"{mean:.1f}", f"{worst:.1f}", tables.size(size)])
    text = markdown(["what", "PSNR", "worst light", "bytes"], rows)
    store.write_text(results / "directional.md", text)
    toned = {
        f"light {number + 1}": [score.tone_map(frames[name][number], exposure) for name in frames]
        for number in range(3)
    }
    sheet.grid(results / "directional.jpg", toned, list(frames), title="cornell under directional lights")
    print(text, end="")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main([Path(argument) for argument in sys.argv[1:]], HERE / "results")
