"""Stage `score`: every method drawn from the same views, held against the references, timed, and laid out."""

import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from prtnet import console, netspec, score, sh
from prtnet.data.samples import Samples
from prtnet.pipeline.bake import Baked, traced
from prtnet.pipeline.export import Exported
from prtnet.pipeline.job import Job
from prtnet.pipeline.train import Trained
from prtnet.render import camera, raster, vertex
from prtnet.render import gbuffer as gbuffers
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import GBuffer

log = logging.getLogger(__name__)
Array = np.ndarray
Image = Float[Array, "h w 3"]

SHOWN_VIEWS = 8  # kept for the contact sheet
TIMED_FRAMES = 7


@dataclass(frozen=True)
class Scored:
    key: str
    rows: list[score.Row]
    frames: Mapping[str, Array]  # method -> tone-mapped "views h w 3" of the shown views; "covered" -> their masks
    facts: Mapping[str, Any]


@dataclass(frozen=True)
class View:
    """One camera and what is known of its pixels before any method is drawn."""

    camera: Camera
    gbuffer: GBuffer
    covered: Bool[Array, "h w"]
    reference: Image


def score_methods(job: Job, baked: Baked, trained: Trained, exported: Exported) -> Scored:
    """Rows of texture, vertex, net and the noise floor against `traced`, and of net against `texture`."""
    coefficients = job.light.coefficients(job.config.transfer.bands)
    inputs = job.scene_key | {
        "texture": baked.texture.key,
        "atlas": asdict(job.config.atlas),
        "vertex": baked.mesh.key,
        "net": trained.key,
        "shader": exported.shader,
        "light": coefficients.tolist(),
        "material": asdict(job.material),
        "render": asdict(job.config.render),
        "camera": job.config.scene.camera,
    }

    def make() -> tuple[dict[str, Array], dict[str, Any]]:
        drawing = raster.Raster(baked.texture.atlas, job.config.render.size)
        views = _views(job, drawing, coefficients)
        return _draw_and_score(job, baked, trained, exported, drawing, views, coefficients)

    made = job.store.make("score", inputs, make)
    rows = [score.Row(**row) for row in made.facts["rows"]]
    return Scored(made.key, rows, made.arrays, made.facts)


def _views(job: Job, drawing: raster.Raster, coefficients: Array) -> list[View]:
    path = camera.path(job.scene, job.tracer, job.config.render.views, kind=job.config.scene.camera)
    views = []
    for index, eye in enumerate(path):
        gbuffer = drawing.gbuffer(eye)
        title = f"traced view {index + 1} of {len(path)}"
        baked = _traced_view(job, title, eye, gbuffer, announce=0 if index else len(path))
        covered = np.zeros(gbuffer.size * gbuffer.size, bool)
        covered[gbuffer.pixel] = True
        reference = gbuffers.shade(gbuffer, baked, coefficients, job.material)
        views.append(View(eye, gbuffer, covered.reshape(gbuffer.size, -1), reference))
    return views


def _traced_view(job: Job, title: str, eye: Camera, gbuffer: GBuffer, *, announce: int = 0, repeat: int = 0) -> Array:
    """The transfer of each covered pixel, at that very pixel. `repeat` turns every pixel's rays by other angles."""
    inputs = job.scene_key | {"camera": asdict(eye), "size": gbuffer.size, "repeat": repeat, "seed": job.config.seed}
    points = Samples(gbuffer.positions.astype(np.float64), gbuffer.normals, gbuffer.geometric_normals, gbuffer.face)
    directions = job.config.render.traced_directions
    baked = traced(job, "traced", inputs, points, directions, title=title, salt=repeat, announce=announce)
    return baked.arrays["transfer"]


