"""Mip levels of transfer textures, in which charts never mix with the empty texels between them.

A texel of a level is the mean of its children that have a value (Williams 1983, *Pyramidal Parametrics*, with the empty
ones left out); then every level is dilated by itself. Sides are halved and rounded down, as OpenGL has them. Where a
side is odd, the three children of a texel are weighted by what of them it covers.

A coarse texel may still hold texels of two charts, and look-ups in either would read the other: a seam. Level n needs
2^n texels around each chart, so there are no levels beyond what the charts' padding allows.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Float32

from prtnet.data.bilinear import bilinear

Array = np.ndarray


def level_count(padding: int) -> int:
    """How many levels, the first included, `padding` texels around each chart keep charts apart on."""
    return padding.bit_length()


def sides(size: int, levels: int) -> list[int]:
    """Of the levels of a square texture, at most down to 1."""
    return [size >> level for level in range(min(levels, size.bit_length()))]


def pyramid(
    image: Float[Array, "s s k"], valid: Bool[Array, "s s"], levels: int
) -> list[tuple[Float32[Array, "_ _ k"], Bool[Array, "_ _"]]]:
    """So many levels of a texture, or down to 1, with which of their texels have a value; the others are 0."""
    found = [(np.where(valid[..., None], image, 0).astype(np.float32), valid)]
    for _ in sides(len(valid), levels)[1:]:
        found.append(_halved(*found[-1]))
    return found


def _halved(
    image: Float32[Array, "s s k"], valid: Bool[Array, "s s"]
) -> tuple[Float32[Array, "h h k"], Bool[Array, "h h"]]:
    weights = _along(_along(valid.astype(np.float64), 0), 1)
    sums = _along(_along(image.astype(np.float64), 0), 1)
    # a weight is at least 1 / s^2 where any child is valid
    some = weights > 0
    return np.divide(sums, weights[..., None], where=some[..., None], out=np.zeros(sums.shape)).astype(np.float32), some


def _along(values: Float[Array, "*s"], axis: int) -> Float[Array, "*h"]:
    """Means of neighbours along an axis, half as many rounded down."""
    values = np.moveaxis(values, axis, 0)
    side = len(values) // 2
    if len(values) % 2 == 0:
        out = (values[0::2] + values[1::2]) / 2
    else:
        place = np.arange(side).reshape(-1, *(1,) * (values.ndim - 1))
        first, second, third = values[0:-1:2], values[1::2], values[2::2]
        out = ((side - place) * first + side * second + (place + 1) * third) / len(values)
    return np.moveaxis(out, 0, axis)


def trilinear(
    levels: Sequence[Float[Array, "_ _ k"]], uv: Float[Array, "n 2"], level: Float[Array, " n"]
) -> Float[Array, "n k"]:
    """Look-ups at uv (v up) and levels of detail: the plain twin of the hardware's, float64, clamped at the border."""
    level = np.clip(level, 0, len(levels) - 1)
    low = np.floor(level).astype(np.int64)
    share = (level - low)[:, None]
    found = np.zeros((len(uv), levels[0].shape[2]))
    for number, image in enumerate(levels):
        for weight in ((low == number)[:, None] * (1 - share), (low + 1 == number)[:, None] * share):
            some = weight[:, 0] > 0
            found[some] += weight[some] * bilinear(image, uv[some], repeat=False)
    return found
