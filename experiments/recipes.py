"""Searches behind the two training recipes: one option changed at a time, each trained for the same CPU time.

    python experiments/recipes.py published          # the constant Adam rate that the paper leaves out
    python experiments/recipes.py default            # what each part of the default recipe is worth
    python experiments/recipes.py default --only optimiser=adam --seed 1

Scores are image PSNR against traced pixels under the procedural sky, 8 views of 128^2, each net evaluated in NumPy.
Rows go to experiments/results/recipes_search/NAME.csv as they come. Run on an idle machine: a step count is measured.
"""

import argparse
import csv
import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from prtnet import PrtnetError, netspec, score
from prtnet.config import Config
from prtnet.data import light
from prtnet.data.samples import Samples
from prtnet.models.recipe import ModelOptions, TrainOptions, published
from prtnet.models.train import Points, calibrate, train
from prtnet.netspec import NetSpec
from prtnet.pipeline import bake
from prtnet.pipeline.job import Job, open_job
from prtnet.pipeline.transport import traced
from prtnet.render import camera, raster
from prtnet.render.gbuffer import GBuffer, shade

RESULTS = Path(__file__).resolve().parent / "results" / "recipes_search"
VIEWS, SIZE, RAYS = 8, 128, 1024
Change = dict[str, Any]

# each change is judged at its own best rate: rates stand beside the options that need another
SEARCHES: dict[str, tuple[TrainOptions, list[Change]]] = {
    "published": (published(), [{"learning_rate": rate} for rate in (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2)]),
    "default": (
        TrainOptions(),
        [
            {},
            {"matrix_rate": 0.0125},
            {"matrix_rate": 0.05},
            {"optimiser": "adam", "learning_rate": 0.01},
            {"optimiser": "adam", "learning_rate": 0.03},
            {"optimiser": "muon", "matrix_rate": 0.02},
            {"activation": "leaky_relu"},
            {"activation": "gelu"},
            {"output": "tanh"},
            {"residual": True},
            {"loss": "l1"},
            {"loss": "l2"},
            {"position_frequencies": 8, "normal_frequencies": 3},
            {"batch": 8192},
            {"dark_weight": 0.5},
            {"precision": "float32"},
            {"schedule": "constant", "average": 0.999},
        ],
    ),
}


@dataclass(frozen=True)
class Data:
    """One scene: samples to learn from, pixels to be judged on."""

    name: str
    points: Points
    pixels: list[GBuffer]
    traced: list[np.ndarray]  # transfer of the pixels


def prepare(scene: str, cache: Path) -> Data:
    """Bakes, or finds baked, the samples of the pipeline's own default and the pixels of a few small views."""
    config = Config()
    config.scene.name, config.scene.path = scene, None
    config.out, config.atlas.size, config.render.traced_directions = str(cache), 256, RAYS
    job = open_job(config, "", None)
    baked = bake.bake(job)
    drawing = raster.Raster(baked.texture.atlas, SIZE)
    pixels = [drawing.gbuffer(eye) for eye in camera.path(job.scene, job.tracer, VIEWS)]
    references = [_traced(job, view, index) for index, view in enumerate(pixels)]
    assert baked.points is not None
    training = baked.points.training
    return Data(scene, Points(training.positions, training.normals, training.transfer), pixels, references)


def _traced(job: Job, view: GBuffer, index: int) -> np.ndarray:
    points = Samples(view.positions.astype(np.float64), view.normals, view.geometric_normals, view.face)
    inputs = job.scene_key | {"view": index, "views": VIEWS, "size": SIZE}
    return traced(job, "recipes", inputs, points, RAYS).arrays["transfer"]


def image_psnr(data: Data, net: NetSpec) -> float:
    """Mean over the views, covered pixels, as the pipeline scores them."""
    sky = light.project(light.sky(), net.bands)
    references = [shade(view, transfer, sky) for view, transfer in zip(data.pixels, data.traced, strict=True)]
    images = [shade(view, netspec.evaluate_unit(net, view.positions, view.normals), sky) for view in data.pixels]
    covered = [np.isin(np.arange(SIZE * SIZE), view.pixel).reshape(SIZE, SIZE) for view in data.pixels]
    return score.score_views(images, references, covered, score.exposure(references, covered)).summary()["psnr"]


def run(data: Data, options: TrainOptions, model: ModelOptions) -> Iterator[tuple[str, Any]]:
    """The measured columns of one row."""
    steps = max(1, round(options.cpu_seconds * calibrate(data.points, model=model, options=options)))
    yield "steps", steps
    try:
        result = train(data.points, model=model, options=options, steps=steps)
    except PrtnetError as error:
        yield "note", str(error)
        return
    errors = [
        netspec.evaluate_unit(result.net, view.positions, view.normals) - transfer
        for view, transfer in zip(data.pixels, data.traced, strict=True)
    ]
    yield "cpu_seconds", round(result.cpu_seconds, 1)
    yield "psnr", round(image_psnr(data, result.net), 2)
    yield "transfer_rmse", round(float(np.sqrt(np.mean(np.concatenate(errors) ** 2))), 5)


def search(name: str, scenes: list[str], cpu_seconds: float, seed: int, only: str | None, cache: Path) -> None:
    """Trains every candidate on every scene and appends the rows."""
    base, changes = SEARCHES[name]
    RESULTS.mkdir(parents=True, exist_ok=True)
    data = [prepare(scene, cache / scene) for scene in scenes]
    for change in changes:
        label = " ".join(f"{key}={value}" for key, value in change.items()) or "as it is"
        if only is not None and only not in label:
            continue
        options = replace(base, **change, cpu_seconds=cpu_seconds, seed=seed)
        for each in data:
            row = {"recipe": name, "change": label, "scene": each.name, "seed": seed}
            append(RESULTS / f"{name}.csv", row | dict(run(each, options, ModelOptions())))


def append(path: Path, row: dict[str, Any]) -> None:
    columns = ["recipe", "change", "scene", "seed", "steps", "cpu_seconds", "psnr", "transfer_rmse", "note"]
    new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="")
        if new:
            writer.writeheader()
        writer.writerow(row)
    print("  ".join(f"{key} {value}" for key, value in row.items()), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=sorted(SEARCHES))
    parser.add_argument("--scenes", nargs="+", default=["plants", "room", "tea_set"])
    parser.add_argument("--cpu-seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", help="only changes whose text contains this")
    parser.add_argument("--cache", type=Path, default=Path("runs/recipes_search"))
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.WARNING)
    search(arguments.name, arguments.scenes, arguments.cpu_seconds, arguments.seed, arguments.only, arguments.cache)
