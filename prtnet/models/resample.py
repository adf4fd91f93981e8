"""Hard points are drawn more often: shadow edges, where the net is still wrong.

A share s of each batch is drawn in proportion to the last error e seen at each point, the root mean square over its
coefficients; the rest goes through all points in turn, so that none is forgotten and no error grows stale. A point not
yet seen has the error of a net that predicts nothing.

A point may be weighed by (1 / (n q))^c, with q the chance that a draw of either kind takes it out of n points.

c = 1  importance sampling (Katharopoulos and Fleuret 2018, *Not All Samples Are Created Equal*): the mean of the loss
       is what it is without, and only its noise differs.
c = 0  no weights: what is minimised is the loss with a weight of 1 - s + s e / mean e for each point, which goes after
       large errors as a higher power of the error would, and leaves small ones.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from prtnet.models.checkpoint import State

EVERY = 50  # steps between two looks at the errors of all points


class HardPoints:
    """The errors of all points, and draws in proportion to them as they were at the last of every `EVERY` steps."""

    def __init__(self, targets: Float[Tensor, "n c"], share: float, correction: float, seed: int) -> None:
        self._share, self._correction, self._seed = share, correction, seed
        self._errors = _size(targets)
        self._chances = torch.full_like(self._errors, 1 / len(targets))  # of each point, in a draw of a hard one
        self._drawn = torch.empty(0, dtype=torch.int64)  # for all steps up to the next look

    def draw(self, count: int, step: int) -> Int[Tensor, " count"]:
        """`count` points, of which some may come twice. They follow from the seed, the step and the errors."""
        look, index = divmod(step, EVERY)
        if not index:
            # a floor, so that a net without any error can be drawn from
            errors = self._errors.double() + 1e-12
            self._chances = (errors / errors.sum()).float()
        if not index or not len(self._drawn):
            self._drawn = self._draw(count * EVERY, look)
        return self._drawn[index * count : (index + 1) * count]

    def _draw(self, count: int, look: int) -> Int[Tensor, " count"]:
        """One point from each of `count` equal parts of the sum of chances, shuffled."""
        # apart from the generators of the epochs and of the lights
        generator = torch.Generator().manual_seed((1 << 40) + self._seed * 1_000_003 + look)
        parts = torch.arange(count, dtype=torch.float64) + torch.rand(count, generator=generator, dtype=torch.float64)
        order = torch.randperm(count, generator=generator)
        reach = torch.cumsum(self._chances, 0, dtype=torch.float64)
        found = torch.searchsorted(reach, parts.to(reach.device) * (reach[-1] / count))
        return found.clamp_(max=len(reach) - 1)[order.to(reach.device)]

    def weights(self, chosen: Int[Tensor, " b"]) -> Float[Tensor, " b"]:
        """Of points in a batch, in the loss."""
        hard = self._chances[chosen] * len(self._chances)
        return (1 - self._share + self._share * hard) ** -self._correction

    def note(self, chosen: Int[Tensor, " b"], errors: Float[Tensor, "b c"]) -> None:
        """What the net was wrong by at the points of a batch."""
        self._errors[chosen] = _size(errors)

    def state(self) -> State:
        """Inverse of `restore`. Between looks the chances are those of older errors: both are needed."""
        return {"resample.errors": self._errors, "resample.chances": self._chances}

    def restore(self, state: State) -> None:
        device = self._errors.device
        self._errors = state["resample.errors"].to(device)
        self._chances = state["resample.chances"].to(device)
        self._drawn = self._drawn[:0]


def _size(errors: Float[Tensor, "n c"]) -> Float[Tensor, " n"]:
    return errors.detach().square().mean(1).sqrt()
