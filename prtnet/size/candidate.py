"""What a search for a size is about: networks that could be trained, trials of them, and how it ended."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from prtnet import PrtnetError

COSTS = ("macs", "bytes")
VIEWS = ("mean", "worst")


@dataclass(frozen=True)
class Candidate:
    """A network that could be trained. Costs are those of one pixel, and of the stored net."""

    name: str
    width: int
    depth: int  # hidden layers
    family: str  # what it has besides: encoding, grids, residual
    macs: int
    bytes: int
    settings: Mapping[str, Any] = field(default_factory=dict, compare=False)  # what makes it, for the caller


@dataclass(frozen=True)
class Trial:
    """What a network reached, in dB, and what its training took."""

    psnr: float
    psnr_worst: float
    cpu_seconds: float


@dataclass(frozen=True)
class Tried:
    """One trial, with what was expected in full of that candidate just after it."""

    candidate: Candidate
    share: float
    trial: Trial
    psnr: float  # of the view that counts
    expected: float
    spread: float


@dataclass(frozen=True)
class Found:
    """How a search ended. `candidates` are those within the budgets, the cheapest first."""

    choice: Candidate | None
    candidates: tuple[Candidate, ...]
    tried: tuple[Tried, ...]
    expected: Mapping[str, tuple[float, float]]  # name -> PSNR in full and its spread, 0 where it was measured
    reason: str
    limits: Mapping[str, str]  # noise, training, capacity, or flat -> what was seen; where nothing meets the target

    def longest(self, candidate: Candidate) -> Tried | None:
        """The trial of a candidate with the largest share."""
        return max(
            (each for each in self.tried if each.candidate == candidate), key=lambda each: each.share, default=None
        )

    @property
    def best(self) -> Tried | None:
        """The best of what was trained in full."""
        full = [each for each in self.tried if each.share == 1]
        return max(full, key=lambda each: each.psnr, default=None)

    @property
    def cpu_seconds(self) -> float:
        """Of all trials."""
        return sum(each.trial.cpu_seconds for each in self.tried)

    @property
    def sweep_seconds(self) -> float:
        """About what training every candidate in full takes: by the longest trials, in between by multiply-adds."""
        known = [(each.macs, trial) for each in self.candidates if (trial := self.longest(each))]
        if not known:
            return 0.0
        macs, seconds = zip(*((cost, each.trial.cpu_seconds / each.share) for cost, each in known), strict=True)
        order = np.argsort(macs, kind="stable")
        costs = [each.macs for each in self.candidates]
        return float(np.interp(costs, np.array(macs)[order], np.array(seconds)[order]).sum())


def cost_of(candidate: Candidate, cost: str = "macs") -> tuple[int, int]:
    """What candidates are ordered by: multiply-adds, and bytes where these are equal; or the other way round."""
    if cost == "macs":
        return candidate.macs, candidate.bytes
    return candidate.bytes, candidate.macs


def within(
    candidates: Sequence[Candidate], *, max_macs: float | None, max_bytes: float | None, cost: str = "macs"
) -> list[Candidate]:
    """The candidates that keep to the budgets, the cheapest first. Raises PrtnetError where there is none."""
    ordered = sorted(candidates, key=lambda each: cost_of(each, cost))
    budgets = {
        "macs": math.inf if max_macs is None else max_macs,
        "bytes": math.inf if max_bytes is None else max_bytes,
    }
    kept = [each for each in ordered if each.macs <= budgets["macs"] and each.bytes <= budgets["bytes"]]
    if kept:
        return kept
    if not ordered:
        raise PrtnetError("size: found no candidate, expected at least one; give size.widths and size.depths")
    for name, words in (("macs", "multiply-adds per pixel"), ("bytes", "bytes")):
        least = min(ordered, key=lambda each: getattr(each, name))
        if getattr(least, name) > budgets[name]:
            raise PrtnetError(
                f"size.max_{name}: found {budgets[name]:g}, but the cheapest candidate, {least.name}, takes"
                f" {getattr(least, name)} {words}; raise the budget or give smaller size.widths and size.depths"
            )
    raise PrtnetError(
        f"size: no candidate keeps to both size.max_macs={max_macs} and size.max_bytes={max_bytes}; the cheapest,"
        f" {ordered[0].name}, takes {ordered[0].macs} multiply-adds per pixel and {ordered[0].bytes} bytes"
    )
