"""How a transfer texture keeps its coefficients: as float32, as float16, or in 8 bits.

A byte b of coefficient i stands for t_i = low_i + b / 255 (high_i - low_i), with low_i and high_i the least and the
greatest value of the texels in use. That is linear, so decoding what a filter made of bytes is filtering what the bytes
stand for. The error of a texel is at most (high_i - low_i) / 510.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Num

from prtnet import PrtnetError

Array = np.ndarray

# atlas.format, with the bytes of a coefficient
FORMATS = {"float32": 4, "float16": 2, "uint8": 1}
STEPS = 255


@dataclass(frozen=True, eq=False)
class Stored:
    """The levels of a texture as kept; a coefficient is offset + scale * texel, where bytes count from 0 to 1."""

    levels: tuple[Num[Array, "_ _ k"], ...]
    scale: Float32[Array, " k"]
    offset: Float32[Array, " k"]


def check(name: str) -> None:
    """Raises PrtnetError, naming the configuration's key, for a format that there is not."""
    if name not in FORMATS:
        raise PrtnetError(f"atlas.format: found {name!r}, expected one of {', '.join(FORMATS)}")


def encode(levels: Sequence[Float[Array, "_ _ k"]], used: Bool[Array, "h w"], name: str) -> Stored:
    """Levels of transfer in the format `name`; `used` are the texels of the first level that set the range of bytes.

    Texels that are not used may lie outside of it and are clipped. Inverse: `decode`, up to the format's error.
    """
    check(name)
    count = levels[0].shape[2]
    if name != "uint8":
        kind = np.float16 if name == "float16" else np.float32
        kept = tuple(np.asarray(level, kind) for level in levels)
        return Stored(kept, np.ones(count, np.float32), np.zeros(count, np.float32))
    values = levels[0][used]
    low, high = (np.asarray(bound, np.float32) for bound in (values.min(axis=0), values.max(axis=0)))
    # a coefficient that is the same everywhere is its offset
    span = np.where(high > low, high - low, np.float32(1))
    kept = tuple(np.rint(np.clip((level - low) / span, 0, 1) * np.float32(STEPS)).astype(np.uint8) for level in levels)
    return Stored(kept, np.where(high > low, span, np.float32(0)), low)


def decode(stored: Stored) -> tuple[Float32[Array, "_ _ k"], ...]:
    """The levels of transfer as a shader reads them. Inverse: `encode`."""
    if stored.levels[0].dtype != np.uint8:
        return tuple(level.astype(np.float32) for level in stored.levels)
    return tuple(stored.offset + stored.scale * (level / np.float32(STEPS)) for level in stored.levels)
