"""Early stop: a run ends when points it does not learn from have not been met better for some time.

The points are kept back from the training points, not taken from the test set, which a choice by it would flatter.
What is handed over are the weights of the best look.
"""

import logging

import numpy as np
import torch
from torch import Tensor

from prtnet import PrtnetError, netspec
from prtnet.models.checkpoint import State
from prtnet.models.run import Points, Run

log = logging.getLogger(__name__)

LOOKS = 20  # of a run that is not stopped
BETTER = 0.002  # an improvement by less, relative, does not keep a run going
_KEPT, _SHARE = 4096, 20  # at most so many points are kept back, and at most one in so many


def split(points: Points) -> tuple[Points, Points]:
    """(points to learn from, points kept back): every n-th is kept back. Raises PrtnetError where that is none."""
    if len(points.transfer) < _SHARE:
        raise PrtnetError(
            f"train.patience: found {len(points.transfer)} training points, expected at least {_SHARE}, of which one"
            " is kept back; take more points, or train.patience=0"
        )
    every = max(_SHARE, -(-len(points.transfer) // _KEPT))
    back = np.arange(len(points.transfer)) % every == every - 1
    return points.at(~back), points.at(back)


class Patience:
    """Looks at a run at every 20th of its steps. `over` says that it need not go on. Without points it does nothing."""

    def __init__(self, run: Run, kept_back: Points | None) -> None:
        self._run, self._points = run, kept_back
        self._best, self._mark, self._since = float("inf"), float("inf"), 0
        self._parameters: list[Tensor] = []  # of the best look

    @property
    def over(self) -> bool:
        return self._points is not None and self._since >= self._run.options.patience

    def look(self) -> None:
        """After each step."""
        run, points = self._run, self._points
        if points is None or (run.step % max(1, run.steps // LOOKS) and run.step != run.steps):
            return
        net = run.net.spec(run.parameters())
        with np.errstate(over="ignore", invalid="ignore"):
            found = netspec.evaluate_unit(net, points.positions, points.normals, uv=points.uv)
            rmse = float(np.sqrt(np.mean(np.square(found - points.transfer, dtype=np.float64))))
        if not np.isfinite(rmse):
            return  # the run is about to be refused as diverged
        if rmse < self._best:
            self._best, self._parameters = rmse, [parameter.clone() for parameter in run.parameters()]
        self._since = 0 if rmse < self._mark * (1 - BETTER) else self._since + 1
        if not self._since:
            self._mark = rmse
        if self.over:
            counts = run.step, run.steps, self._since, self._best
            log.info("training stops at step %d of %d: hardly better for %d looks, RMSE %.4f at best", *counts)

    def parameters(self) -> list[Tensor]:
        """What the net to hand over is made of."""
        return self._parameters or self._run.parameters()

    def state(self) -> State:
        """Inverse of `restore`."""
        if self._points is None:
            return {}
        counters = torch.tensor([self._best, self._mark, self._since], dtype=torch.float64)
        return {f"best.{i}": tensor for i, tensor in enumerate(self._parameters)} | {"patience": counters}

    def restore(self, state: State) -> None:
        if self._points is None:
            return
        best = sorted((name for name in state if name.startswith("best.")), key=lambda name: int(name[5:]))
        self._parameters = [state[name].to(self._run.device) for name in best]
        self._best, self._mark, since = state["patience"].tolist()
        self._since = int(since)
