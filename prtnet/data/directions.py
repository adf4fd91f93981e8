"""Sets of directions over a normal, and the frames that turn them to the world.

A set lives in the local frame (z = the normal). It comes with weights such that sum w_i V(d_i) f(d_i) estimates the
integral of V max(0, cos) f over the hemisphere: the cosine is in the weights or in the density. One set serves all
points; each point turns it about its normal by its own random angle, which makes neighbours' errors independent.
"""

from math import pi, sqrt

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError, sh

KINDS = ("cosine_fibonacci", "uniform", "stratified", "random")
PACKET = 16  # sets are rounded up to a multiple of this, the widest ray packet
GOLDEN = (sqrt(5) - 1) / 2
QUARTER = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # turns z to y: Ry(b) = QUARTER Rz(b) QUARTER^T


def local_set(
    kind: str, count: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Directions (unit, local) and weights (sr, cosine included) of one of KINDS, `count` rounded up by `rounded`.

    cosine_fibonacci: spherical Fibonacci points (Keinert et al. 2015) warped to cosine density, all weights pi/n.
    uniform: the Fibonacci points of the hemisphere, weighted by cosine. stratified: jittered cosine-weighted cells.
    random: independent cosine-weighted. Sorted so that runs of 16 are compact patches.
    """
    if kind not in KINDS:
        raise PrtnetError(f"directions: found kind {kind!r}, expected one of {', '.join(KINDS)}")
    n = rounded(count)
    height = (np.arange(n) + 0.5) / n
    turns = np.arange(n) * GOLDEN % 1
    if kind == "stratified":
        height, turns = _jittered(n, rng)
    elif kind == "random":
        height, turns = rng.random(n), rng.random(n)
    z = 1 - height if kind == "uniform" else np.sqrt(1 - height)
    radius = np.sqrt(1 - z * z)
    directions = np.stack([radius * np.cos(2 * pi * turns), radius * np.sin(2 * pi * turns), z], -1)
    weights = 2 * pi / n * z if kind == "uniform" else np.full(n, pi / n)
    order = patches(directions)
    return directions[order], weights[order]


def rounded(count: int) -> int:
    """`count` rounded up to a whole number of ray packets."""
    if count < 1:
        raise PrtnetError(f"directions: found {count}, expected at least 1")
    return -(-count // PACKET) * PACKET


def _jittered(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """One point in each of n cells of the unit square: rows, each cut into nearly equally many cells."""
    rows = max(1, round(sqrt(n / 4)))
    cells = np.diff(np.arange(rows + 1) * n // rows)
    row = np.repeat(np.arange(rows), cells)
    column = np.arange(n) - np.repeat(np.cumsum(cells) - cells, cells)
    edges = np.concatenate([[0], np.cumsum(cells)]) / n
    height = edges[row] + rng.random(n) * cells[row] / n
    return height, (column + rng.random(n)) / cells[row]


def patches(directions: Float[np.ndarray, "n 3"], size: int = PACKET) -> np.ndarray:
    """An order in which each run of `size` is a compact patch of the disk: halved by turns along its longer axis."""

    def split(index: np.ndarray) -> list[np.ndarray]:
        if len(index) <= size:
            return [index]
        points = directions[index, :2]
        axis = int(np.argmax(np.ptp(points, axis=0)))
        index = index[np.argsort(points[:, axis], kind="stable")]
        middle = max(1, round(len(index) / size / 2)) * size
        return split(index[:middle]) + split(index[middle:])

    return np.concatenate(split(np.arange(len(directions))))


def turns(normals: Float[np.ndarray, "n 3"], azimuth: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 6"]:
    """cos and sin of the three angles of R = Rz(a) Ry(b) Rz(azimuth) with R z = normal: c, b, a by pairs, float64."""
    exact = np.asarray(normals, np.float64)
    x, y, z = (exact / np.linalg.norm(exact, axis=1, keepdims=True)).T
    radius = np.hypot(x, y)
    pole = radius == 0
    across = np.where(pole, 1, radius)
    return np.stack(
        [np.cos(azimuth), np.sin(azimuth), z, radius, np.where(pole, 1, x / across), y / across], -1, dtype=np.float64
    )


def frames(turned: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 3 3"]:
    """The rotations of `turns`, float32: column 2 is the normal, columns 0 and 1 the turned tangents."""
    cc, sc, cb, sb, ca, sa = turned.T
    along = np.stack([ca * cb, sa * cb, -sb], -1)
    across = np.stack([-sa, ca, np.zeros_like(sa)], -1)
    normal = np.stack([ca * sb, sa * sb, cb], -1)
    cc, sc = cc[:, None], sc[:, None]
    return np.stack([cc * along + sc * across, cc * across - sc * along, normal], -1).astype(np.float32)


class Table:
    """A direction set with its weighted SH rows, in float32, laid out for both tracers."""

    def __init__(self, local: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, " n"], bands: int):
        self.directions = local.astype(np.float32)
        self.rows = (weights[:, None] * sh.evaluate(np.asarray(local, np.float64), bands)).astype(np.float32)
        matrix = sh.rotation_matrix(QUARTER, bands)
        row, column = np.nonzero(np.abs(matrix) > 1e-12)
        # the quarter turn by its few entries other than zero, and the number of bands
        self.flip = (row, column, matrix[row, column], bands)
        self._packed: dict[tuple[int, int], tuple[np.ndarray, np.ndarray, np.ndarray]] = {}

    def packed(self, width: int, lanes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """For packets of `width`: directions "n/w 3 w", rows padded to blocks "n b lanes", the sum of each packet."""
        if (width, lanes) not in self._packed:
            count, k = self.rows.shape
            rows = np.zeros((count, -(-k // lanes) * lanes), np.float32)
            rows[:, :k] = self.rows
            sums = rows.reshape(-1, width, rows.shape[1]).sum(1, dtype=np.float64).astype(np.float32)
            packets = np.ascontiguousarray(self.directions.reshape(-1, width, 3).transpose(0, 2, 1))
            blocks = rows.reshape(count, -1, lanes), sums.reshape(len(sums), -1, lanes)
            self._packed[width, lanes] = packets, *blocks
        return self._packed[width, lanes]
