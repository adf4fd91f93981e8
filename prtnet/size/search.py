"""The cheapest network that meets a target, or the best within a budget, well below the cost of training all.

Candidates are trained with 1/9, 1/3 and all of the training budget, as in successive halving (Jamieson and Talwalkar
2016). With a target, which one is tried next follows from what each is expected to reach in full.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from prtnet import PrtnetError
from prtnet.size.candidate import Candidate, Found, Trial, Tried, within
from prtnet.size.limits import limits
from prtnet.size.predictor import expect

SHARES = (1 / 9, 1 / 3, 1.0)  # of the training budget
DOUBT = 0.05, 0.01  # a candidate with less of a chance to meet the target is left: when one has met it, and before
SURE = 0.9  # one with more of it skips the share between
MOST = 0.5  # of the cost of training all in full; then the search ends with what it has


def search(
    candidates: Sequence[Candidate],
    trial: Callable[[Candidate, float], Trial],
    *,
    target: float | None = None,
    max_macs: float | None = None,
    max_bytes: float | None = None,
    cost: str = "macs",
    view: str = "mean",
    floor: float | None = None,
    on_trial: Callable[[Tried, float], None] | None = None,
) -> Found:
    """The cheapest candidate that meets `target` dB within the budgets; without a target the best within them.

    `trial(candidate, share)` trains with that share of the budget and measures. Only what was trained in full counts
    as meeting the target. Cheaper means fewer multiply-adds per pixel, then fewer bytes; with cost="bytes" the other
    way round. `view`: by the mean or the worst view. `floor`: PSNR of the reference against itself; nothing is tried
    for a target above it. `on_trial` is told each trial, and about how many full trainings are still to come.
    Raises PrtnetError where there is neither target nor budget, or no candidate within it.
    """
    if target is None and max_macs is None and max_bytes is None:
        raise PrtnetError("size: found neither a target nor a budget, expected size.target_psnr, max_macs or max_bytes")
    ordered = within(candidates, max_macs=max_macs, max_bytes=max_bytes, cost=cost)
    if floor is not None and target is not None and target > floor:
        words = (
            f"the reference agrees with itself to {floor:.1f} dB only, and no network can be told from it above that:"
            " more rays raise it (render.traced_directions)"
        )
        reason = f"{target:g} dB lie above the noise floor, {floor:.1f} dB; nothing was trained"
        return Found(None, tuple(ordered), (), {}, reason, {"noise": words})
    run = _Run(ordered, trial, cost, view, on_trial)
    if target is None:
        choice = _halve(run)
        reason = f"the best of those of {len(ordered)} that were left after each share of the training budget"
        return run.found(choice, reason, {})
    choice = _meet(run, target)
    if choice is not None:
        return run.found(choice, _why(run, choice, target), {})
    best = max(run.full, key=lambda index: run.full[index])
    words = f"the best, {ordered[best].name}, reached {run.full[best]:.2f}"
    if doubtful := len(_doubtful(run, target)):
        words += f"; {doubtful} were still in doubt when the search had taken its time"
    found = run.found(None, f"none of {len(ordered)} candidates meets {target:g} dB; {words}", {})
    return replace(found, limits=limits(ordered, run.tried, found.expected, floor=floor, cost=cost))


class _Run:
    """Candidates in the order of their cost, what was tried of them, and what is expected of them."""

    def __init__(
        self,
        candidates: list[Candidate],
        trial: Callable[[Candidate, float], Trial],
        cost: str,
        view: str,
        on_trial: Callable[[Tried, float], None] | None,
    ) -> None:
        self.candidates, self._trial, self.cost, self._view, self._on_trial = candidates, trial, cost, view, on_trial
        self.tried: list[Tried] = []
        self.seen: list[tuple[int, float, float]] = []  # index, share, PSNR
        self.full: dict[int, float] = {}  # index -> PSNR, of what was trained in full
        self.mean, self.spread = expect(candidates, [], cost)

    def attempt(self, index: int, share: float, to_come: Callable[[], float]) -> None:
        """Train and measure; `to_come` is asked for about how many full trainings follow."""
        candidate = self.candidates[index]
        trial = self._trial(candidate, share)
        psnr = trial.psnr if self._view == "mean" else trial.psnr_worst
        self.seen.append((index, share, psnr))
        if share == 1:
            self.full[index] = psnr
        self.mean, self.spread = expect(self.candidates, self.seen, self.cost)
        for known, value in self.full.items():
            self.mean[known], self.spread[known] = value, 0.0
        tried = Tried(candidate, share, trial, psnr, float(self.mean[index]), float(self.spread[index]))
        self.tried.append(tried)
        if self._on_trial is not None:
            self._on_trial(tried, to_come())

    def chance(self, target: float) -> list[float]:
        """Of each candidate to meet the target."""
        return [
            float(value >= target)
            if index in self.full
            else 0.5 * math.erfc((target - value) / (math.sqrt(2) * self.spread[index]))
            for index, value in enumerate(self.mean)
        ]

    @property
    def late(self) -> bool:
        """Whether the trials took as much as a search may take."""
        return bool(self.full) and sum(share for _, share, _ in self.seen) >= max(3.0, MOST * len(self.candidates))

    def next_share(self, index: int, chance: float = 0.0) -> float:
        """1/9 at first, then 1/3, which a candidate that is sure enough skips, then 1."""
        longest = max((share for tried, share, _ in self.seen if tried == index), default=0.0)
        return SHARES[0] if not longest else SHARES[1] if longest < SHARES[1] and chance < SURE else 1.0

    def found(self, choice: int | None, reason: str, limits: Mapping[str, str]) -> Found:
        pairs = zip(self.mean.tolist(), self.spread.tolist(), strict=True)
        expected = {each.name: pair for each, pair in zip(self.candidates, pairs, strict=True)}
        chosen = None if choice is None else self.candidates[choice]
        return Found(chosen, tuple(self.candidates), tuple(self.tried), expected, reason, limits)


def _meet(run: _Run, target: float) -> int | None:
    """The cheapest candidate that was seen to meet the target, once no cheaper one is likely to."""
    while True:
        chance, met, doubtful = run.chance(target), _cheapest(run, target), _doubtful(run, target)
        if met is not None and (run.late or not doubtful):
            return met
        if doubtful and not run.late:
            index = _most_telling(run, doubtful, chance)
            share = run.next_share(index, chance[index])
        else:
            # nothing is likely to meet it, or time is up: the best that is expected says in full whether that is so
            index, share = int(np.argmax(run.mean)), 1.0
            if index in run.full:
                return None
        run.attempt(index, share, lambda: _to_come(run, target))


def _cheapest(run: _Run, target: float) -> int | None:
    return min((index for index, value in run.full.items() if value >= target), default=None)


def _doubtful(run: _Run, target: float) -> list[int]:
    """Cheaper than what meets the target, and not yet known to miss it."""
    chance, met = run.chance(target), _cheapest(run, target)
    cheaper = range(len(run.candidates) if met is None else met)
    return [index for index in cheaper if index not in run.full and chance[index] >= DOUBT[met is None]]


def _most_telling(run: _Run, doubtful: list[int], chance: list[float]) -> int:
    """Of those up to the cheapest that more likely meets the target than not, the one whose trial tells most for its
    cost. The first two are the cheapest of all and the middle one: nothing is known yet."""
    if len(run.seen) < 2:
        return doubtful[len(run.seen) * len(doubtful) // 2]
    likely = next((place for place, index in enumerate(doubtful) if chance[index] >= 0.5), len(doubtful) - 1)
    return max(doubtful[: likely + 1], key=lambda i: _entropy(chance[i]) / math.sqrt(run.next_share(i, chance[i])))


def _entropy(chance: float) -> float:
    rest = max(1 - chance, 1e-12)
    return -chance * math.log(max(chance, 1e-12)) - rest * math.log(rest)


def _to_come(run: _Run, target: float) -> float:
    """About how many full trainings are left: each that is in doubt at its next share, and one in full."""
    if run.late:
        return 0.0
    chance, doubtful = run.chance(target), _doubtful(run, target)
    shares = [run.next_share(index, chance[index]) for index in doubtful]
    return sum(share for share in shares if share < 1) + float(bool(doubtful))


def _halve(run: _Run) -> int:
    """Successive halving by thirds: the best of those that all shares of the budget leave."""
    left = list(range(len(run.candidates)))
    shares = SHARES if len(left) > 1 else SHARES[-1:]
    for rung, share in enumerate(shares):
        for place, index in enumerate(left):
            waiting, count = len(left) - place - 1, len(left)
            run.attempt(index, share, lambda w=waiting, n=count, r=rung: _rungs_to_come(w, n, shares[r:]))
        reached = {index: psnr for index, tried, psnr in run.seen if tried == share}
        left = sorted(left, key=lambda index: -reached[index])[: max(1, math.ceil(len(left) / 3))]
    return left[0]


def _rungs_to_come(waiting: int, count: int, shares: Sequence[float]) -> float:
    """Full trainings left of a rung with `waiting` of `count` candidates still to try, and of the rungs after it."""
    total = waiting * shares[0]
    for share in shares[1:]:
        count = max(1, math.ceil(count / 3))
        total += count * share
    return total


def _why(run: _Run, choice: int, target: float) -> str:
    """What speaks against everything that is cheaper."""
    if choice == 0:
        return f"it meets {target:g} dB, and nothing is cheaper"
    chance, doubtful = run.chance(target), len(_doubtful(run, target))
    nearest = max(range(choice), key=lambda index: (chance[index], run.mean[index]))
    name, psnr = run.candidates[nearest].name, run.mean[nearest]
    how = "reached" if nearest in run.full else "is expected to reach"
    spread = "" if nearest in run.full else f" +- {run.spread[nearest]:.2f}"
    likeliest = f"the likeliest, {name}, {how} {psnr:.2f}{spread}"
    if doubtful:
        late = f"{doubtful} cheaper ones were in doubt when the search had taken its time"
        return f"it meets {target:g} dB; {late}: {likeliest}"
    return f"it meets {target:g} dB, and none of the {choice} cheaper ones is likely to: {likeliest}"
