"""A trained net evaluated in torch, in float32: the fast twin of `netspec.evaluate_unit` for nets of any size."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor
from torch.nn import functional

from prtnet import sh
from prtnet.models import harmonics
from prtnet.models.encoding import bilinear, encode, hashed, trilinear
from prtnet.netspec import NetSpec, check_uv

Array = np.ndarray

POINTS = 1 << 11  # at a time: a layer of 512 neurons is then 4 MB, which caches hold


class Inference:
    """The layers and grids of a net as tensors on a device, ready to be evaluated often, by one thread."""

    def __init__(self, net: NetSpec, device: str = "cpu"):
        def tensor(values: Array) -> Tensor:
            return torch.tensor(np.asarray(values, np.float32), device=device)

        self.net, self._device = net, device
        self._layers = [(tensor(w), tensor(b)) for w, b in zip(net.weights, net.biases, strict=True)]
        self._grids = [tensor(grid) for grid in net.grids]
        self._hashes = [(tensor(each.table), each.cells) for each in net.hashes]
        self._texels = [tensor(image) for image in net.texels]
        self._bend = activation(net.activation, net.negative_slope)

    def __call__(
        self, positions: Float[Array, "n 3"], normals: Float[Array, "n 3"], uv: Float[Array, "n 2"] | None = None
    ) -> Float32[Array, "n c"]:
        """Transfer at centred positions in [-1, 1]^3 with unit normals, to about 1e-6 of its scale.

        Raises PrtnetError where the net has texels and `uv`, the places in the atlas, is not given.
        """
        check_uv(self.net, uv)
        out = np.empty((len(positions), self.net.groups * sh.count(self.net.bands)), np.float32)
        given = [values for values in (positions, normals, uv if self._texels else None) if values is not None]
        with torch.no_grad(), one_thread():
            for start in range(0, len(positions), POINTS):
                part = slice(start, start + POINTS)
                points = [torch.tensor(np.asarray(each[part], np.float32), device=self._device) for each in given]
                out[part] = self.transfer(*points).cpu()
        return out

    def transfer(
        self, positions: Float[Tensor, "n 3"], normals: Float[Tensor, "n 3"], uv: Float[Tensor, "n 2"] | None = None
    ) -> Float[Tensor, "n c"]:
        """The same of tensors on the device, all at once."""
        net = self.net
        parts = [encode(positions, net.position_frequencies, net.encoding)]
        parts += [encode(normals, net.normal_frequencies, net.encoding)]
        parts += [trilinear(grid, positions) for grid in self._grids]
        parts += [hashed(table, cells, positions) for table, cells in self._hashes]
        parts += [] if uv is None else [bilinear(image, uv) for image in self._texels]
        h = torch.cat(parts, 1)
        for weight, bias in self._layers[:-1]:
            h = self._bend(functional.linear(h, weight, bias))
        h = functional.linear(h, *self._layers[-1])
        h = net.output_scale * (torch.tanh(h) if net.output == "tanh" else h)
        return h + harmonics.cosine_lobe(normals, net.bands).repeat(1, net.groups) if net.residual else h


@contextmanager
def one_thread() -> Iterator[None]:
    """One torch thread: more only wait for each other, on layers this small and on a busy machine."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def activation(name: str, negative_slope: float) -> Callable[[Tensor], Tensor]:
    """The activation that `netspec.activation` has under that name, as a function of a tensor."""
    if name == "leaky_relu":
        return lambda x: functional.leaky_relu(x, negative_slope)
    if name == "hard_gelu":
        return lambda x: x * (0.5 + 0.5 * x).clamp(0, 1)
    if name == "gelu":
        return lambda x: functional.gelu(x, approximate="tanh")
    return {"relu": functional.relu, "silu": functional.silu, "sine": torch.sin}[name]
