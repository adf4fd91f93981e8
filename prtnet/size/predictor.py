"""What networks would reach if they were trained in full, from trials of some of them with less.

PSNR grows about linearly with the logarithm of the training budget, by a gain that nets share, and with that of the
cost, smoothly inside a family: a Gaussian process, after Swersky, Snoek and Adams 2014, *Freeze-Thaw Bayesian
Optimization*.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from prtnet.size.candidate import Candidate, cost_of

Array = np.ndarray

# the prior, in dB: of PSNR in full ...
LEVEL = (30.0, 15.0)  # mean and spread
TREND = (1.0, 1.0)  # for each doubling of cost: mean and spread
FAMILY, NEARBY, OWN = 3.0, 1.5, 0.5  # spreads: between families, along a family, of one net
LENGTH = (2.0, 1.0)  # doublings of cost, and of depth + 1, over which nets of a family are alike
# ... and of what three times the budget adds
GAIN = (1.5, 1.0)
GAIN_TREND, GAIN_OWN = 0.3, 0.4  # spreads: for each doubling of cost, of one net
BEND = 0.35  # for each factor of three that is missing: the gain is no straight line, and seeds differ
ROUGHNESS = (0.4, 1.0, 2.5)  # factors of all spreads but the first of each pair; the likeliest is taken


def expect(
    candidates: Sequence[Candidate], tried: Sequence[tuple[int, float, float]], cost: str = "macs"
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """PSNR in full of all candidates and its spread, from trials (index, share, PSNR) of some."""
    size = np.log2([cost_of(each, cost)[0] for each in candidates])
    size, depth = size - size.mean(), np.log2([1.0 + each.depth for each in candidates])
    near = ((size[:, None] - size) / LENGTH[0]) ** 2 + ((depth[:, None] - depth) / LENGTH[1]) ** 2
    # without a hidden layer a net is of another kind
    kinds = [(each.family, each.depth == 0) for each in candidates]
    family = np.array([kinds.index(kind) for kind in kinds])
    alike, own, across = family[:, None] == family, np.eye(len(candidates)), np.outer(size, size)
    shared = LEVEL[1] ** 2 + TREND[1] ** 2 * across + FAMILY**2 * alike
    rough = NEARBY**2 * np.exp(-near / 2) * alike + OWN**2 * own
    mean, index = LEVEL[0] + TREND[0] * size, np.array([each[0] for each in tried], int)
    missing = -np.log([each[1] for each in tried]) / math.log(3)
    surprise = np.array([each[2] for each in tried]) - (mean[index] - GAIN[0] * missing)

    def given(roughness: float) -> tuple[float, Array, Array]:
        """Logarithm of the likelihood of the trials; mean and variance in full."""
        full = shared + roughness**2 * rough
        gain = GAIN[1] ** 2 + roughness**2 * (GAIN_TREND**2 * across + GAIN_OWN**2 * own)
        seen = full[np.ix_(index, index)] + np.outer(missing, missing) * gain[np.ix_(index, index)]
        seen += np.diag((roughness * BEND * missing) ** 2 + 1e-4)
        weight = np.linalg.solve(seen, full[index]).T
        likelihood = -0.5 * (surprise @ np.linalg.solve(seen, surprise) + np.linalg.slogdet(seen)[1])
        variance = np.diag(full) - np.einsum("ni,in->n", weight, full[index])
        return likelihood - abs(math.log(roughness)), mean + weight @ surprise, variance

    _, reached, variance = max((given(roughness) for roughness in ROUGHNESS), key=lambda each: each[0])
    return reached, np.sqrt(np.maximum(variance, 1e-6))
