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
from jaxtyping import Float, Float32

from prtnet import console, data_driven, score
from prtnet.data import texture
from prtnet.data.bilinear import bilinear
from prtnet.data.lighting import lamp
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.lightmap import paths
from prtnet.data.samples import Samples
from prtnet.models.data_driven import projected
from prtnet.pipeline.data_driven import options
from prtnet.pipeline.data_driven.ground import Keyframe
from prtnet.pipeline.data_driven.learn import Operator
from prtnet.pipeline.data_driven.lights import UNSEEN, rng_of
from prtnet.pipeline.job import Job
from prtnet.pipeline.score import TIMED_FRAMES
from prtnet.pipeline.views import cameras_of
from prtnet.render.camera import Camera
from prtnet.render.data_driven import DataDrivenMethod
from prtnet.render.gbuffer import GBuffer
from prtnet.render.lamps import LampMethod
from prtnet.render.raster import Raster
from prtnet.render.shadow_maps import ShadowMaps

log = logging.getLogger(__name__)
Array = np.ndarray
Image = Float[Array, "h w 3"]

REFERENCE = "path_traced"
DIRECT, METHOD, PROJECTION, LIGHTMAP = "direct", "data_driven", "projection", "lightmap"
TEXEL_BYTES = 2  # of a basis texture: half floats


@dataclass(frozen=True, eq=False)
class Lit:
    """One picture: a view of a keyframe under an unseen light. `number`: of that light in the database."""

    camera: Camera
    gbuffer: GBuffer
    lighting: Lighting
    number: int
    keyframe: int


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
    references = _references(job, made, pictures)
    frames = {REFERENCE: references} | _drawn(made, stages, pictures)
    covered = [_covered(each.gbuffer) for each in pictures]
    exposure = score.exposure(references, covered)
    costs = _costs(made, stages[0], pictures[0])
    rows = [
        _row(job, made, score.score_views(frames[name], references, covered, exposure), name, costs.get(name, {}))
        for name in (DIRECT, METHOD, PROJECTION, LIGHTMAP)
    ]
    again = _references(job, made, pictures[:1], repeat=1)
    floor = score.score_views(again, references[:1], covered[:1], exposure)
    rows.append(_row(job, made, floor, score.NOISE_FLOOR, {}))
    shown = {
        name: np.stack([score.tone_map(image, exposure) for image in images]).astype(np.float16)
        for name, images in frames.items()
    }
    facts = {"rows": [asdict(row) for row in rows], "exposure": exposure}
    return shown | {"covered": np.stack(covered)}, facts


def _pictures(job: Job, made: Operator, stages: Sequence[Stage]) -> list[Lit]:
    """Views of the scene's path, each under some unseen lights, evenly chosen."""
    chosen, unseen = job.config.data_driven, made.unseen
    count = min(chosen.tested_lights, len(unseen.lightings))
    lights = np.unique(np.linspace(0, len(unseen.lightings) - 1, count).round().astype(int))
    path = cameras_of(job)
    eyes = [path[i] for i in np.unique(np.linspace(0, len(path) - 1, chosen.tested_views).round().astype(int))]
    found = []
    for number in lights:
        keyframe = int(unseen.keyframe[number])
        for eye in eyes:
            gbuffer = stages[keyframe].raster.gbuffer(eye)
            found.append(Lit(eye, gbuffer, unseen.lightings[number], int(number), keyframe))
    return found


def _references(job: Job, made: Operator, pictures: Sequence[Lit], *, repeat: int = 0) -> list[Image]:
    """Each pixel by paths that begin at that very pixel, the same paths for all lights; `repeat` takes others."""
    found: dict[int, Image] = {}
    together: dict[tuple[Camera, int], list[int]] = {}
    for number, each in enumerate(pictures):
        together.setdefault((each.camera, each.keyframe), []).append(number)
    for numbers in together.values():
        few = [pictures[number] for number in numbers]
        if job.config.data_driven.renderer == options.SUBSURFACE:
            images = [_through_media(job, made, each, repeat) for each in few]
        else:
            irradiance = _path_traced(job, made, few, repeat)
            images = [
                _image(each.gbuffer, each.gbuffer.albedo / np.pi * values)
                for each, values in zip(few, irradiance, strict=True)
            ]
        found |= dict(zip(numbers, images, strict=True))
    return [found[number] for number in range(len(pictures))]


