"""Seams: whether the error of a picture jumps where a scene passes from one cluster to the next.

The error of a method is its picture less the reference, both as they are compared (`score.tone_map`). A pair of
neighbouring pixels that show one surface straddles a border where their clusters differ. Of every border

    ratio = mean |difference of errors| across it / the same of pairs beside it that lie within one of the two clusters

A picture that knows nothing of the clusters has about 1 everywhere: whatever makes errors rough, and the noise of the
reference, is in both means. A step at the border adds to the first alone. `beside` is near the border in the picture
(`REACH`), so that both means see the same shadows at the same size of pixel.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from prtnet import PrtnetError

Array = np.ndarray
Pairs = Int[Array, "2 _"]  # pixels, row * width + column

REACH = 12  # pixels around the pairs of a border in which those beside it are looked for
FEWEST = 24  # pairs on either side of the ratio: less of a border is too little to tell
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

    clusters: tuple[int, int]
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
    places = [_borders(view) for view in views]
    return {name: _seams(images, places) for name, images in errors.items()}


def neighbours(view: Surface) -> Pairs:
    """Pairs of pixels, side by side or one above the other, that show one surface without an edge between them."""
    index = np.arange(view.cluster.size).reshape(view.cluster.shape)
    pairs = [np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()]), np.stack([index[:-1].ravel(), index[1:].ravel()])]
    first, second = np.concatenate(pairs, axis=1)
    shown = (view.cluster.ravel()[first] >= 0) & (view.cluster.ravel()[second] >= 0)
    return np.stack([first, second])[:, shown][:, _joined(view, first[shown], second[shown])]


def _joined(view: Surface, first: Int[Array, " n"], second: Int[Array, " n"]) -> Bool[Array, " n"]:
    """A step from a pixel to the next that leaves the surface leads to another one, however far."""
    positions, normals = view.positions.reshape(-1, 3).astype(np.float64), view.normals.reshape(-1, 3)
    step = positions[second] - positions[first]
    length = np.linalg.norm(step, axis=1)
    straight = np.sum(normals[first] * normals[second], axis=1) >= TURN
    for end in (first, second):
        straight &= np.abs(np.sum(normals[end] * step, axis=1)) <= STEEPEST * length
    return straight


def _borders(view: Surface) -> dict[tuple[int, int], tuple[Pairs, Pairs]]:
    """By the clusters of a border: the pairs across it, and those beside it."""
    pairs, cluster = neighbours(view), view.cluster.ravel()
    low, high = np.sort(cluster[pairs], axis=0)
    found = {}
    for a, b in np.unique(np.stack([low, high])[:, low < high], axis=1).T:
        across = pairs[:, (low == a) & (high == b)]
        near = _grown(across, view.cluster.shape).ravel()
        inside = (low == high) & ((low == a) | (low == b)) & near[pairs].all(axis=0)
        found[int(a), int(b)] = (across, pairs[:, inside])
    return found


def _grown(pairs: Pairs, shape: tuple[int, ...]) -> Bool[Array, "h w"]:
    """Pixels within REACH of one of these, along rows and columns."""
    near = np.zeros(shape, bool)
    near.ravel()[pairs.ravel()] = True
    for axis in (0, 1):
        room = [(REACH + 1, REACH) if each == axis else (0, 0) for each in (0, 1)]
        sums = np.cumsum(np.pad(near, room), axis=axis)
        last = np.take(sums, np.arange(2 * REACH + 1, sums.shape[axis]), axis=axis)
        near = last > np.take(sums, np.arange(shape[axis]), axis=axis)
    return near


def _seams(images: Sequence[Array], places: Sequence[Mapping[tuple[int, int], tuple[Pairs, Pairs]]]) -> Seams:
    found = []
    for clusters in sorted({clusters for place in places for clusters in place}):
        seen = [(image, place[clusters]) for image, place in zip(images, places, strict=True) if clusters in place]
        jumps = [np.concatenate([_jumps(image, pairs[side]) for image, pairs in seen], axis=1) for side in (0, 1)]
        means = [[each[0, each[1] == turn] for turn in (0, 1)] for each in jumps]
        # errors may change along one axis alone: pairs are held against those of the same direction
        alike = [(across, beside) for across, beside in zip(*means, strict=True) if len(across) and len(beside)]
        pairs = sum(len(across) for across, _ in alike)
        if pairs < FEWEST or sum(len(beside) for _, beside in alike) < FEWEST:
            continue
        across = float(sum(each.sum() for each, _ in alike)) / pairs
        beside = float(sum(len(each) * other.mean() for each, other in alike)) / pairs
        found.append(Border(clusters, pairs, across, beside, (across + LEAST) / (beside + LEAST)))
    return Seams(tuple(found))


def _jumps(image: Float[Array, "h w 3"], pairs: Pairs) -> Float[Array, "2 _"]:
    """Of each pair: the difference, mean of the channels; 1 where one pixel is below the other."""
    flat = image.reshape(-1, 3).astype(np.float64)
    return np.stack([np.abs(flat[pairs[1]] - flat[pairs[0]]).mean(axis=1), pairs[1] - pairs[0] > 1])