def _draw_and_score(
    job: Job,
    baked: Baked,
    trained: Trained,
    exported: Exported,
    drawing: raster.Raster,
    views: list[View],
    coefficients: Array,
) -> tuple[dict[str, Array], dict[str, Any]]:
    methods = _methods(job, baked, exported, drawing)
    if isinstance(drawn := methods.get("vertex"), vertex.VertexMethod):
        # a cut edge is rounded anew: a pixel of an outline may be the other meshes' alone
        views = [replace(view, covered=view.covered & drawn.covers(view.camera)) for view in views]
    frames: dict[str, list[Image]] = {"traced": [view.reference for view in views]}
    with console.progress("draw", len(views) * len(methods), "frames") as reach:
        for number, (name, method) in enumerate(methods.items()):
            frames[name] = []
            for view in views:
                frames[name].append(method.draw(view.camera, coefficients))
                reach(number * len(views) + len(frames[name]))
    covered = [view.covered for view in views]
    exposure = score.exposure(frames["traced"], covered)
    times = _times(methods, views[0].camera, coefficients)
    costs = _costs(job, baked, trained, times, float(np.mean([mask.sum() for mask in covered])))
    rows = []
    for method, reference in [*((name, "traced") for name in methods), ("net", "texture")]:
        metrics = score.score_views(frames[method], frames[reference], covered, exposure)
        rows.append(_row(job, metrics, method, reference, costs[method]))
    rows.append(_noise_floor(job, views[0], coefficients, exposure))
    shown = np.unique(np.linspace(0, len(views) - 1, min(len(views), SHOWN_VIEWS)).round().astype(int))
    kept = {
        name: np.stack([score.tone_map(images[view], exposure) for view in shown]).astype(np.float16)
        for name, images in frames.items()
    }
    kept["covered"] = np.stack([covered[view] for view in shown])
    facts = {
        "rows": [asdict(row) for row in rows],
        "exposure": exposure,
        "covered": float(np.mean([mask.mean() for mask in covered])),
        "shown_views": shown.tolist(),
    }
    return kept, facts


def _methods(job: Job, baked: Baked, exported: Exported, drawing: raster.Raster) -> dict[str, raster.Shaded]:
    """What is drawn and scored; vertices only where the material is diffuse."""
    half, material = job.config.atlas.half, job.material
    methods: dict[str, raster.Shaded] = {
        "texture": raster.TextureMethod(drawing, baked.texture.image, half=half, material=material)
    }
    if not material.glossy:
        methods["vertex"] = vertex.VertexMethod(baked.mesh.mesh, baked.mesh.transfer, job.config.render.size)
    return methods | {"net": raster.NetMethod(drawing, exported.shader, material=material)}


def _times(methods: Mapping[str, Any], eye: Camera, coefficients: Array) -> dict[str, float]:
    """Median milliseconds per frame, the methods in turns so that a busy machine slows both alike."""
    taken: dict[str, list[float]] = {name: [] for name in methods}
    for _ in range(TIMED_FRAMES):
        for name, method in methods.items():
            taken[name].append(method.milliseconds(eye, coefficients, repeats=1))
    return {name: float(np.median(values)) for name, values in taken.items()}


def _costs(
    job: Job, baked: Baked, trained: Trained, times: Mapping[str, float], pixels: float
) -> dict[str, dict[str, Any]]:
    """What each method takes; `pixels` are those that a frame covers."""
    count = sh.count(job.config.transfer.bands)
    dot = score.diffuse_macs(count) + job.material.gloss_macs(job.config.transfer.bands)
    costs = {
        "texture": {
            "macs": score.fetch_macs(count, "bilinear") + dot,
            "bytes": score.texture_bytes(job.config.atlas.size, count, half=job.config.atlas.half),
            "bake_seconds": baked.texture.facts["seconds"],
            "train_seconds": None,
        },
        "vertex": {
            "macs": score.vertex_macs(len(baked.mesh.mesh.vertices), count, pixels),
            "bytes": score.vertex_bytes(len(baked.mesh.mesh.vertices), count),
            "bake_seconds": baked.mesh.facts["seconds"],
            "train_seconds": None,
        },
        "net": {
            "macs": netspec.macs(trained.net) + dot,
            "bytes": netspec.byte_count(trained.net),
            "bake_seconds": baked.training.facts["seconds"],
            "train_seconds": trained.facts["cpu_seconds"],
        },
    }
    return {name: costs[name] | {"ms": ms, "ms_ratio": ms / times["texture"]} for name, ms in times.items()}


def _noise_floor(job: Job, view: View, coefficients: Array, exposure: float) -> score.Row:
    """`traced` against itself with other rays on the first view: no method can be told from it above this."""
    baked = _traced_view(job, "traced view 1 again", view.camera, view.gbuffer, repeat=1)
    again = gbuffers.shade(view.gbuffer, baked, coefficients, job.material)
    metrics = score.score_views([again], [view.reference], [view.covered], exposure)
    return _row(job, metrics, score.NOISE_FLOOR, "traced", {})


def _row(job: Job, metrics: score.Metrics, method: str, reference: str, costs: Mapping[str, Any]) -> score.Row:
    return score.row(
        metrics,
        scene=job.scene.name,
        method=method,
        material=job.material.name,
        light=job.light_name,
        reference=reference,
        **costs,
    )
