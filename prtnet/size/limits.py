"""What keeps the best of a search from the target, as far as its trials show it."""

import math
from collections.abc import Mapping

from prtnet.size.candidate import Candidate, Tried, cost_of

NEAR_NOISE, STEEP, RISING = 3.0, 1.0, 0.5  # dB: below the floor, by three times the training, by twice the cost


def limits(
    candidates: list[Candidate],
    tried: list[Tried],
    expected: Mapping[str, tuple[float, float]],
    *,
    floor: float | None,
    cost: str,
) -> dict[str, str]:
    """Any of noise, training and capacity, else `flat`, each with what was seen and what to do.

    `expected`: name -> PSNR in full and its spread. At least one candidate must have been trained in full.
    """
    best = max((each for each in tried if each.share == 1), key=lambda each: each.psnr)
    found = {}
    if floor is not None and best.psnr >= floor - NEAR_NOISE:
        found["noise"] = (
            f"the best is within {NEAR_NOISE:g} dB of the noise floor, {floor:.1f} dB: take more rays for the"
            " reference (render.traced_directions) and for training (samples.directions)"
        )
    shorter = [each for each in tried if each.candidate == best.candidate and each.share < 1]
    if shorter:
        last = max(shorter, key=lambda each: each.share)
        gain = (best.psnr - last.psnr) / -math.log(last.share, 3)
        if gain >= STEEP:
            found["training"] = f"each factor of three in training still gives {gain:.1f} dB: train longer"
    costs = [cost_of(each, cost)[0] for each in candidates]
    reached = [expected[each.name][0] for each in candidates]
    smaller = [value for value, spent in zip(reached, costs, strict=True) if spent <= max(costs) / 2]
    if smaller and max(reached) - max(smaller) >= RISING:
        rise = max(reached) - max(smaller)
        found["capacity"] = f"twice the cost still gives {rise:.1f} dB at the largest: allow larger networks"
    if not found:
        found["flat"] = (
            "neither size nor training gives more, and the noise floor is not near: look at the recipe, samples.count"
            " and samples.directions"
        )
    return found
