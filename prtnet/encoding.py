"""What enters a net at a point, in plain NumPy: the twins that torch and GLSL are tested against.

encode     waves over octaves of a position or a normal
trilinear  a dense grid of features over [-1, 1]^3
bilinear   an image of features over the texture coordinates of an atlas
hashed     a grid too fine to be kept whole: its corners share the entries of a table by a hash of their place (Müller
           et al. 2022, *Instant Neural Graphics Primitives*, section 3). Surfaces touch few cells of a fine grid.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from prtnet import PrtnetError

Array = np.ndarray

ENCODINGS = ("identity", "frequency", "triangle")
PRIMES = (1, 2654435761, 805459861)  # of the hash: Müller et al. 2022, equation 4


class HashGrid(NamedTuple):
    """A grid of `cells` along each axis of [-1, 1]^3, whose corners look their features up in a table."""

    cells: int
    table: Float[Array, "entries channels"]  # float32 or float16; a power of two entries


def encoded_size(position_frequencies: int, normal_frequencies: int, encoding: str = "frequency") -> int:
    """Numbers that enter the first layer."""
    if position_frequencies < 0 or normal_frequencies < 0:
        raise PrtnetError(f"net frequencies: found {position_frequencies}, {normal_frequencies}, expected 0 or more")
    return 6 + 6 * (position_frequencies + normal_frequencies) * (encoding != "identity")


def encode(x: Float[Array, "n 3"], frequencies: int, encoding: str = "frequency") -> Float[Array, "n e"]:
    """gamma(x) = (x, s(f_0), c(f_0), s(f_1), ...) with f_j = fract(2^j x / 2), in float64.

    `frequency`: s and c are sin 2 pi f and cos 2 pi f. `triangle`: the triangle waves with their zeros, peaks and
    troughs. `identity`: x alone. In turns the argument of a wave is exact for a float32 x, however high the frequency.
    """
    exact = np.asarray(x, np.float64)
    parts = [exact]
    for j in range(frequencies if encoding != "identity" else 0):
        turns = exact * 2.0 ** (j - 1)
        turns -= np.floor(turns)
        if encoding == "triangle":
            parts += [4 * np.abs(np.abs(turns - 0.25) - 0.5) - 1, 4 * np.abs(turns - 0.5) - 1]
        else:
            parts += [np.sin(2 * math.pi * turns), np.cos(2 * math.pi * turns)]
    return np.concatenate(parts, axis=1)


def trilinear(grid: Float[Array, "z y x c"], positions: Float[Array, "n 3"]) -> Float[Array, "n c"]:
    """Channels of a grid at positions in [-1, 1]^3, in float64. Values stand at the middle of cells, as in a texture;
    beyond the outermost ones they stay as they are.
    """
    sizes = np.array(grid.shape[2::-1])
    place = np.clip((np.asarray(positions, np.float64) + 1) / 2 * sizes - 0.5, 0, sizes - 1)
    low = place.astype(int)
    high, share = np.minimum(low + 1, sizes - 1), place - low
    total = np.zeros((len(positions), grid.shape[3]))
    for corner in np.ndindex(2, 2, 2):
        x, y, z = np.where(corner, high, low).T
        weight = np.where(corner, share, 1 - share).prod(axis=1)
        total += weight[:, None] * grid[z, y, x].astype(np.float64)
    return total


def bilinear(texels: Float[Array, "y x c"], uv: Float[Array, "n 2"]) -> Float[Array, "n c"]:
    """Channels of an image at coordinates in [0, 1]^2, in float64: row 0 is the top, v = 1. As `trilinear` at its
    border."""
    u, v = np.asarray(uv, np.float64).T
    return trilinear(texels[None], np.stack([2 * u - 1, 1 - 2 * v, np.zeros_like(u)], axis=1))


def hashed(grid: HashGrid, positions: Float[Array, "n 3"]) -> Float[Array, "n c"]:
    """Channels of a hashed grid at positions in [-1, 1]^3, trilinear between the corners of a cell, in float64."""
    place = np.asarray(positions, np.float64) * grid.cells / 2
    low = np.floor(place)
    share, corner = place - low, low.astype(np.int32)
    total = np.zeros((len(positions), grid.table.shape[1]))
    for step in np.ndindex(2, 2, 2):
        weight = np.where(step, share, 1 - share).prod(axis=1)
        total += weight[:, None] * grid.table[slot(corner + np.array(step, np.int32), len(grid.table))].astype(
            np.float64
        )
    return total


def slot(corner: Int[Array, "n 3"], entries: int) -> Int[Array, " n"]:
    """The entry of a corner, counted in cells from the middle of the cube: (x ^ y p_2 ^ z p_3) mod `entries`, in 32
    bits without a sign."""
    x, y, z = (corner.astype(np.int32).view(np.uint32) * np.array(PRIMES, np.uint32)).T
    return ((x ^ y ^ z) & np.uint32(entries - 1)).astype(np.int64)
