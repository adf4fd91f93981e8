"""Transfer matrices: M_ij(p) = integral of V(p, w) max(0, n.w) Y_i(w) Y_j(w) dw, light to radiance at each vertex.

Sloan, Kautz and Snyder 2002, section 5. The cosine is in it, as in the transfer vector. H_i = sum_j M_ij L_j is the
light that arrives, in the bands of M, and nothing of V itself is cut: Y_i Y_j has 2b - 1 bands, so

    M_ij = sum_k tau_ijk t_k                    exactly, where t has 2b - 1 bands

and one bake of a longer transfer vector gives the matrix. What the triple product of a vector of b bands loses against
it is what V max(0, n.w) has from band b on. A matrix has b^4 values: 625 at 5 bands, for small meshes only.
"""

from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64

from prtnet import PrtnetError, sh
from prtnet.data import transfer
from prtnet.data.tracer import Tracer

Array = np.ndarray

# bytes of matrices that are made without being asked for more: 430 thousand vertices of 5 bands
MEMORY = 1 << 30
# matrices that are held in float64 at a time
STEP = 1 << 10


def bake(
    tracer: Tracer,
    positions: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    *,
    bands: int = 5,
    memory: int = MEMORY,
    **options: Any,
) -> Float32[Array, "n k k"]:
    """Matrices of points on the scene's surface, on world axes; `options` are those of `transfer.bake`.

    Raises PrtnetError, before any ray, where they would take more than `memory` bytes.
    """
    check(len(positions), bands, memory)
    return from_transfer(transfer.bake(tracer, positions, normals, bands=2 * bands - 1, **options), bands)


def check(points: int, bands: int, memory: int = MEMORY) -> None:
    """Raises PrtnetError where matrices of so many points would take more than `memory` bytes."""
    size = 4 * sh.count(bands) ** 2
    if points * size > memory:
        raise PrtnetError(
            f"transfer matrix: found {points} points of {bands} bands, {points * size / 1e6:.0f} MB, expected at most "
            f"{memory // size} of them ({memory / 1e6:.0f} MB); take a coarser mesh, fewer bands or more memory"
        )


def from_transfer(values: Float[Array, "n kt"], bands: int) -> Float32[Array, "n k k"]:
    """Matrices of `bands` out of transfer of at least 2 bands - 1 bands. Raises PrtnetError where that is shorter."""
    found, wanted = sh.bands_of(values.shape[1]), 2 * bands - 1
    if found < wanted:
        raise PrtnetError(f"transfer matrix: found {found} bands of transfer, expected {wanted} for {bands} of matrix")
    tau = sh.triple_product(wanted, bands, bands)
    out = np.empty((len(values), *tau.shape[1:]), np.float32)
    for first in range(0, len(values), STEP):
        part = slice(first, first + STEP)
        out[part] = np.tensordot(np.asarray(values[part, : len(tau)], np.float64), tau, axes=1)
    return out


def transferred(matrices: Float[Array, "n k k"], light: Float[Array, "k c"]) -> Float64[Array, "n k c"]:
    """H = M L: the radiance that arrives at each point, cosine included, per coefficient and colour, in float64."""
    return np.einsum("nij,jc->nic", matrices, np.asarray(light, np.float64), optimize=True)
