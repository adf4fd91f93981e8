"""Stage `train`: a step count by one calibration, then the network."""

import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from prtnet import console, netspec
from prtnet.models import memory
from prtnet.models import train as training
from prtnet.models.train import Points
from prtnet.netspec import NetSpec
from prtnet.pipeline import engine
from prtnet.pipeline.atlas import inputs_of
from prtnet.pipeline.bake import NetPoints, PointSet, bake
from prtnet.pipeline.engine import Task
from prtnet.pipeline.job import Job
from prtnet.store import Artifact

log = logging.getLogger(__name__)

HISTORY_POINTS = 400  # of the loss curve that is kept


@dataclass(frozen=True)
class Trained:
    key: str
    net: NetSpec
    facts: Mapping[str, Any]


def train(job: Job, points: NetPoints, rate: float | None = None) -> Trained:
    """The trained net of this job, with its step count, loss curve and held-out errors as facts.

    `rate`: training steps per CPU-second, where they are known; else a calibration finds them.
    """
    inputs = _inputs(job, points)
    kept = job.store.once("net", inputs, lambda: _train(job, points, inputs, rate))
    return Trained(kept.key, netspec.load(kept.path), kept.facts)


def train_as_job(job: Job, points: NetPoints) -> None:
    """Where the engine is SLURM, have the net trained by a job of it; `train` finds it then."""
    key = job.store.path("net", _inputs(job, points)).stem
    if job.config.cluster.engine == "slurm" and job.store.get("net", _inputs(job, points)) is None:
        engine.spread(job, "train", [Task(f"net-{key}", train_baked, {})])


def train_baked(job: Job) -> None:
    """Train the net of a job whose points are in the store."""
    points = bake(job).points
    assert points is not None
    train(job, points)


def planned(job: Job, points: NetPoints) -> tuple[int, float]:
    """The step count of this job's training, and the steps per CPU-second it comes from."""
    return _steps(job, points, _inputs(job, points))


def _inputs(job: Job, points: NetPoints) -> dict[str, Any]:
    options = asdict(job.config.train)
    # how often a run is saved changes nothing of its result; a fixed step count leaves the time without meaning
    del options["checkpoint_seconds"]
    if options["steps"] is not None:
        del options["cpu_seconds"]
    # a net without texels depends on no atlas, and is the one that was trained before there were texels
    texels = {"atlas": inputs_of(job)} if options["texel_size"] else {}
    if not texels:
        del options["texel_size"], options["texel_channels"]
    return texels | {
        "training": points.training.key,
        "model": asdict(job.config.model),
        "train": options,
        # the net's file tells the way back to the mesh's own coordinates
        "frame": [*job.frame.centre.tolist(), job.frame.scale],
    }


def _train(job: Job, points: NetPoints, inputs: Mapping[str, Any], rate: float | None) -> Artifact:
    steps, rate = _steps(job, points, inputs, rate)
    options, model = job.config.train, job.config.model
    title = f"train: {steps} steps of {options.batch} points, {model.words()}, {options.recipe}"
    needed = memory.needed(model, options, *points.training.transfer.shape[::-1])
    console.estimate(title, seconds=steps / rate, memory=needed, disk=1e5)
    checkpoint = job.store.path("net", inputs, ".checkpoint.safetensors")
    with console.progress("train", steps, "steps") as reach:
        result = training.train(
            _points(points.training),
            model=model,
            options=options,
            steps=steps,
            held_out=_points(points.areas) if len(points.areas.positions) else None,
            checkpoint_path=checkpoint,
            log_dir=job.out / "tensorboard",
            on_log=lambda seen: reach(seen["step"]),
            centre=(float(job.frame.centre[0]), float(job.frame.centre[1]), float(job.frame.centre[2])),
            scale=job.frame.scale,
            name=job.scene.name,
        )
    areas = result.held_out_rmse
    facts = {
        "steps": result.steps,
        "cpu_seconds": result.cpu_seconds,
        "history": _thinned(result.history),
        "areas_rmse": None if areas is None else float(np.sqrt(np.mean(np.square(areas)))),
        "vertices_rmse": _rmse(result.net, points.vertices),
        "recipe": options.recipe,
        "width": model.width,
        "depth": model.depth,
    }
    on = {"held-out points": facts["areas_rmse"], "vertices": facts["vertices_rmse"]}
    errors = ", ".join(f"{value:.4f} on {name}" for name, value in on.items() if value is not None)
    log.info("train: %s of CPU time; transfer RMSE %s", console.duration(result.cpu_seconds), errors or "not known")
    kept = job.store.put("net", inputs, lambda path: netspec.save(result.net, path), facts)
    checkpoint.unlink(missing_ok=True)
    return kept


def _steps(job: Job, points: NetPoints, inputs: Mapping[str, Any], known: float | None = None) -> tuple[int, float]:
    """The step count and the steps per CPU-second it comes from, kept before step 1: a resumed run is the same run."""
    options = job.config.train

    def calibrate() -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        rate = known or training.calibrate(_points(points.training), model=job.config.model, options=options)
        steps = options.steps if options.steps is not None else max(1, round(rate * options.cpu_seconds))
        return {}, {"rate": rate, "steps": steps}

    facts = job.store.make("steps", inputs, calibrate).facts
    return facts["steps"], facts["rate"]


def _points(part: PointSet) -> Points:
    return Points(part.positions, part.normals, part.transfer, part.groups, part.uv)


def _rmse(net: NetSpec, part: PointSet) -> float | None:
    """Root mean square error over all coefficients; None without points, as a small cluster may have no vertices."""
    if not len(part.positions):
        return None
    found = netspec.evaluate_unit(net, part.positions, part.normals, uv=part.uv)
    return float(np.sqrt(np.mean((found.astype(np.float64) - part.transfer) ** 2)))


def _thinned(history: np.ndarray) -> list[list[float]]:
    """(step, mean loss) of equal stretches of the run."""
    parts = np.array_split(np.asarray(history, np.float64), min(len(history), HISTORY_POINTS))
    ends = np.cumsum([len(part) for part in parts])
    return [[int(end), float(part.mean())] for end, part in zip(ends, parts, strict=True)]
