"""Stage `score`: every method drawn from the same views, held against the references, timed, and laid out."""

import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prtnet import console, score
from prtnet.pipeline import drawn_by
from prtnet.pipeline.bake import Baked
from prtnet.pipeline.exact import add_exact, exact_rows, light_key
from prtnet.pipeline.export import Exported
from prtnet.pipeline.job import Job
from prtnet.pipeline.linear import methods as linear
from prtnet.pipeline.methods import Drawn, make_all
from prtnet.pipeline.seams import seams, surfaces
from prtnet.pipeline.train import Trained
from prtnet.pipeline.transport import Radiosity
from prtnet.pipeline.views import View, drawing_of, reference_of, row_of, views_of
from prtnet.render.camera import Camera
from prtnet.render.marched import Marched
from prtnet.render.raster import Raster
from prtnet.render.vertex import VertexMethod
from prtnet.seam import Surface

log = logging.getLogger(__name__)
Array = np.ndarray
Image = Float[Array, "h w 3"]

SHOWN_VIEWS = 8  # kept for the contact sheet
TIMED_FRAMES = 7
# keys of `render` that no score depends on, but for `net`, whose meaning is in the inputs by itself
UNSCORED = ("tone", "bloom", "highlights", "pictures", "net")


@dataclass(frozen=True)
class Scored:
    key: str
    rows: list[score.Row]
    frames: Mapping[
        str, Array
    ]  # method -> tone-mapped "views h w 3" of the shown views; "covered" -> their masks; "cluster" too
    facts: Mapping[str, Any]


def score_methods(job: Job, baked: Baked, trained: Trained | None, exported: Exported) -> Scored:
    """Rows of all methods and the noise floor against `traced`, of net against `texture`, and, where it is on, of all
    methods and `traced` against `exact`."""
    bands_light, _ = job.material.orders(job.config.transfer.bands)
    coefficients = job.light.coefficients(bands_light)
    shown = exported.drawn_by == drawn_by.SHADER
    fits = linear.fits(job, baked, trained)
    inputs = job.scene_key | {
        "methods": job.config.methods,
        **({"texture": baked.texture.key} if baked.texture else {}),
        **({"lit": baked.lit.key} if baked.lit else {}),
        "atlas": asdict(job.config.atlas),
        "vertex": baked.mesh and baked.mesh.key,
        "net": trained and trained.key,
        "shader": exported.drawn and (exported.drawn.transfer if shown else drawn_by.DEFERRED),
        "light": coefficients.tolist(),
        "material": asdict(job.material),
        "render": {key: value for key, value in asdict(job.config.render).items() if key not in UNSCORED},
        "camera": job.config.scene.camera,
        "exact": light_key(job.light) if job.config.render.exact_samples else None,
        "columns": list(score.KEYS),
        **({"clusters": exported.clusters.key} if exported.clusters else {}),
        **({"data_driven": baked.operator.key} if baked.operator else {}),
        **linear.keys(fits),
    }

    def make() -> tuple[dict[str, Array], dict[str, Any]]:
        drawing = drawing_of(job, baked)
        views = add_exact(job, views_of(job, drawing, coefficients, baked.radiosity))
        methods = make_all(job, baked, trained, exported, drawing)
        places: list[Surface] = []
        if exported.clusters and isinstance(drawing, Raster):
            places = surfaces(job, exported.clusters.spec, drawing, views)
        arrays, facts = _draw_and_score(job, methods, views, coefficients, baked.radiosity, places)
        return arrays, facts | linear.words(fits)

    made = job.store.make("score", inputs, make)
    rows = [score.Row(**row) for row in made.facts["rows"]]
    return Scored(made.key, rows, made.arrays, made.facts)


