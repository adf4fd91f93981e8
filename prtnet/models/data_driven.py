"""Basis and operator of data-driven transfer: an SVD of lightmaps and a ridge regression, nothing else.

Belcour, Deliot, Barbier and Soler 2022, *A Data-Driven Paradigm for Precomputed Radiance Transfer*. Each configuration
is divided by the norm of its direct vector d_k. Of the lightmaps Y the mean, as a unit vector, is the first element;
the others are the left singular vectors of what is left of Y, found through the N x N covariance. With the
coefficients C = B^T Y and the unit direct vectors D, "m N",

    M = C (D^T D + lambda I)^-1 D^T

An element more never raises the error on the configurations learned from: it takes |b^T Y|^2 away and adds
|b^T Y (1 - K)|^2, where the eigenvalues of K = (D^T D + lambda I)^-1 D^T D lie in [0, 1].
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int
from scipy import linalg

from prtnet import PrtnetError
from prtnet.data_driven import to_space

Array = np.ndarray

# of a configuration whose direct vector is shorter than this share of the longest nothing can be learned
DARK = 1e-6
# a lightmap so many times as bright, over its direct vector, as the median is of a light that the measurement points
# all but miss: divided by what little they see of it, a few such columns would outweigh all others
MISSED = 3.0
# eigenvalues below this share of the first are rounding
RANK = 1e-10


@dataclass(frozen=True, eq=False)
class Pairs:
    """Configurations to learn from: lightmaps and direct vectors, linear, per colour. `keyframe`: of each."""

    lightmaps: Float32[Array, "c t 3"]
    direct: Float32[Array, "c m 3"]
    keyframe: Int[Array, " c"] | None = None


@dataclass(frozen=True, eq=False)
class Learned:
    """A basis and an operator for each keyframe, or one for all; banks as in `prtnet.data_driven.DataDriven`."""

    basis: Float32[Array, "banks n t"]
    matrices: Float32[Array, "keyframes banks n m"]
    used: int  # columns learned from: configurations, times colours where they share a bank
    dark: int  # columns left out, since the measurement points miss their light


def learn(
    pairs: Pairs,
    *,
    elements: int,
    ridge: float,
    channels: str = "shared",
    gamma: float = 1.0,
    matrices: str = "each",
) -> Learned:
    """`channels`: one bank "shared" by all colours, whose configurations it counts three times, or "separate" ones;
    `gamma`: of the space that is learned in; `matrices`: of keyframes, "each" or "one" for all.

    Raises PrtnetError for fewer configurations than elements and where no measurement point sees light.
    """
    keyframe = np.zeros(len(pairs.direct), int) if pairs.keyframe is None else pairs.keyframe
    keyframe = np.zeros_like(keyframe) if matrices == "one" else keyframe
    lightmaps, direct = (to_space(each, gamma) for each in (pairs.lightmaps, pairs.direct))
    colours = np.split(np.arange(3), _bank_count(channels))
    banks = [normalised(lightmaps[..., each], direct[..., each], keyframe) for each in colours]
    count = int(keyframe.max()) + 1
    learned = []
    for bank in banks:
        basis, c = basis_of(bank.lightmaps, elements)
        each = [ridge_of(c[:, bank.keyframe == k], bank.direct[:, bank.keyframe == k], ridge) for k in range(count)]
        learned.append((basis, np.stack(each)))
    used, dark = sum(len(bank.keyframe) for bank in banks), sum(int(bank.dark) for bank in banks)
    return Learned(
        np.stack([basis for basis, _ in learned]).astype(np.float32),
        np.stack([matrix for _, matrix in learned], axis=1).astype(np.float32),
        used,
        dark,
    )


@dataclass(frozen=True, eq=False)
class Columns:
    """Normalised configurations of one bank: rows of `lightmaps`, columns of `direct`."""

    lightmaps: Float32[Array, "N t"]
    direct: Float64[Array, "m N"]
    keyframe: Int[Array, " N"]
    dark: int


def _bank_count(channels: str) -> int:
    if channels not in ("shared", "separate"):
        raise PrtnetError(f"data_driven.channels: found {channels!r}, expected shared or separate")
    return 1 if channels == "shared" else 3


def normalised(lightmaps: Array, direct: Array, keyframe: Array) -> Columns:
    """The colours of a bank, "c t k" and "c m k", as configurations of their own, each by the norm of its direct."""
    colours = direct.shape[2]
    flat = np.moveaxis(direct, 2, 1).reshape(-1, direct.shape[1]).astype(np.float64)
    maps = np.moveaxis(lightmaps, 2, 1).reshape(len(flat), -1)
    norm = np.linalg.norm(flat, axis=1)
    lit = seen(norm, np.linalg.norm(maps, axis=1))
    if not lit.any():
        raise PrtnetError(
            "data-driven: found no light at any measurement point in any configuration, expected lights that reach the"
            " scene; choose another data_driven.scenario or more data_driven.points"
        )
    rows = (maps[lit] / norm[lit, None]).astype(np.float32)
    return Columns(rows, (flat[lit] / norm[lit, None]).T, np.repeat(keyframe, colours)[lit], int(np.sum(~lit)))


def seen(direct: Float[Array, "*n"], lightmaps: Float[Array, "*n"]) -> Bool[Array, "*n"]:
    """Which lights measurement points do not miss, by the norms of direct vectors and of lightmaps."""
    lit = direct > DARK * max(float(direct.max(initial=0.0)), 1e-30)
    level = lightmaps / np.where(lit, direct, 1)
    return lit & (level <= MISSED * np.median(level[lit])) if lit.any() else lit


def basis_of(lightmaps: Float[Array, "N t"], elements: int) -> tuple[Float64[Array, "n t"], Float64[Array, "n N"]]:
    """(B^T, orthonormal rows; C = B^T Y): the mean, then the left singular vectors of what is left without it.

    Raises PrtnetError where there are fewer configurations, or fewer independent ones, than elements.
    """
    if len(lightmaps) < elements:
        raise PrtnetError(
            f"data-driven: found {len(lightmaps)} configurations for {elements} elements, expected at least as many;"
            " raise data_driven.configurations or lower data_driven.elements"
        )
    y = lightmaps.astype(np.float64)
    mean = y.mean(axis=0)
    length = np.linalg.norm(mean)
    first = mean / length if length > 0 else mean
    rest = y - np.outer(y @ first, first)
    others = [len(y) - elements + 1, len(y) - 1] if elements > 1 else [len(y) - 1, len(y) - 1]
    values, vectors = linalg.eigh(rest @ rest.T, subset_by_index=others)
    values, vectors = values[::-1][: elements - 1], vectors[:, ::-1][:, : elements - 1]
    found = int(np.sum(values > RANK * max(float(np.sum(y * y)), 1e-300))) + (length > 0)
    if found < elements:
        raise PrtnetError(
            f"data-driven: found only {found} independent lightmaps for {elements} elements; lower"
            " data_driven.elements or choose a data_driven.scenario with more variety"
        )
    rows = vectors.T @ rest
    # rounding: against the first and each other once more
    stacked = np.concatenate([first[None], rows / np.linalg.norm(rows, axis=1, keepdims=True)])
    q, r = np.linalg.qr(stacked.T)
    basis = (q * np.where(np.diag(r) < 0, -1, 1)).T
    return basis, basis @ y.T


def ridge_of(c: Float[Array, "n N"], direct: Float[Array, "m N"], ridge: float) -> Float64[Array, "n m"]:
    """M = C (D^T D + lambda I)^-1 D^T = C D^T (D D^T + lambda I)^-1, by the smaller of the two matrices.

    A lambda of 0 takes the pseudo-inverse.
    """
    points, columns = direct.shape
    if ridge == 0:
        return c @ np.linalg.pinv(direct)
    if columns <= points:
        return c @ np.linalg.solve(direct.T @ direct + ridge * np.eye(columns), direct.T)
    return np.linalg.solve(direct @ direct.T + ridge * np.eye(points), direct @ c.T).T


def projected(basis: Float[Array, "banks n t"], lightmaps: Float[Array, "c t 3"], gamma: float) -> Array:
    """Lightmaps as near as the basis comes to them, in the space of `gamma`, which its result is in as well."""
    values = to_space(lightmaps, gamma).astype(np.float64)
    whole = np.broadcast_to(basis, (3, *basis.shape[1:])).astype(np.float64)
    u = np.einsum("hnt,cth->cnh", whole, values, optimize=True)
    return np.einsum("hnt,cnh->cth", whole, u, optimize=True)
