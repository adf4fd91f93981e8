"""Speed of training, for `bench.py`: our loop beside a bare one."""

import time
from collections.abc import Callable

import numpy as np
import torch

from prtnet import sh
from prtnet.data import builtin, samples
from prtnet.models import functional, loss, recipe
from prtnet.models import train as training
from prtnet.models.run import Points, Run

BANDS = 5
Row = dict[str, str | float]


def train() -> list[Row]:
    """Steps per CPU-second of our training loop, and of a bare forward, backward and step loop of the same net, loss
    and optimiser on batches in memory, in turns."""
    torch.set_num_threads(1)
    scene = builtin.make("room").centred()
    picked = samples.area_uniform(scene, 400_000, np.random.default_rng(0))
    # what the targets are does not change the time
    points = Points(picked.positions.astype(np.float32), picked.normals, sh.cosine_lobe(picked.normals, BANDS))
    rows: list[Row] = []
    chosen = {
        "default": recipe.TrainOptions(),
        "published": recipe.published(),
        "radiance": recipe.TrainOptions(loss="radiance"),
        "resample=0.5": recipe.TrainOptions(resample=0.5),
    }
    for name, options in chosen.items():
        for model in (recipe.ModelOptions(64, 4), recipe.ModelOptions(16, 2)):
            found = _train_rows(points, model, options)
            rows += [{"scene": f"{name}, k={model.width},l={model.depth}", **row} for row in found]
    return rows


def _train_rows(points: Points, model: recipe.ModelOptions, options: recipe.TrainOptions) -> list[Row]:
    blocks, length = 31, 20
    ours, plain = (Run(points, model, options, blocks * length) for _ in range(2))
    watch, bare = training._Watch(ours, None, None, None), _bare_step(plain)

    def step() -> None:
        ours.advance()
        watch.look()

    taken: dict[str, list[float]] = {"our loop": [], "bare loop": []}
    for _ in range(blocks):
        for name, one in (("our loop", step), ("bare loop", bare)):
            started = time.thread_time()
            for _ in range(length):
                one()
            taken[name].append((time.thread_time() - started) / length)
    rows: list[Row] = [{"what": f"{name}: steps per CPU-s", "value": 1 / np.median(t[1:])} for name, t in taken.items()]
    ratio = np.median(np.array(taken["bare loop"][1:]) / taken["our loop"][1:])
    return [*rows, {"what": "our loop / bare loop, steps per CPU-s", "value": float(ratio)}]


def _bare_step(run: Run) -> Callable[[], None]:
    """Forward, backward and step of a net on 16 batches in memory, in turn, with nothing else of our loop."""
    batches = [run.table[first : first + run.batch].clone() for first in range(0, 16 * run.batch, run.batch)]
    options, number = run.options, iter(range(10**9))
    rows = None if run.functionals is None else run.functionals[: options.loss_samples]

    def step() -> None:
        batch = batches[next(number) % len(batches)]
        with torch.autocast("cpu", torch.bfloat16, enabled=run.bfloat16):
            predicted = run.net(batch[:, :3], batch[:, 3:6])
        if rows is None:
            value = loss.loss(predicted, batch[:, 7:], kind=options.loss, delta=options.huber_delta)
        else:
            value = functional.loss(predicted, batch[:, 7:], rows, kind=options.loss_norm, delta=options.huber_delta)
        value.backward()
        for each in run.optimisers:
            each.step()
            each.zero_grad()

    return step