def _through_media(job: Job, made: Operator, shown: Lit, repeat: int) -> Image:
    """By Mitsuba's own camera and integrator; what is not covered stays black, as in every method."""
    from prtnet.data.lightmap import subsurface

    chosen, eye = job.config.data_driven, shown.camera
    keyframe, size = made.ground.keyframes[shown.keyframe], shown.gbuffer.size
    inputs = _picture_inputs(job, keyframe, [shown]) | {"paths": [chosen.samples, chosen.density, repeat]}

    def make() -> tuple[dict[str, Array], dict[str, Any]]:
        places = (np.asarray(eye.eye), np.asarray(eye.target), np.asarray(eye.up), eye.fov_y)
        found = subsurface.view(
            keyframe.scene,
            places,
            shown.lighting,
            size=size,
            samples=chosen.samples,
            density=chosen.density,
            seed=int(rng_of(job, "paths", repeat).integers(1 << 31)),
        )
        return {"radiance": np.where(_covered(shown.gbuffer)[..., None], found, 0).astype(np.float32)}, {}

    return job.store.make("paths", inputs, make).arrays["radiance"]


def _picture_inputs(job: Job, keyframe: Keyframe, pictures: Sequence[Lit]) -> dict[str, Any]:
    """What references of one view depend on, but for their paths."""
    return job.scene_key | {
        "camera": asdict(pictures[0].camera),
        "size": pictures[0].gbuffer.size,
        "lights": [lamp.to_dict(each.lighting) for each in pictures],
        "pose": [asdict(pose) for pose in keyframe.pose],
        "seed": job.config.seed,
    }


def _path_traced(job: Job, made: Operator, pictures: Sequence[Lit], repeat: int) -> Float32[Array, "l n 3"]:
    """Irradiance of the covered pixels of one view under several lights."""
    chosen, gbuffer = job.config.data_driven, pictures[0].gbuffer
    keyframe = made.ground.keyframes[pictures[0].keyframe]
    points = Samples(gbuffer.positions.astype(np.float64), gbuffer.normals, gbuffer.geometric_normals, gbuffer.face)
    inputs = _picture_inputs(job, keyframe, pictures) | {"paths": [chosen.samples, chosen.bounces, repeat]}

    def make() -> tuple[dict[str, Array], dict[str, Any]]:
        with console.progress("path-traced reference", len(gbuffer.pixel), "pixels") as reach:
            found = paths.radiance(
                keyframe.tracer,
                keyframe.scene,
                points,
                gbuffer.albedo,
                [each.lighting for each in pictures],
                samples=chosen.samples,
                bounces=chosen.bounces,
                rng=rng_of(job, "paths", repeat),
                threads=job.config.threads,
                progress=reach,
            )
        return {"irradiance": found.direct + found.indirect}, {"noise": float(np.mean(found.noise))}

    return job.store.make("paths", inputs, make).arrays["irradiance"]


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
        return _image(gbuffer, found)
    return direct + _image(gbuffer, gbuffer.albedo / np.pi * found)


def _image(gbuffer: GBuffer, colours: Float[Array, "n 3"]) -> Float32[Array, "h w 3"]:
    image = np.zeros((gbuffer.size * gbuffer.size, 3), np.float32)
    image[gbuffer.pixel] = colours
    return image.reshape(gbuffer.size, gbuffer.size, 3)


def _covered(gbuffer: GBuffer) -> Array:
    mask = np.zeros(gbuffer.size * gbuffer.size, bool)
    mask[gbuffer.pixel] = True
    return mask.reshape(gbuffer.size, -1)


def _costs(made: Operator, stage: Stage, shown: Lit) -> dict[str, dict[str, Any]]:
    """Of what can run in real time: milliseconds in turns, so that a busy machine slows both alike."""
    direct, learned = _direct(stage), _method(made, stage)
    taken: dict[str, list[float]] = {DIRECT: [], METHOD: []}
    for _ in range(TIMED_FRAMES):
        taken[DIRECT].append(direct.milliseconds(shown.camera, shown.lighting, repeats=1))
        taken[METHOD].append(learned.milliseconds(shown.camera, shown.lighting, repeats=1))
    spent = {name: float(np.median(each)) for name, each in taken.items()}
    padded = 4 * -(-made.spec.elements // 4) * len(made.spec.basis)
    own = {
        "macs": score.fetch_macs(padded, "bilinear") + 3 * made.spec.elements,
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
