"""Trains a net on samples in memory: one thread, a step count that is fixed before the first step, exact resume.

Nothing of a run depends on when it was interrupted. The permutation of each epoch follows from (seed, epoch), the
learning rate from the step, and all else is in the checkpoint, so a killed run that goes on ends in the same bytes.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from prtnet import PrtnetError, netspec
from prtnet.models import checkpoint, optimiser, patience
from prtnet.models.board import Board
from prtnet.models.inference import one_thread
from prtnet.models.mlp import ModelOptions
from prtnet.models.patience import Patience
from prtnet.models.recipe import TrainOptions
from prtnet.models.run import Points, Run
from prtnet.netspec import NetSpec

log = logging.getLogger(__name__)

Array = np.ndarray
OnLog = Callable[[dict[str, Any]], None]

_CHECK = 50  # steps between looks at the loss
_LOG_SECONDS = 0.3


@dataclass(frozen=True)
class TrainResult:
    """A trained net. `history` is the loss of each of the `steps` taken, `cpu_seconds` the sum over interruptions."""

    net: NetSpec
    history: Float[Array, " steps"]
    cpu_seconds: float
    steps: int
    held_out_rmse: Float[Array, " k"] | None  # of the transfer, for each coefficient


def train(
    points: Points,
    *,
    model: ModelOptions,
    options: TrainOptions,
    steps: int,
    held_out: Points | None = None,
    checkpoint_path: Path | None = None,
    log_dir: Path | None = None,
    on_log: OnLog | None = None,
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    scale: float = 1.0,
    name: str = "net",
) -> TrainResult:
    """Trains for exactly `steps` steps (`calibrate` says how many fit into a time) or goes on from `checkpoint_path`.

    With `options.patience` it may end sooner, on points kept back from `points` and not on `held_out`.
    `centre` and `scale` only go into the net: they take file coordinates to the unit positions given here. The last
    checkpoint stays, finished; delete it once the net is kept. Raises PrtnetError where the loss diverges.
    """
    with one_thread():
        points, kept_back = patience.split(points) if options.patience else (points, None)
        run = Run(points, model, options, steps)
        patient = Patience(run, kept_back)
        key = run.fingerprint(points)
        state = checkpoint.load(checkpoint_path, key) if checkpoint_path is not None else None
        if state is not None:
            run.restore(state)
            patient.restore(state)
            log.info("training goes on from step %d of %d", run.step, steps)
        elif checkpoint_path is not None:
            # a folder that cannot be written is found now, and not after some time of training
            checkpoint.save(checkpoint_path, run.state() | patient.state(), key)
        board = Board(log_dir, run.step) if log_dir is not None else None
        watch = _Watch(run, held_out, board, on_log, checkpoint_path)
        saved = run.cpu_seconds
        while run.step < steps and not patient.over:
            run.advance()
            watch.look()
            patient.look()
            due = run.step == steps or patient.over or run.cpu_seconds - saved >= options.checkpoint_seconds
            if checkpoint_path is not None and due:
                checkpoint.save(checkpoint_path, run.state() | patient.state(), key)
                saved = run.cpu_seconds
        watch.close()
        net = run.net.spec(patient.parameters(), centre=centre, scale=scale, name=name)
    rmse = _rmse(net, held_out) if held_out is not None else None
    return TrainResult(net, run.history[: run.step].cpu().numpy(), run.cpu_seconds, run.step, rmse)


def calibrate(points: Points, *, model: ModelOptions, options: TrainOptions) -> float:
    """Training steps per CPU-second on this machine (on CUDA: per second): the median of blocks after a warm-up."""
    blocks, length = 7, 10
    with one_thread():
        run = Run(points, model, options, steps=(blocks + 1) * length)
        rates = []
        for _ in range(blocks + 1):
            before = run.cpu_seconds
            for _ in range(length):
                run.advance()
            rates.append(length / max(run.cpu_seconds - before, 1e-9))
    return median(rates[1:])


class _Watch:
    """Looks at a run after each step: stops one that diverges, and feeds the progress line and TensorBoard."""

    def __init__(
        self,
        run: Run,
        held_out: Points | None,
        board: Board | None,
        on_log: OnLog | None,
        checkpoint_path: Path | None = None,
    ) -> None:
        self._checkpoint_path = checkpoint_path
        self._run, self._held_out, self._board, self._on_log = run, _some(held_out), board, on_log
        self._first_step, self._started, self._logged = run.step, time.monotonic(), 0.0

    def look(self) -> None:
        run = self._run
        # also before each step at which a net is made of the weights
        looks = (max(1, run.steps // 10), max(1, run.steps // patience.LOOKS), _CHECK)
        if run.step == run.steps or any(run.step % every == 0 for every in looks):
            self._refuse_divergence()
        now = time.monotonic()
        if self._on_log is not None and (now - self._logged > _LOG_SECONDS or run.step == run.steps):
            self._logged = now
            rate = self._rate(now)
            loss = float(run.history[run.step - 1])
            eta = (run.steps - run.step) / rate
            self._on_log({"step": run.step, "steps": run.steps, "loss": loss, "rate": rate, "eta": eta})
        if self._board is not None:
            self._write(self._board, now)

    def close(self) -> None:
        if self._board is not None:
            self._board.close()

    def _rate(self, now: float) -> float:
        """Steps per second of this process."""
        return (self._run.step - self._first_step) / max(now - self._started, 1e-9)

    def _learning_rate(self) -> float:
        run = self._run
        return run.options.learning_rate * optimiser.rate(run.options, run.step - 1, run.steps)

    def _refuse_divergence(self) -> None:
        run = self._run
        recent = float(run.history[max(0, run.step - _CHECK) : run.step].mean())
        start = float(run.history[0])
        settled = run.step >= max(4 * _CHECK, run.steps // 20)
        if not all(torch.isfinite(each).all() for each in run.parameters()):
            recent = float("nan")
        if np.isfinite(recent) and not (settled and recent > start):
            return
        if self._checkpoint_path is not None:
            # nobody goes on from it
            self._checkpoint_path.unlink(missing_ok=True)
        raise PrtnetError(
            f"training diverged at step {run.step} of {run.steps}: found a mean loss of {recent:.4g} over the last"
            f" {_CHECK} steps, expected less than the {start:.4g} at the start; the learning rate was"
            f" {self._learning_rate():.3g}: lower train.learning_rate"
        )

    def _write(self, board: Board, now: float) -> None:
        run = self._run
        if run.step % max(1, run.steps // 200) == 0 or run.step == run.steps:
            values = {"loss": float(run.history[run.step - 1]), "learning_rate": self._learning_rate()}
            board.scalars(run.step, values | {"steps_per_second": self._rate(now)})
        seen = self._held_out
        if seen is not None and (run.step % max(1, run.steps // 10) == 0 or run.step == run.steps):
            net = run.net.spec(run.parameters())
            predicted = netspec.evaluate_unit(net, seen.positions, seen.normals, uv=seen.uv)
            error = float(np.sqrt(np.mean((predicted - seen.transfer) ** 2)))
            board.scalars(run.step, {"held_out_rmse": error})
            board.picture(run.step, predicted, seen.transfer)


def _some(points: Points | None) -> Points | None:
    """At most 4096 points, evenly picked: enough for a curve."""
    if points is None:
        return None
    return points.at(slice(None, None, max(1, len(points.transfer) // 4096)))


def _rmse(net: NetSpec, points: Points) -> Float[Array, " k"]:
    predicted = netspec.evaluate_unit(net, points.positions, points.normals, uv=points.uv)
    return np.sqrt(np.mean((np.asarray(predicted, np.float64) - points.transfer) ** 2, axis=0))
