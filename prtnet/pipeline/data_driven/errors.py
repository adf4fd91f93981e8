"""How near an operator comes: to lightmaps under the lights that it learned from, and under others.

Errors are RMS over texels, configurations and colours, each by the norm of its direct vector, as in learning: else
bright lights alone would count. Beside an operator's error stands that of the projection onto its basis, which no
coefficients can be below.
"""

from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float, Float64, Int

from prtnet.data_driven import from_space, to_space
from prtnet.models.data_driven import projected, seen

Array = np.ndarray
GROUP = 32  # configurations at a time


@dataclass(frozen=True)
class Errors:
    """In units of lightmap / |x|. `level`: RMS of the lightmaps themselves."""

    rmse: float
    projection: float
    level: float
    worst: float  # RMS of the configuration and colour that it is largest in

    def words(self) -> dict[str, float]:
        return asdict(self) | {"ratio": self.rmse / max(self.projection, 1e-30)}


def errors(
    basis: Float[Array, "banks n t"],
    matrices: Float[Array, "keyframes banks n m"],
    lightmaps: Float[Array, "c t 3"],
    direct: Float[Array, "c m 3"],
    *,
    gamma: float = 1.0,
    keyframe: Int[Array, " c"] | None = None,
    sizes: Float[Array, "c 3"] | None = None,
) -> Errors:
    """Of the colours of configurations that light some measurement point, measured in linear light; `sizes`: what they
    are divided by, where it is not the norm of these direct vectors."""
    frames = np.zeros(len(direct), int) if keyframe is None else keyframe
    length = norms(direct) if sizes is None else sizes
    whole = np.broadcast_to(basis, (3, *basis.shape[1:])).astype(np.float64)
    means = np.zeros((3, len(direct), 3))
    for start in range(0, len(direct), GROUP):
        few = np.arange(start, min(start + GROUP, len(direct)))
        matrix = np.broadcast_to(matrices[frames[few]], (len(few), 3, *matrices.shape[2:]))
        light = to_space(direct[few], gamma)
        u = np.einsum("chnm,cmh->cnh", matrix, light.astype(np.float64), optimize=True)
        truth = lightmaps[few].astype(np.float64)
        found = from_space(np.einsum("hnt,cnh->cth", whole, u, optimize=True), gamma)
        nearest = from_space(projected(basis, lightmaps[few], gamma), gamma)
        for row, difference in enumerate((found - truth, nearest - truth, truth)):
            means[row, few] = np.mean(difference**2, axis=1)
    lit = length > 0
    relative = means[:, lit] / length[lit] ** 2
    rmse, projection, level = np.sqrt(relative.mean(axis=1))
    return Errors(float(rmse), float(projection), float(level), float(np.sqrt(relative[0].max())))


def norms(direct: Float[Array, "c m 3"]) -> Float64[Array, "c 3"]:
    """Of direct vectors, colour by colour."""
    return np.linalg.norm(direct.astype(np.float64), axis=1)


def learned_from(lightmaps: Float[Array, "c t 3"], direct: Float[Array, "c m 3"]) -> Float64[Array, "c 3"]:
    """`norms`, and 0 where learning leaves a colour out: what its own lights are divided by."""
    sizes = norms(direct)
    return np.where(seen(sizes, np.linalg.norm(lightmaps.astype(np.float64), axis=1)), sizes, 0)
