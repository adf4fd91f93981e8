"""Data-driven transfer on screen, held against path tracing under lights that it has not seen.

Beside `data_driven` stand `direct`, what is lit without a bounce; `projection`, the lightmap of that very light as near
as the basis comes to it; and `lightmap`, that lightmap itself: what is lost between one and the next is the operator's,
the basis's and the atlas's part of the error.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from prtnet import data_driven, score
from prtnet.data import texture
from prtnet.data.bilinear import bilinear
from prtnet.models.data_driven import projected
from prtnet.pipeline.data_driven import options
from prtnet.pipeline.data_driven.ground import Keyframe
from prtnet.pipeline.data_driven.learn import Operator
from prtnet.pipeline.data_driven.lights import UNSEEN
from prtnet.pipeline.data_driven.references import Image, Lit, references
from prtnet.pipeline.job import Job
from prtnet.pipeline.score import TIMED_FRAMES
from prtnet.pipeline.views import cameras_of
from prtnet.render.data_driven import DataDrivenMethod
from prtnet.render.gbuffer import GBuffer
from prtnet.render.lamps import LampMethod
from prtnet.render.raster import Raster
from prtnet.render.shadow_maps import ShadowMaps

log = logging.getLogger(__name__)
Array = np.ndarray

REFERENCE = "path_traced"
DIRECT, METHOD, PROJECTION, LIGHTMAP = "direct", "data_driven", "projection", "lightmap"
TEXEL_BYTES = 2  # of a basis texture: half floats


@dataclass(frozen=True)
class Scored:
    key: str
    rows: list[score.Row]
    frames: Mapping[str, Array]  # method -> tone-mapped "pictures h w 3"; "covered" -> masks
    facts: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Stage:
    """What draws a keyframe."""

    keyframe: Keyframe
    size: int

    @cached_property
    def raster(self) -> Raster:
        return Raster(self.keyframe.atlas, self.size)

    @cached_property
    def shadows(self) -> ShadowMaps:
        return ShadowMaps(self.keyframe.scene)


def score_lights(job: Job, made: Operator) -> Scored:
    """Rows of all methods and the noise floor against the path tracer."""
    chosen = job.config.data_driven
    inputs = {
        "operator": made.key,
        "tested": [chosen.tested_views, chosen.tested_lights, chosen.samples, chosen.bounces, job.config.seed],
        "size": job.config.render.size,
        "camera": job.config.scene.camera,
        "columns": list(score.KEYS),
    }
    kept = job.store.make("relit", inputs, lambda: _score(job, made))
    rows = [score.Row(**row) for row in kept.facts["rows"]]
    return Scored(kept.key, rows, kept.arrays, kept.facts)


def _score(job: Job, made: Operator) -> tuple[dict[str, Array], dict[str, Any]]:
    stages = [Stage(keyframe, job.config.render.size) for keyframe in made.ground.keyframes]
    pictures = _pictures(job, made, stages)
    truth = references(job, made, pictures)
    frames = {REFERENCE: truth} | _drawn(made, stages, pictures)
    covered = [each.gbuffer.covered for each in pictures]
    exposure = score.exposure(truth, covered)
    costs = _costs(made, stages[0], pictures[0])
    rows = [
        _row(job, made, score.score_views(frames[name], truth, covered, exposure), name, costs.get(name, {}))
        for name in (DIRECT, METHOD, PROJECTION, LIGHTMAP)
    ]
    again = references(job, made, pictures[:1], repeat=1)
    floor = score.score_views(again, truth[:1], covered[:1], exposure)
    rows.append(_row(job, made, floor, score.NOISE_FLOOR, {}))
    shown = {
        name: np.stack([score.tone_map(image, exposure) for image in images]).astype(np.float16)
        for name, images in frames.items()
    }
    facts = {"rows": [asdict(row) for row in rows], "exposure": exposure}
    return shown | {"covered": np.stack(covered)}, facts


def _pictures(job: Job, made: Operator, stages: Sequence[Stage]) -> list[Lit]:
    """Views of the scene's path, each under the lamps that the options name, or some unseen ones, evenly chosen."""
    chosen, unseen = job.config.data_driven, made.unseen
    count = min(chosen.tested_lights, len(unseen.lightings))
    lights = np.unique(np.linspace(0, len(unseen.lightings) - 1, count).round().astype(int))
    if chosen.lights:
        lights = np.arange(len(chosen.lights))
    path = cameras_of(job)
    eyes = [path[i] for i in np.unique(np.linspace(0, len(path) - 1, chosen.tested_views).round().astype(int))]
    found = []
    for number in lights:
        keyframe = int(unseen.keyframe[number])
        for eye in eyes:
            gbuffer = stages[keyframe].raster.gbuffer(eye)
            found.append(Lit(eye, gbuffer, unseen.lightings[number], int(number), keyframe))
    return found


