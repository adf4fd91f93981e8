"""Spherical harmonics in torch: the twins of `prtnet.sh`, by the same recurrences."""

from math import pi, sqrt

import torch
from jaxtyping import Float
from torch import Tensor

from prtnet import sh


def evaluate(directions: Float[Tensor, "n 3"], bands: int) -> Float[Tensor, "n k"]:
    """As `sh.evaluate`, in the type of the unit directions."""
    x, y, z = directions.unbind(1)
    columns = [x] * sh.count(bands)
    cosine, sine, diagonal = torch.ones_like(x), torch.zeros_like(x), sqrt(1 / (4 * pi))
    for m in range(bands):
        if m > 0:
            cosine, sine = x * cosine - y * sine, x * sine + y * cosine
            diagonal *= sqrt((2 * m + 1) / (2 * m))
        before, legendre = torch.zeros_like(z), torch.full_like(z, diagonal * (sqrt(2) if m else 1))
        for l in range(m, bands):
            if l > m:
                ahead = sqrt((4 * l * l - 1) / (l * l - m * m))
                behind = sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1))
                before, legendre = legendre, ahead * (z * legendre - behind * before)
            columns[l * l + l - m] = legendre * sine
            columns[l * l + l + m] = legendre * cosine
    return torch.stack(columns, 1)


def cosine_lobe(normals: Float[Tensor, "n 3"], bands: int) -> Float[Tensor, "n k"]:
    """As `sh.cosine_lobe`, in the type of the unit normals."""
    zonal = sh.cosine_zonal(bands)[sh.band_index(bands)]
    return evaluate(normals, bands) * torch.from_numpy(zonal).to(normals)
