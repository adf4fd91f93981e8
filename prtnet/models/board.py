"""TensorBoard: scalars of a training run, pictures of its held-out points, and its line in a sweep."""

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

Array = np.ndarray

_POINTS = 96  # rows of the picture
_ZOOM = 6


class Board:
    """Writes to `folder`. A resumed run passes its first step: what was written from there on before is dropped."""

    def __init__(self, folder: Path, first_step: int) -> None:
        from torch.utils.tensorboard import SummaryWriter  # takes a second to import

        self._writer = SummaryWriter(str(folder), purge_step=first_step)

    def scalars(self, step: int, values: dict[str, float]) -> None:
        for name, value in values.items():
            self._writer.add_scalar(name, value, step)

    def picture(self, step: int, predicted: Float[Array, "n k"], truth: Float[Array, "n k"]) -> None:
        """One row a point, one column a coefficient: truth, prediction, 8 x error, side by side."""
        self._writer.add_image("coefficients", comparison(predicted, truth), step, dataformats="HWC")

    def close(self) -> None:
        self._writer.close()


def hyperparameters(folder: Path, options: Mapping[str, str | float | bool], metrics: Mapping[str, float]) -> None:
    """One line of TensorBoard's tab HPARAMS: what a run chose, and what it reached. What stood in the folder before,
    of the same run, is dropped."""
    from torch.utils.tensorboard import SummaryWriter

    shutil.rmtree(folder, ignore_errors=True)
    with SummaryWriter(str(folder)) as writer:
        writer.add_hparams(dict(options), dict(metrics), run_name=".")


def comparison(predicted: Float[Array, "n k"], truth: Float[Array, "n k"]) -> Float[Array, "h w 3"]:
    """The picture of `Board.picture` in [0, 1]: blue is negative, red positive, white 0. Every n-th point is shown."""
    every = max(1, len(truth) // _POINTS)
    true, guess = truth[::every][:_POINTS], predicted[::every][:_POINTS]
    order = np.argsort(true[:, 0])
    gap = np.zeros((len(true), 1))
    values = np.concatenate([true[order], gap, guess[order], gap, 8 * (guess - true)[order]], axis=1)
    values = np.clip(values, -1, 1).repeat(_ZOOM, 0).repeat(_ZOOM, 1)[..., None]
    red, blue = np.array([0.75, 0.1, 0.1]), np.array([0.1, 0.2, 0.75])
    return 1 - np.abs(values) * (1 - np.where(values > 0, red, blue))
