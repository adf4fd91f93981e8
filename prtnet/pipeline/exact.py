"""The reference without SH for a few views, and the rows that are held against it.

An image is an artifact, keyed by what its points reflect, where they lie, and the light itself: its image or its disc.
"""

import hashlib
import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from prtnet import console, score
from prtnet.data import light_sampler
from prtnet.data.light import Light
from prtnet.data.transfer import cores
from prtnet.pipeline.job import Job
from prtnet.pipeline.views import View, row_of
from prtnet.render import exact
from prtnet.render.exact import Points, World
from prtnet.store import Artifact

log = logging.getLogger(__name__)
Array = np.ndarray
Image = Float[Array, "h w 3"]

SHARD_SAMPLES = 1 << 22  # between two saves: some seconds of work that a kill can cost
PILOT_SAMPLES = 1 << 15  # that an estimate of the time is made from


def light_key(light: Light) -> dict[str, Any]:
    """What an image without SH depends on of its light. Coefficients do not tell it, and windows do not touch it."""
    if light.image is not None:
        return {"image": _digest(light.image)}
    return {"beam": light.beam and asdict(light.beam), "rotation": light.rotation}


def add_exact(job: Job, views: Sequence[View]) -> list[View]:
    """The views, with the reference without SH where `render.exact_views` asks for it: evenly chosen, the first one
    among them. None of them where `render.exact_samples` is 0."""
    options = job.config.render
    if not options.exact_samples:
        return list(views)
    count = min(options.exact_views, len(views))
    chosen = set(np.linspace(0, len(views) - 1, count).round().astype(int).tolist())
    out = []
    for index, view in enumerate(views):
        if index in chosen:
            title = f"exact view {index + 1} of {len(views)}"
            view = replace(view, exact=exact_view(job, title, view, announce=0 if index else count))
        out.append(view)
    return out


def exact_view(job: Job, title: str, view: View, *, announce: int = 0, repeat: int = 0) -> Float32[Array, "h w 3"]:
    """The image of a view without SH, linear RGB. `repeat` draws other directions; an estimate for `announce` such
    images is printed, none for 0."""
    gbuffer = view.gbuffer
    points = exact.points_of(job.tracer, gbuffer, job.material)
    return gbuffer.image(_values(job, title, points, announce, repeat))


def _values(job: Job, title: str, points: Points, announce: int, repeat: int) -> Float32[Array, "n 3"]:
    """Radiance of points as an artifact, shard by shard: a killed run goes on where it was."""
    samples, bounces = job.config.render.exact_samples, job.bounces
    inputs = job.scene_key | {"light": light_key(job.light), "samples": samples, "bounces": bounces, "repeat": repeat}
    inputs |= {field.name: _digest(getattr(points, field.name)) for field in fields(points)}
    inputs["seed"] = job.config.seed

    def draw() -> Artifact:
        world = World(job.tracer, light_sampler.of_light(job.light), job.scene)
        count = len(points.origins)
        if announce * count * samples > SHARD_SAMPLES:
            _estimate(job, title, world, points, bounces, announce)
        with console.progress(title, count, "points") as reach:

            def make(shard: int, items: slice) -> dict[str, Array]:
                # a generator per shard: its points do not depend on which shards this process draws
                rng = np.random.default_rng([job.config.seed, repeat, shard])
                part = points.take(np.arange(items.start, items.stop))
                values = _radiance(job, world, part, samples, rng, bounces, lambda done: reach(items.start + done))
                return {"radiance": values.astype(np.float32)}

            artifact = job.store.put_shards("exact", inputs, count, max(1, SHARD_SAMPLES // samples), make)
        seconds = artifact.facts["seconds"]
        log.info("%s: %d points x %d samples in %s", title, count, samples, console.duration(seconds))
        return artifact

    return job.store.once("exact", inputs, draw).arrays["radiance"]


def _radiance(
    job: Job, world: World, points: Points, samples: int, rng: np.random.Generator, bounces: int, progress: Any = None
) -> Array:
    threads = job.config.threads or cores()
    return exact.radiance(world, points, samples=samples, rng=rng, bounces=bounces, progress=progress, threads=threads)


def _estimate(job: Job, title: str, world: World, points: Points, bounces: int, times: int) -> None:
    """Said from a few of the points, drawn and forgotten."""
    rng, samples, count = np.random.default_rng(0), job.config.render.exact_samples, len(points.origins)
    few = points.take(np.linspace(0, count - 1, max(1, min(count, PILOT_SAMPLES // samples))).astype(int))
    _radiance(job, world, few, samples, rng, bounces)
    start = time.perf_counter()
    _radiance(job, world, few, samples, rng, bounces)
    seconds = (time.perf_counter() - start) * times * count / len(few.origins)
    title = f"{title}{f' and {times - 1} more' if times > 1 else ''}: {count} points x {samples} samples without SH"
    console.estimate(title, seconds=seconds, memory=200 * count, disk=12 * times * count)


def exact_rows(
    job: Job, views: Sequence[View], frames: Mapping[str, Sequence[Image]], costs: Mapping[str, Any], exposure: float
) -> list[score.Row]:
    """Rows of all `frames` against the reference without SH, on the views that have one. The row of `traced` is the
    error of SH itself; the noise floor is the reference against itself with other directions, on the first view."""
    chosen = [(index, view, view.exact) for index, view in enumerate(views) if view.exact is not None]
    if not chosen:
        return []
    covered, references = [view.covered for _, view, _ in chosen], [image for _, _, image in chosen]
    rows = []
    for name, images in frames.items():
        metrics = score.score_views([images[index] for index, _, _ in chosen], references, covered, exposure)
        rows.append(row_of(job, metrics, name, "exact", costs.get(name, {})))
    index, view, reference = chosen[0]
    again = exact_view(job, f"exact view {index + 1} again", view, repeat=1)
    metrics = score.score_views([again], [reference], [view.covered], exposure)
    return [*rows, row_of(job, metrics, score.NOISE_FLOOR, "exact", {})]


def _digest(values: Array) -> str:
    head = f"{values.dtype} {values.shape}".encode()
    return hashlib.sha256(head + np.ascontiguousarray(values).tobytes()).hexdigest()