def _draw_and_score(
    job: Job,
    methods: Mapping[str, Drawn],
    views: list[View],
    coefficients: Array,
    radiosity: Radiosity | None,
    places: list[Surface],
) -> tuple[dict[str, Array], dict[str, Any]]:
    for method in methods.values():
        if isinstance(method.shaded, VertexMethod):
            # a cut edge is rounded anew: a pixel of an outline may be the other meshes' alone
            views = [replace(view, covered=view.covered & method.shaded.covers(view.camera)) for view in views]
    frames: dict[str, list[Image]] = {"traced": [view.reference for view in views]}
    with console.progress("draw", len(views) * len(methods), "frames") as reach:
        for number, (name, method) in enumerate(methods.items()):
            frames[name] = []
            for view in views:
                frames[name].append(method.shaded.draw(view.camera, coefficients))
                reach(number * len(views) + len(frames[name]))
    covered = [view.covered for view in views]
    exposure = score.exposure(frames["traced"], covered)
    times = _times(methods, views[0].camera, coefficients)
    pixels = float(np.mean([mask.sum() for mask in covered]))
    pairs = [(name, "traced") for name in methods]
    pairs += [("net", "texture")] if {"net", "texture"} <= set(methods) else []
    spent = {name: {"ms": each, "ms_ratio": each / times[job.baseline]} for name, each in times.items()}
    share = {"covered": float(np.mean([mask.mean() for mask in covered]))}
    costs = {name: method.costs(pixels) | spent[name] | _mesh(method) | share for name, method in methods.items()}
    rows = []
    for name, reference in pairs:
        metrics = score.score_views(frames[name], frames[reference], covered, exposure)
        rows.append(row_of(job, metrics, name, reference, costs[name]))
    rows.append(noise_floor(job, views[0], coefficients, radiosity, exposure))
    rows += exact_rows(job, views, frames, costs, exposure)
    if any(view.exact is not None for view in views):
        # not drawn: NaN, which the contact sheet leaves empty
        absent = np.full_like(views[0].reference, np.nan)
        frames["exact"] = [absent if view.exact is None else view.exact for view in views]
    shown = np.unique(np.linspace(0, len(views) - 1, min(len(views), SHOWN_VIEWS)).round().astype(int))
    kept = {
        name: np.stack([score.tone_map(images[view], exposure) for view in shown]).astype(np.float16)
        for name, images in frames.items()
    }
    kept["covered"] = np.stack([covered[view] for view in shown])
    kept |= {"cluster": np.stack([places[view].cluster for view in shown])} if places else {}
    facts = {
        "rows": [asdict(row) for row in rows],
        "exposure": exposure,
        **share,
        "shown_views": shown.tolist(),
        **({"seams": seams(places, frames, exposure, list(methods))} if places else {}),
    }
    return kept, facts


def _mesh(method: Drawn) -> dict[str, int]:
    """What is drawn, with both sides of two-sided faces, which have vertices of their own; nothing where no mesh is."""
    if isinstance(method.shaded.raster, Marched):
        return {}
    drawn = method.shaded.raster.scene
    return {"vertices": len(drawn.vertices), "triangles": len(drawn.faces)}


def _times(methods: Mapping[str, Drawn], eye: Camera, coefficients: Array) -> dict[str, float]:
    """Median milliseconds per frame, the methods in turns so that a busy machine slows both alike."""
    taken: dict[str, list[float]] = {name: [] for name in methods}
    for _ in range(TIMED_FRAMES):
        for name, method in methods.items():
            taken[name].append(method.shaded.milliseconds(eye, coefficients, repeats=1))
    return {name: float(np.median(values)) for name, values in taken.items()}


def noise_floor(job: Job, view: View, coefficients: Array, radiosity: Radiosity | None, exposure: float) -> score.Row:
    """`traced` against itself with other rays on the first view: no method can be told from it above this."""
    again = reference_of(job, "traced view 1 again", view.camera, view.gbuffer, coefficients, radiosity, repeat=1)
    metrics = score.score_views([again], [view.reference], [view.covered], exposure)
    return row_of(job, metrics, score.NOISE_FLOOR, "traced", {})
