"""Transfer as a weighted sum of a few vectors: principal components, of everything or of each of several clusters.

    T_p = m_c + sum_i w_pi b_ci        c: the cluster of point p; m: its mean; b: its vectors, orthonormal

Sloan, Hall, Hart and Snyder 2003, *Clustered Principal Components for Precomputed Radiance Transfer*. Under a light L
a point needs m.L and b_i.L, once per light, and its own weights: n multiply-adds per colour in place of as many as
there are coefficients. The clusters start as those of vector quantisation (no vectors), then points go to the cluster
whose vectors come nearest to them and each cluster takes the principal components of its points, in turns, while the
number of vectors grows. Components are eigenvectors of the Gram matrix of the coefficients, "d d", which is far smaller
than that of the points; points count by the area they stand for.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int, Int32

from prtnet import PrtnetError

Array = np.ndarray

# points that are learned from: of the plants, four times as many lower the error by 1 %, a quarter raises it by 6 %
MOST_POINTS = 1 << 15
# assignments with fewer vectors than there will be, and at most with all of them
PASSES, MOST_PASSES = 3, 20
# a pass that lowers the error by less than this share is the last
SETTLED = 1e-3
# eigenvalues below this share of the first are rounding: their vectors are 0
RANK = 1e-11
# points at a time: to be decoded, and to be held against all clusters, which should stay in the cache
CHUNK, NEAR = 1 << 15, 1 << 12


@dataclass(frozen=True, eq=False)
class Linear:
    """The means and vectors of clusters; the rows of `bases` are orthonormal, or 0 where a cluster has no more."""

    means: Float32[Array, "c d"]
    bases: Float32[Array, "c n d"]

    @property
    def clusters(self) -> int:
        return len(self.means)

    @property
    def elements(self) -> int:
        return self.bases.shape[1]

    @property
    def bytes(self) -> int:
        """Of means and vectors, float32."""
        return 4 * (self.means.size + self.bases.size)


@dataclass(frozen=True, eq=False)
class Encoded:
    """Points as a `Linear` keeps them."""

    cluster: Int32[Array, " p"]
    weights: Float32[Array, "p n"]


def check(elements: int, clusters: int, channels: int) -> None:
    """Raises PrtnetError, naming the configuration's key, for numbers that cannot be."""
    if not 1 <= elements <= channels:
        raise PrtnetError(f"linear.elements: found {elements}, expected 1 to {channels}, the channels of the transfer")
    if not 1 <= clusters <= 4096:
        raise PrtnetError(f"linear.clusters: found {clusters}, expected 1 to 4096")


def fit(
    transfer: Float[Array, "p d"],
    areas: Float[Array, " p"],
    *,
    elements: int,
    clusters: int = 1,
    rng: np.random.Generator,
    most: int = MOST_POINTS,
) -> Linear:
    """The vectors that come nearest to transfer at points that stand for `areas` (of any unit).

    Of more than `most` points so many are drawn by their area. Raises PrtnetError for numbers that cannot be, for more
    clusters than points, and for points without area.
    """
    check(elements, clusters, transfer.shape[1])
    x, w = _drawn(transfer, areas, most, rng)
    if len(x) < clusters:
        raise PrtnetError(f"linear.clusters: found {clusters} for {len(x)} points, expected at most one for each")
    if clusters == 1:
        return _subspaces(x, w, np.zeros(len(x), np.int32), 1, elements)
    assigned = _nearest_seed(x, w, clusters, rng)
    linear, seen = _subspaces(x, w, assigned, clusters, 0), np.inf
    for count in _counts(elements):
        for _ in range(MOST_PASSES if count == elements else PASSES):
            linear = _subspaces(x, w, assigned, clusters, count)
            assigned, errors = nearest(linear, x)
            total = float(np.sum(w * errors))
            if total > (1 - SETTLED) * seen:
                break
            seen = total
        seen = np.inf
    return linear


def _counts(elements: int) -> list[int]:
    """Numbers of vectors on the way to all of them: 0, 1, 2, 4, ..."""
    return [0, *(1 << i for i in range(elements.bit_length()) if 1 << i < elements), elements]


