"""The network in torch: the encoded position and normal through `depth` hidden layers of `width` to t / pi.

Learnt Transfer (Sirikonda, Aakash KT and Narayanan 2022, *PRT with Neural Networks*) is this with leaky-ReLU, tanh
and no residual. With the residual the layers learn only what occlusion takes away from the cosine lobe.
"""

import math

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from prtnet import sh
from prtnet.encoding import HashGrid
from prtnet.models.encoding import bilinear, encode, hashed, trilinear
from prtnet.models.recipe import ModelOptions, TrainOptions, layer_sizes
from prtnet.netspec import NetSpec

SCALE = math.pi  # the network predicts t / SCALE, which lies within tanh's reach


class Mlp(nn.Module):
    """Predicts t / pi, without the residual's analytic lobe, which callers take off the targets (`unlearned`)."""

    def __init__(
        self, model: ModelOptions, head: TrainOptions, bands: int, generator: torch.Generator, groups: int = 1
    ) -> None:
        super().__init__()
        self.head, self.bands, self.groups = head, bands, groups
        sizes = layer_sizes(model, head, groups * sh.count(bands))
        pairs = list(zip(sizes[1:], sizes, strict=False))
        bounds = _sine_bounds(sizes, head.sine_omega) if head.activation == "sine" else [None] * len(pairs)
        self.weights = nn.ParameterList(
            _uniform((rows, columns), columns, generator, bound)
            for (rows, columns), bound in zip(pairs, bounds, strict=True)
        )
        self.biases = nn.ParameterList(_uniform((rows,), columns, generator) for rows, columns in pairs)
        # all but 0 at first, as in Müller et al. 2022, *Instant Neural Graphics Primitives*
        self.grids = nn.ParameterList(
            _uniform((z, y, x, head.grid_channels), 1, generator, 1e-4) for x, y, z in head.grid_cells
        )
        self.tables = nn.ParameterList(
            _uniform((head.hash_entries, head.hash_channels), 1, generator, 1e-4) for _ in head.hash_cells
        )
        size = head.texel_size
        self.texels = nn.ParameterList(
            [_uniform((size, size, head.texel_channels), 1, generator, 1e-4)] if size else []
        )

    def forward(
        self, positions: Float[Tensor, "n 3"], normals: Float[Tensor, "n 3"], uv: Float[Tensor, "n 2"] | None = None
    ) -> Float[Tensor, "n c"]:
        head = self.head
        position = encode(positions, head.position_frequencies, head.encoding)
        normal = encode(normals, head.normal_frequencies, head.encoding)
        features = [trilinear(grid, positions) for grid in self.grids]
        features += [hashed(*pair, positions) for pair in zip(self.tables, head.hash_cells, strict=True)]
        features += [] if uv is None else [bilinear(texels, uv) for texels in self.texels]
        h = torch.cat([position, normal, *features], 1)
        weights, biases = self._carried()
        for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
            h = self._bend(functional.linear(h, weight, bias))
        h = functional.linear(h, weights[-1], biases[-1])
        return torch.tanh(h) if head.output == "tanh" else h

    def _carried(self) -> tuple[list[Tensor], list[Tensor]]:
        """The weights as `forward` uses them.

        hard_gelu(x) is hardswish(3 x) / 3. Hidden values are carried 3 times too large, so that each activation is one
        call of torch's kernel; scaling the first and last matrix and the biases costs nothing beside it.
        """
        weights, biases = list(self.weights), list(self.biases)
        if self.head.activation == "hard_gelu" and len(weights) > 1:
            weights[0], weights[-1] = weights[0] * 3, weights[-1] / 3
            biases = [bias * 3 for bias in biases[:-1]] + biases[-1:]
        return weights, biases

    def _bend(self, x: Tensor) -> Tensor:
        if self.head.activation == "leaky_relu":
            return functional.leaky_relu(x, self.head.negative_slope)
        if self.head.activation == "hard_gelu":
            return functional.hardswish(x)
        if self.head.activation == "silu":
            return functional.silu(x)
        if self.head.activation == "relu":
            return functional.relu(x)
        if self.head.activation == "sine":
            return torch.sin(self.head.sine_omega * x)
        return functional.gelu(x, approximate="tanh")

    def unlearned(self, normals: Float[Tensor, "n 3"]) -> Float[Tensor, "n c"]:
        """The part of t / pi that is not learned: the unoccluded lobe of a residual head, else 0."""
        if not self.head.residual:
            outputs = self.groups * sh.count(self.bands)
            return torch.zeros(len(normals), outputs, dtype=normals.dtype, device=normals.device)
        lobe = sh.cosine_lobe(normals.cpu().numpy(), self.bands) / SCALE
        return torch.from_numpy(np.tile(lobe, self.groups)).to(normals)

    def spec(
        self,
        parameters: list[Tensor] | None = None,
        *,
        centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
        scale: float = 1.0,
        name: str = "net",
    ) -> NetSpec:
        """The net to hand over; `centre` and `scale` take file coordinates to the unit positions it was trained on.

        `parameters`, in the module's order, stand in for the module's own.
        """
        head, hidden = self.head, len(self.weights) - 1
        arrays = [p.detach().cpu().float().numpy().copy() for p in parameters or self.parameters()]
        layers, features = arrays[: 2 * hidden + 2], arrays[2 * hidden + 2 :]
        features = [each.astype(head.grid_format) for each in features]
        ends = len(self.grids), len(self.grids) + len(self.tables)
        grids, tables, texels = features[: ends[0]], features[ends[0] : ends[1]], features[ends[1] :]
        if head.activation == "sine":
            # sin(omega (W h + b)) is sin(W h + b) of larger weights: the file needs no omega
            for index in (*range(hidden), *range(hidden + 1, 2 * hidden + 1)):
                layers[index] *= np.float32(head.sine_omega)
        return NetSpec(
            weights=tuple(layers[: hidden + 1]),
            biases=tuple(layers[hidden + 1 :]),
            position_frequencies=head.position_frequencies,
            normal_frequencies=head.normal_frequencies,
            activation=head.activation,
            negative_slope=head.negative_slope,
            output=head.output,
            output_scale=SCALE,
            residual=head.residual,
            bands=self.bands,
            groups=self.groups,
            centre=centre,
            scale=scale,
            name=name,
            encoding=head.encoding,
            grids=tuple(grids),
            hashes=tuple(map(HashGrid, head.hash_cells, tables)),
            texels=tuple(texels),
        )


def _sine_bounds(sizes: list[int], omega: float) -> list[float]:
    """Of the initial weights: sines keep their spread through layers (Sitzmann et al. 2020, SIREN, section 3.2)."""
    return [1 / sizes[0], *[math.sqrt(6 / columns) / omega for columns in sizes[1:-1]]]


def _uniform(
    shape: tuple[int, ...], fan_in: int, generator: torch.Generator, bound: float | None = None
) -> nn.Parameter:
    """Uniform in [-bound, bound], from a passed generator; without a bound torch.nn.Linear's own initial values."""
    bound = 1 / math.sqrt(fan_in) if bound is None else bound
    return nn.Parameter((torch.rand(shape, generator=generator) * 2 - 1) * bound)
