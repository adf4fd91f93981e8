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
    octaves = torch.exp2(torch.arange(frequencies, dtype=x.dtype, device=x.device) - 1)
    turns = x[:, None, :] * octaves[:, None]
    angle = (turns - turns.round()) * (2 * math.pi)
    waves = torch.stack([torch.sin(angle), torch.cos(angle)], dim=2)
    return torch.cat([x, waves.flatten(1)], dim=1)
