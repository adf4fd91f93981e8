"""Joins neighbouring leaves whose transfer is alike, so that fewer networks do.

Ward 1963, *Hierarchical Grouping to Optimize an Objective Function*: of all pairs of neighbours those are joined that
raise the sum of squared distances from the clusters' means least, n_a n_b / (n_a + n_b) |mean_a - mean_b|^2. The
vectors are the points' transfer, whose variance within clusters Sloan, Hall, Hart and Snyder 2003, *Clustered Principal
Components for Precomputed Radiance Transfer*, minimise as well; there are no principal components here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

Array = np.ndarray

_CHUNK = 1 << 16


@dataclass(frozen=True)
class Merge:
    """Two clusters that became one: their leaves, the variance within clusters as a share of the total, and why."""

    kept: tuple[int, ...]
    joined: tuple[int, ...]
    before: float
    after: float
    reason: str


@dataclass(frozen=True)
class Merged:
    """`cluster`: of each leaf, numbered by their first leaves. `within`: its variance within clusters at the end."""

    cluster: tuple[int, ...]
    merges: tuple[Merge, ...]
    within: float
    ended: str  # why no more were joined


@dataclass
class _Clusters:
    """Of each cluster: its points, the mean of their transfer, its leaves (none once it has joined another)."""

    count: Int[Array, " m"]
    mean: Float64[Array, "m k"]
    leaves: list[tuple[int, ...]]
    touching: Bool[Array, "m m"]

    def pairs(self) -> Int[Array, "p 2"]:
        return np.argwhere(np.triu(self.touching))

    def cost(self, pairs: Int[Array, "p 2"]) -> Float64[Array, " p"]:
        """What joining each pair adds to the sum of squares."""
        a, b = pairs.T
        away = np.square(self.mean[a] - self.mean[b]).sum(axis=1)
        return self.count[a] * self.count[b] / np.maximum(self.count[a] + self.count[b], 1) * away

    def join(self, a: int, b: int) -> None:
        """b becomes part of a."""
        total = self.count[a] + self.count[b]
        self.mean[a] += (self.mean[b] - self.mean[a]) * self.count[b] / max(total, 1)
        self.count[a], self.count[b] = total, 0
        self.leaves[a], self.leaves[b] = tuple(sorted(self.leaves[a] + self.leaves[b])), ()
        self.touching[a] |= self.touching[b]
        self.touching[:, a] |= self.touching[:, b]
        self.touching[b] = self.touching[:, b] = self.touching[a, a] = False

    @property
    def left(self) -> int:
        return sum(map(bool, self.leaves))


def merge(
    leaf: Int[Array, " n"],
    transfer: Float[Array, "n k"],
    touching: Bool[Array, "leaves leaves"],
    home: Int[Array, " leaves"],
    names: Sequence[str],
    *,
    networks: int | None = None,
    quality: float | None = None,
    least: int = 0,
) -> Merged:
    """Clusters of leaves. Each leaf without points goes to its `home`, a leaf that has some, with no question asked.

    Clusters of fewer than `least` points are joined first, the smallest before the others; then the pair that costs
    least, until `networks` clusters are left or a merge would raise the variance within clusters by more than `quality`
    of the total. Neither: nothing is joined.
    """
    groups, within, total = _start(leaf, transfer, touching, home)
    merges: list[Merge] = []
    if networks is None and quality is None:
        return Merged(_numbered(groups), (), within / total, "no merging was asked for")
    while True:
        pairs = groups.pairs()
        cost = groups.cost(pairs)
        chosen, why = _small(groups, pairs, cost, least)
        if chosen is None:
            chosen, why = _alike(groups, cost, total, networks, quality)
        if chosen is None:
            return Merged(_numbered(groups), tuple(merges), within / total, why)
        a, b = (int(index) for index in pairs[chosen])
        before, within = within, within + float(cost[chosen])
        reason = f"{_words(groups.leaves[a], names)} and {_words(groups.leaves[b], names)}: {why}"
        reason += f"; variance within clusters {before / total:.2%} -> {within / total:.2%} of the total"
        merges.append(Merge(groups.leaves[a], groups.leaves[b], before / total, within / total, reason))
        groups.join(a, b)


def _start(leaf: Array, transfer: Array, touching: Array, home: Array) -> tuple[_Clusters, float, float]:
    """A cluster of each leaf with points, the sum of squares within them, and that of the whole, both above 0."""
    leaves = len(home)
    count = np.bincount(leaf, minlength=leaves)
    chunks = [slice(start, start + _CHUNK) for start in range(0, len(leaf), _CHUNK)]
    mean = np.stack([np.bincount(leaf, column, leaves) for column in transfer.T], axis=1)
    mean /= np.maximum(count, 1)[:, None]
    # about the means: a difference of sums of squares would lose what is small
    within = sum(float(np.square(transfer[chunk] - mean[leaf[chunk]]).sum()) for chunk in chunks)
    between = float((count[:, None] * np.square(mean - np.average(mean, axis=0, weights=count))).sum())
    groups = _Clusters(count, mean, [(each,) for each in range(leaves)], touching.copy())
    for each, goal in enumerate(home):
        if each != goal:
            groups.join(int(goal), each)
    return groups, within, max(within + between, np.finfo(np.float64).tiny)


def _small(groups: _Clusters, pairs: Array, cost: Array, least: int) -> tuple[int | None, str]:
    """Of the pairs of the smallest cluster with too few points, the one that costs least."""
    for index in np.argsort(groups.count, kind="stable"):
        points = int(groups.count[index])
        its = np.flatnonzero((pairs == index).any(axis=1))
        if groups.leaves[index] and points < least and len(its):
            words = f"one has {points} points, fewer than a network has parameters, {least}, and of its neighbours"
            return int(its[cost[its].argmin()]), f"{words} the other is most like it"
    return None, ""


def _alike(
    groups: _Clusters, cost: Array, total: float, networks: int | None, quality: float | None
) -> tuple[int | None, str]:
    """The pair that costs least, and why it is joined; or why nothing is."""
    left = groups.left
    if left == 1:
        return None, "one cluster is left"
    if networks is not None and left <= networks:
        return None, f"{left} clusters are left, at most {networks} were asked for"
    if not len(cost):
        return None, f"{left} clusters are left, and no two of them touch"
    chosen = int(cost.argmin())
    share = float(cost[chosen]) / total
    if quality is not None and share > quality:
        return None, f"the next merge would add {share:.2%} to the variance within clusters, more than {quality:.2%}"
    goal = f"{networks} networks were asked for" if networks is not None else f"up to {quality:.2%} was allowed"
    return chosen, f"of {len(cost)} pairs of neighbours theirs is the transfer most alike, {share:+.2%}; {goal}"


def _numbered(groups: _Clusters) -> tuple[int, ...]:
    """The cluster of each leaf."""
    found = np.empty(len(groups.leaves), int)
    for index, leaves in enumerate(sorted(filter(None, groups.leaves))):
        found[list(leaves)] = index
    return tuple(found.tolist())


def _words(leaves: tuple[int, ...], names: Sequence[str]) -> str:
    return " + ".join(names[leaf] for leaf in leaves)
