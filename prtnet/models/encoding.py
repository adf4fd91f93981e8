"""Frequency encoding of positions and normals, the torch twin of `prtnet.netspec.encode`.

gamma(x) = (x, sin 2 pi f_0, cos 2 pi f_0, sin 2 pi f_1, ...), f_j = fract(2^j x / 2), after Mildenhall et al. 2020
(NeRF), eq. 4, with the argument in turns so that float32 stays exact at any frequency.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor


def encode(x: Float[Tensor, "n 3"], frequencies: int) -> Float[Tensor, "n e"]:
    """3 + 6 * frequencies numbers a point, ordered as in the net file."""
    octaves = torch.exp2(torch.arange(frequencies, dtype=x.dtype, device=x.device) - 1).repeat_interleave(6)
    # a cosine is a sine a quarter turn on: one call for both, after the whole turns are gone
    quarter = torch.tensor([0.0, 0.0, 0.0, 0.25, 0.25, 0.25], dtype=x.dtype, device=x.device).repeat(frequencies)
    turns = x.repeat(1, 2 * frequencies) * octaves
    return torch.cat([x, torch.sin((turns - turns.round() + quarter) * (2 * math.pi))], dim=1)