def _drawn(transfer: Array, areas: Array, most: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """At most so many points, and the weight of each."""
    total = float(np.sum(areas, dtype=np.float64))
    if not total > 0:
        raise PrtnetError(f"linear: found {len(areas)} points without area, expected some that stand for a surface")
    if len(transfer) <= most:
        return np.asarray(transfer, np.float32), np.asarray(areas, np.float64) / total
    # systematic: one draw in each of `most` equal parts of the whole area
    places = (np.arange(most) + rng.random(most)) / most
    chosen = np.searchsorted(np.cumsum(areas, dtype=np.float64) / total, places).clip(max=len(areas) - 1)
    return np.asarray(transfer[chosen], np.float32), np.full(most, 1 / most)


def _nearest_seed(x: Array, w: Array, clusters: int, rng: np.random.Generator) -> Int32[Array, " p"]:
    """The nearest of points drawn by how far they are from those before (Arthur and Vassilvitskii 2007, k-means++)."""
    assigned, distance = np.zeros(len(x), np.int32), np.full(len(x), np.inf)
    chance = w
    for cluster in range(clusters):
        total = chance.sum()
        chosen = int(rng.choice(len(x), p=chance / total) if total > 0 else rng.integers(len(x)))
        rest = x - x[chosen]
        away = np.einsum("pd,pd->p", rest, rest)
        assigned[away < distance] = cluster
        distance = np.minimum(distance, away)
        chance = w * distance
    return assigned


def _subspaces(x: Array, w: Array, assigned: Array, clusters: int, elements: int) -> Linear:
    """The mean and the first principal components of each cluster."""
    means = np.zeros((clusters, x.shape[1]))
    bases = np.zeros((clusters, elements, x.shape[1]))
    order = np.argsort(assigned, kind="stable")
    for cluster, own in enumerate(np.split(order, np.searchsorted(assigned[order], np.arange(1, clusters)))):
        if len(own) and w[own].sum() > 0:
            means[cluster], bases[cluster] = _components(x[own].astype(np.float64), w[own], elements)
    return Linear(means.astype(np.float32), bases.astype(np.float32))


def _components(
    x: Float64[Array, "p d"], w: Float64[Array, " p"], elements: int
) -> tuple[Float64[Array, " d"], Float64[Array, "n d"]]:
    mean = w @ x / w.sum()
    rest = x - mean
    values, vectors = np.linalg.eigh((rest * w[:, None]).T @ rest)
    rows = vectors.T[::-1][:elements]
    # the sign of an eigenvector is the library's whim
    largest = np.take_along_axis(rows, np.abs(rows).argmax(axis=1)[:, None], axis=1)
    kept = values[::-1][:elements] > max(RANK * float(values[-1]), 1e-300)
    return mean, rows * np.sign(largest) * kept[:, None]


def nearest(linear: Linear, transfer: Float[Array, "p d"]) -> tuple[Int32[Array, " p"], Float32[Array, " p"]]:
    """(the cluster that comes nearest to each point, the squared error it leaves, to 1e-6 of the point's variance)."""
    clusters, elements, channels = linear.bases.shape
    # about the middle of all clusters squares lose the fewest digits
    middle = linear.means.mean(axis=0, dtype=np.float64)
    means, bases = linear.means - middle, linear.bases.astype(np.float64)
    rows = np.concatenate([means, bases.reshape(-1, channels)]).T.astype(np.float32)
    offsets = np.einsum("cnd,cd->cn", bases, means).astype(np.float32)
    lengths = np.sum(means**2, axis=1).astype(np.float32)
    assigned = np.zeros(len(transfer), np.int32)
    errors = np.zeros(len(transfer), np.float32)
    for first in range(0, len(transfer), NEAR):
        part = slice(first, first + NEAR)
        x = (transfer[part] - middle).astype(np.float32)
        found = x @ rows
        inside = found[:, clusters:].reshape(len(x), clusters, elements) - offsets
        left = lengths - 2 * found[:, :clusters] - np.einsum("pcn,pcn->pc", inside, inside)
        assigned[part] = left.argmin(axis=1)
        errors[part] = left.min(axis=1) + np.einsum("pd,pd->p", x, x)
    return assigned, np.maximum(errors, 0)


def encode(linear: Linear, transfer: Float[Array, "p d"]) -> Encoded:
    """Each point in the cluster that comes nearest to it. Inverse: `decode`, up to the error of `nearest`."""
    cluster = nearest(linear, transfer)[0] if linear.clusters > 1 else np.zeros(len(transfer), np.int32)
    weights = np.zeros((len(transfer), linear.elements), np.float32)
    for own, number in _by_cluster(cluster, linear.clusters):
        weights[own] = (np.asarray(transfer[own], np.float32) - linear.means[number]) @ linear.bases[number].T
    return Encoded(cluster, weights)


def decode(linear: Linear, encoded: Encoded) -> Float32[Array, "p d"]:
    """Transfer of points. Inverse of `encode`, up to its error."""
    transfer = np.zeros((len(encoded.cluster), linear.means.shape[1]), np.float32)
    for own, number in _by_cluster(encoded.cluster, linear.clusters):
        transfer[own] = linear.means[number] + encoded.weights[own] @ linear.bases[number]
    return transfer


def _by_cluster(cluster: Int[Array, " p"], clusters: int) -> list[tuple[Array, int]]:
    """(points in a chunk of one cluster, its number)."""
    order = np.argsort(cluster, kind="stable")
    groups = np.split(order, np.searchsorted(cluster[order], np.arange(1, clusters)))
    return [
        (own[first : first + CHUNK], number) for number, own in enumerate(groups) for first in range(0, len(own), CHUNK)
    ]


def lit(linear: Linear, light: Float[Array, "k 3"], coefficients: int, groups: int = 1) -> Float32[Array, "c _ 3"]:
    """What means and vectors are under a light, per colour: entry 0 of a cluster is m.L, the others b_i.L.

    Of three `groups` of so many coefficients the channels of a vector are for red, green and blue; of one, for all.
    """
    rows = np.concatenate([linear.means[:, None], linear.bases], axis=1).astype(np.float64)
    both = min(coefficients, len(light))
    split = rows.reshape(*rows.shape[:2], groups, coefficients)[..., :both]
    coloured = np.broadcast_to(split, (*split.shape[:2], 3, both))
    return np.einsum("cnhk,kh->cnh", coloured, np.asarray(light[:both], np.float64)).astype(np.float32)


def rmse(linear: Linear, transfer: Float[Array, "p d"], areas: Float[Array, " p"]) -> float:
    """Root of the mean squared error of all channels, points by their area."""
    total = 0.0
    for first in range(0, len(transfer), CHUNK):
        values = np.asarray(transfer[first : first + CHUNK], np.float32)
        error = np.mean((decode(linear, encode(linear, values)) - values) ** 2, axis=1, dtype=np.float64)
        total += float(np.sum(error * areas[first : first + CHUNK]))
    return float(np.sqrt(total / np.sum(areas, dtype=np.float64)))
