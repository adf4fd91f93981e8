"""Seams: whether the error of a picture jumps where a scene passes from one cluster to the next.

The error of a method is its picture less the reference, both as they are compared (`score.tone_map`). A pair of
neighbouring pixels that show one surface straddles a border where their clusters differ. Of every border

    ratio = mean |difference of errors| across it / the same of the pairs beside it

that is, of those within one of the two clusters among the REACH next pairs along the same row or column, each pair of
the border with its own. A picture that knows nothing of the clusters has about 1 everywhere: whatever makes errors
rough, and the noise of the reference, is in both means. A step at the border adds to the first alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from prtnet import PrtnetError

Array = np.ndarray
Key = tuple[int, int]

REACH = 6  # pairs to either side of a border that are beside it
FEWEST = 24  # pairs of a border over all views: less of one is too little to tell
STEEPEST = 0.5  # sine between a surface and the way to its next pixel: more is another surface
TURN = 0.8  # cosine between the normals of two pixels: less is an edge
LEAST = 1e-6  # of the mean jump inside, of tone-mapped values: only keeps 0 / 0 from arising, and gives 1 there


@dataclass(frozen=True, eq=False)
class Surface:
    """What the pixels of a view show; where they show nothing, cluster is -1."""

    positions: Float[Array, "h w 3"]
    normals: Float[Array, "h w 3"]
    cluster: Int[Array, "h w"]  # the one of the greatest weight


@dataclass(frozen=True)
class Border:
    """Between two clusters, over all views."""

    clusters: Key
    pairs: int
    across: float  # mean absolute difference of errors of neighbours, tone-mapped
    beside: float
    ratio: float


@dataclass(frozen=True)
class Seams:
    """Of one method. None where no border is long enough to be measured."""

    borders: tuple[Border, ...]

    @property
    def worst(self) -> float | None:
        return max((border.ratio for border in self.borders), default=None)

    @property
    def mean(self) -> float | None:
        """Of the borders, each by its length."""
        total = sum(border.pairs for border in self.borders)
        return sum(border.pairs * border.ratio for border in self.borders) / total if total else None

    def facts(self) -> dict[str, Any]:
        """As JSON has it."""
        return {"worst": self.worst, "mean": self.mean, "borders": [asdict(border) for border in self.borders]}


def measure(errors: Mapping[str, Sequence[Float[Array, "h w 3"]]], views: Sequence[Surface]) -> dict[str, Seams]:
    """The seams of each method from its errors, picture less reference, tone-mapped, in every view.

    Raises PrtnetError where a method has other views, or other sizes.
    """
    for name, images in errors.items():
        found, expected = [each.shape[:2] for each in images], [each.cluster.shape for each in views]
        if found != expected:
            raise PrtnetError(f"seams of {name}: found images of {found}, expected {expected}")
    # rows, and columns as the rows of turned images
    lines = [(index, turned, _Lines(view, turned)) for index, view in enumerate(views) for turned in (False, True)]
    made = {}
    for name, images in errors.items():
        sums: dict[Key, Array] = {}
        for index, turned, each in lines:
            image = np.asarray(images[index], np.float64)
            for key, values in each.sums(image.transpose(1, 0, 2) if turned else image).items():
                sums[key] = sums.get(key, 0) + values
        made[name] = Seams(tuple(_border(key, *sums[key]) for key in sorted(sums) if sums[key][0] >= FEWEST))
    return made


def _border(key: Key, pairs: float, across: float, beside: float) -> Border:
    across, beside = across / pairs, beside / pairs
    return Border(key, int(pairs), across, beside, (across + LEAST) / (beside + LEAST))


class _Lines:
    """The borders that the rows of a view cross, and what is beside them. Pair c of a row: its pixels c and c + 1."""

    def __init__(self, view: Surface, turned: bool):
        cluster = view.cluster.T if turned else view.cluster
        low, high = np.minimum(cluster[:, :-1], cluster[:, 1:]), np.maximum(cluster[:, :-1], cluster[:, 1:])
        joined = joined_pairs(view, turned) & (low >= 0)
        self._row, self._column = np.nonzero(joined & (low < high))
        self._keys = np.stack([low, high], axis=-1)[self._row, self._column]
        steps = [step for step in range(-REACH, REACH + 1) if step]
        # (pair of a border, step): which pair of the row, and whether it counts
        self._next = np.clip(self._column[:, None] + steps, 0, max(low.shape[1] - 1, 0))
        row = self._row[:, None]
        own = cluster[row, self._next]
        self._counts = joined[row, self._next] & (low == high)[row, self._next]
        self._counts &= (own == self._keys[:, :1]) | (own == self._keys[:, 1:])
        self._counts &= self._next == self._column[:, None] + steps

    def sums(self, error: Float[Array, "h w 3"]) -> dict[Key, Float[Array, " 3"]]:
        """By border: how many pairs have some beside them, their jumps, and the mean jumps beside each, summed."""
        jump = np.abs(np.diff(error, axis=1)).mean(axis=2)
        count = self._counts.sum(axis=1)
        known, found = count > 0, {}
        around = (jump[self._row[:, None], self._next] * self._counts).sum(axis=1)[known] / count[known]
        across, keys = jump[self._row, self._column][known], self._keys[known]
        for key in np.unique(keys, axis=0):
            here = (keys == key).all(axis=1)
            found[int(key[0]), int(key[1])] = np.array([here.sum(), across[here].sum(), around[here].sum()])
        return found


def joined_pairs(view: Surface, turned: bool) -> Bool[Array, "_ _"]:
    """Which neighbours in a row, or, `turned`, in a column, show one surface without an edge between them: a step from
    a pixel to the next that leaves the surface leads to another one, however far."""
    positions, normals = (np.asarray(each, np.float64) for each in (view.positions, view.normals))
    if turned:
        positions, normals = positions.transpose(1, 0, 2), normals.transpose(1, 0, 2)
    step = np.diff(positions, axis=1)
    length = np.linalg.norm(step, axis=2)
    straight = np.sum(normals[:, :-1] * normals[:, 1:], axis=2) >= TURN
    for end in (normals[:, :-1], normals[:, 1:]):
        straight &= np.abs(np.sum(end * step, axis=2)) <= STEEPEST * length
    return straight
