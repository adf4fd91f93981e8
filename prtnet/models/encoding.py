"""Encodings of positions and normals, the torch twins of `prtnet.encoding`.

gamma(x) = (x, s(f_0), c(f_0), s(f_1), ...), f_j = fract(2^j x / 2): waves over octaves, with the argument in turns so
that float32 stays exact at any frequency.

frequency  s = sin 2 pi f, c = cos 2 pi f: Mildenhall et al. 2020 (NeRF), eq. 4.
triangle   the triangle waves with their zeros, peaks and troughs, no more than absolute values: after Müller et al.
           2021, *Real-time Neural Radiance Caching for Path Tracing*, section 4, which has one wave an octave.
identity   x alone.
"""

import math
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from prtnet.encoding import PRIMES
from prtnet.models import kernels


def encode(x: Float[Tensor, "n 3"], frequencies: int, encoding: str = "frequency") -> Float[Tensor, "n e"]:
    """3 numbers a point, and 6 for each frequency but with `identity`, ordered as in the net file."""
    if encoding == "identity":
        return x
    octaves = torch.exp2(torch.arange(frequencies, dtype=x.dtype, device=x.device) - 1).repeat_interleave(6)
    # a cosine is a sine a quarter turn on: one call for both, after the whole turns are gone
    quarter = torch.tensor([0.0, 0.0, 0.0, 0.25, 0.25, 0.25], dtype=x.dtype, device=x.device).repeat(frequencies)
    turns = x.repeat(1, 2 * frequencies) * octaves
    turns = turns - turns.round()
    if encoding == "triangle":
        from_peak = turns + (quarter - 0.25)
        return torch.cat([x, 1 - 4 * (from_peak - from_peak.round()).abs()], dim=1)
    return torch.cat([x, torch.sin((turns + quarter) * (2 * math.pi))], dim=1)


def trilinear(grid: Float[Tensor, "z y x c"], positions: Float[Tensor, "n 3"]) -> Float[Tensor, "n c"]:
    """Channels of a dense grid over [-1, 1]^3, with values at the middle of cells as in a texture.

    On CUDA the gradient of `grid` is summed in no fixed order, and differs from run to run in its last digits.
    """
    if grid.device.type == "cpu":
        found = _Trilinear.apply(grid, positions)
        assert isinstance(found, Tensor)
        return found
    volume, places = grid.permute(3, 0, 1, 2)[None], positions[None, :, None, None]
    with torch.autocast(grid.device.type, enabled=False):
        found = functional.grid_sample(volume, places, padding_mode="border", align_corners=False)
    return found[0, :, :, 0, 0].T


def bilinear(texels: Float[Tensor, "y x c"], uv: Float[Tensor, "n 2"]) -> Float[Tensor, "n c"]:
    """Channels of an image at coordinates in [0, 1]^2, row 0 at v = 1: a grid of one slice. As `trilinear` on CUDA."""
    u, v = uv.unbind(1)
    return trilinear(texels[None], torch.stack([2 * u - 1, 1 - 2 * v, torch.zeros_like(u)], 1))


def hashed(table: Float[Tensor, "entries c"], cells: int, positions: Float[Tensor, "n 3"]) -> Float[Tensor, "n c"]:
    """Channels of a hashed grid of `cells` along each axis of [-1, 1]^3; as `trilinear` on CUDA."""
    if table.device.type == "cpu":
        found = _Hashed.apply(table, cells, positions)
        assert isinstance(found, Tensor)
        return found
    place = positions * (cells / 2)
    low = place.floor()
    steps = torch.tensor(list(np.ndindex(2, 2, 2)), device=table.device)
    share = (place - low)[:, None]
    weights = torch.where(steps.bool(), share, 1 - share).prod(2)
    # 64-bit products have the low 32 bits of the unsigned ones, and only the lowest bits are looked at
    x, y, z = ((low.long()[:, None] + steps) * torch.tensor(PRIMES, device=table.device)).unbind(2)
    entry = (x ^ y ^ z) & (len(table) - 1)
    return (table[entry] * weights[:, :, None]).sum(1)


class _Trilinear(torch.autograd.Function):
    """Channels of a float32 grid (z, y, x, c) at positions in [-1, 1]^3, "n 3"; differentiable in the grid alone."""

    @staticmethod
    def forward(ctx: Any, grid: Float[Tensor, "z y x c"], positions: Float[Tensor, "n 3"]) -> Float[Tensor, "n c"]:
        places = positions.detach().float().contiguous()
        found = torch.empty(len(places), grid.shape[3])
        kernels.gather(grid.detach().contiguous().numpy(), places.numpy(), found.numpy())
        ctx.save_for_backward(places)
        ctx.shape = grid.shape
        return found

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        (places,) = ctx.saved_tensors
        total = torch.zeros(ctx.shape)
        kernels.scatter(gradients[0].float().contiguous().numpy(), places.numpy(), total.numpy())
        return total, None


class _Hashed(torch.autograd.Function):
    """`hashed` of a float32 table; differentiable in the table alone."""

    @staticmethod
    def forward(
        ctx: Any, table: Float[Tensor, "entries c"], cells: int, positions: Float[Tensor, "n 3"]
    ) -> Float[Tensor, "n c"]:
        places = positions.detach().float().contiguous()
        found = torch.empty(len(places), table.shape[1])
        kernels.gather_hashed(table.detach().contiguous().numpy(), cells, places.numpy(), found.numpy())
        ctx.save_for_backward(places)
        ctx.shape, ctx.cells = table.shape, cells
        return found

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        (places,) = ctx.saved_tensors
        total = torch.zeros(ctx.shape)
        kernels.scatter_hashed(gradients[0].float().contiguous().numpy(), ctx.cells, places.numpy(), total.numpy())
        return total, None, None
