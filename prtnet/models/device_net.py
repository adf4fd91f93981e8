"""A NetSpec in torch on a GPU's memory: the network of `prtnet.render.interop` without its fused kernel."""

from collections.abc import Callable
from math import pi, sqrt
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from prtnet import sh
from prtnet.models.encoding import encode, hashed, trilinear
from prtnet.netspec import NetSpec


class DeviceNet:
    """Called with packed points it writes their transfer, in place. `as_tensor` makes a tensor of the memory of an
    array, which by default has `__cuda_array_interface__`."""

    def __init__(self, net: NetSpec, device: str = "cuda", as_tensor: Callable[[Any], Tensor] | None = None):
        self.net, self._as_tensor = net, as_tensor or (lambda array: torch.as_tensor(array, device=device))
        self._layers = [
            (torch.from_numpy(weight).to(device), torch.from_numpy(bias).to(device))
            for weight, bias in zip(net.weights, net.biases, strict=True)
        ]
        self._grids = [torch.from_numpy(grid).to(device).float() for grid in net.grids]
        self._hashes = [(torch.from_numpy(each.table).to(device).float(), each.cells) for each in net.hashes]

    @torch.no_grad()
    def __call__(self, positions: Any, normals: Any, transfer: Any, count: int) -> None:
        """The first `count` rows of `transfer` from those of positions and unit normals."""
        places, directions, out = (self._as_tensor(array)[:count] for array in (positions, normals, transfer))
        out.copy_(self.transfer(places, directions))

    def transfer(self, positions: Float[Tensor, "n 3"], normals: Float[Tensor, "n 3"]) -> Float[Tensor, "n c"]:
        """As `netspec.evaluate_unit`, in float32."""
        net = self.net
        position = encode(positions, net.position_frequencies, net.encoding)
        normal = encode(normals, net.normal_frequencies, net.encoding)
        features = [trilinear(grid, positions) for grid in self._grids]
        features += [hashed(table, cells, positions) for table, cells in self._hashes]
        h = torch.cat([position, normal, *features], 1)
        for weight, bias in self._layers[:-1]:
            h = self._bend(functional.linear(h, weight, bias))
        h = functional.linear(h, *self._layers[-1])
        h = net.output_scale * (torch.tanh(h) if net.output == "tanh" else h)
        return h + self._lobe(normals).repeat(1, net.groups) if net.residual else h

    def _bend(self, x: Tensor) -> Tensor:
        bends = {
            "leaky_relu": lambda: functional.leaky_relu(x, self.net.negative_slope),
            "relu": lambda: functional.relu(x),
            "hard_gelu": lambda: x * (0.5 + 0.5 * x).clamp(0, 1),
            "silu": lambda: functional.silu(x),
            "gelu": lambda: functional.gelu(x, approximate="tanh"),
            "sine": lambda: torch.sin(x),
        }
        return bends[self.net.activation]()

    def _lobe(self, normals: Float[Tensor, "n 3"]) -> Float[Tensor, "n k"]:
        zonal = sh.cosine_zonal(self.net.bands)[sh.band_index(self.net.bands)]
        return harmonics(normals, self.net.bands) * torch.from_numpy(zonal).to(normals)


def harmonics(directions: Float[Tensor, "n 3"], bands: int) -> Float[Tensor, "n k"]:
    """Real SH of unit directions: the torch twin of `sh.evaluate`, by the same recurrences."""
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