def _drawn(made: Operator, stages: Sequence[Stage], pictures: Sequence[Lit]) -> dict[str, list[Image]]:
    frames: dict[str, list[Image]] = {name: [] for name in (DIRECT, METHOD, PROJECTION, LIGHTMAP)}
    methods = [(_direct(stage), _method(made, stage)) for stage in stages]
    for each in pictures:
        direct, learned = methods[each.keyframe]
        lit = direct.draw(each.camera, each.lighting)
        frames[DIRECT].append(lit)
        frames[METHOD].append(learned.draw(each.camera, each.lighting, each.keyframe))
        truth = made.unseen.lightmaps[each.number : each.number + 1]
        nearest = data_driven.from_space(projected(made.spec.basis, truth, made.spec.gamma), made.spec.gamma)
        for name, values in ((PROJECTION, nearest[0]), (LIGHTMAP, truth[0])):
            frames[name].append(_with_lightmap(made, each.gbuffer, lit, values))
    return frames


def _direct(stage: Stage) -> LampMethod:
    return LampMethod(stage.raster, shadows=stage.shadows, pages=stage.keyframe.pages)


def _method(made: Operator, stage: Stage) -> DataDrivenMethod:
    return DataDrivenMethod(stage.raster, made.spec, shadows=stage.shadows, pages=stage.keyframe.pages)


def _with_lightmap(made: Operator, gbuffer: GBuffer, direct: Image, values: Float[Array, "t 3"]) -> Image:
    """What is lit directly and what a lightmap says, with the filter of the basis textures."""
    image = texture.assemble(made.ground.texels, values.astype(np.float32))
    assert gbuffer.uv is not None
    found = np.maximum(bilinear(image, gbuffer.uv), 0)
    if made.spec.quantity == "radiance":
        return gbuffer.image(found)
    return direct + gbuffer.image(gbuffer.albedo / np.pi * found)


def _costs(made: Operator, stage: Stage, shown: Lit) -> dict[str, dict[str, Any]]:
    """Of what can run in real time: milliseconds in turns, so that a busy machine slows both alike."""
    direct, learned = _direct(stage), _method(made, stage)
    taken: dict[str, list[float]] = {DIRECT: [], METHOD: []}
    for _ in range(TIMED_FRAMES):
        taken[DIRECT].append(direct.milliseconds(shown.camera, shown.lighting, repeats=1))
        taken[METHOD].append(learned.milliseconds(shown.camera, shown.lighting, repeats=1))
    spent = {name: float(np.median(each)) for name, each in taken.items()}
    own = {
        "macs": data_driven.macs(made.spec),
        "bytes": data_driven.byte_count(made.spec, TEXEL_BYTES),
        "bake_seconds": made.facts["training_seconds"],
        "train_seconds": made.facts["cpu_seconds"],
    }
    return {
        name: {"ms": each, "ms_ratio": each / spent[DIRECT]} | (own if name == METHOD else {"bytes": 0})
        for name, each in spent.items()
    }


def _row(job: Job, made: Operator, metrics: score.Metrics, method: str, costs: Mapping[str, Any]) -> score.Row:
    light = "unseen " + ", ".join(options.kinds(job.config.data_driven, UNSEEN))
    return score.row(
        metrics,
        scene=job.scene.name,
        method=method,
        material="diffuse" if made.spec.quantity == "irradiance" else job.config.data_driven.renderer,
        light=light,
        reference=REFERENCE,
        **costs,
    )
