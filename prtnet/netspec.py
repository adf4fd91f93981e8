"""The hand-over format of a trained net, and the plain evaluator that every fast path is tested against.

A net maps a surface point and its normal to the SH coefficients of its transfer:

    x = (gamma(p), gamma(n), g(p))      p in [-1, 1]^3, the centred position; `prtnet.encoding` has gamma, and g, grids
    h = activation(W_i h + b_i)         for each hidden layer, from h = x
    t = output_scale * output(W h + b)  + cosine_lobe(n) where `residual`

A net with `texels`, features in an image over the atlas of its surface, is a function of the texture coordinate as
well, and x ends in what stands there.

With 4 `groups` it maps to as many transfers, one after the other: direct, and with light from other surfaces in red,
green and blue; each has its own residual.

The file (docs/net-format.md) is safetensors with one JSON descriptor in its metadata.
"""

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as to_bytes

from prtnet import PrtnetError, sh, store
from prtnet.encoding import ENCODINGS, HashGrid, bilinear, encode, encoded_size, hashed, trilinear

Array = np.ndarray

FORMAT = 1
METADATA_KEY = "prtnet_net"
ACTIVATIONS = ("leaky_relu", "gelu", "silu", "hard_gelu", "relu", "sine")
OUTPUTS = ("tanh", "linear")
_CHUNK = 1 << 15
# fields that files leave out at their default, as they did before there were these fields
_LATER = ("encoding", "grids", "hashes", "texels")


@dataclass(frozen=True)
class NetSpec:
    """Weights are float32, (outputs, inputs) per layer. `centre` and `scale` take file coordinates to [-1, 1]^3."""

    weights: tuple[Float[Array, "_ _"], ...]
    biases: tuple[Float[Array, " _"], ...]
    position_frequencies: int
    normal_frequencies: int
    activation: str = "leaky_relu"
    negative_slope: float = 0.01  # of leaky_relu
    output: str = "tanh"
    output_scale: float = math.pi
    residual: bool = False
    bands: int = 5
    groups: int = 1  # of coefficients
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)  # float64, in the file's units
    scale: float = 1.0
    name: str = "net"
    encoding: str = "frequency"
    grids: tuple[Float[Array, "_ _ _ _"], ...] = ()  # features (z, y, x, channels) over [-1, 1]^3, float32 or float16
    hashes: tuple[HashGrid, ...] = ()  # finer ones, whose inputs come after those of `grids`
    texels: tuple[Float[Array, "_ _ _"], ...] = ()  # features (y, x, channels) over the atlas, row 0 at v = 1; the last

    def __post_init__(self) -> None:
        _one_of("activation", self.activation, ACTIVATIONS)
        _one_of("output", self.output, OUTPUTS)
        _one_of("encoding", self.encoding, ENCODINGS)
        if not (self.scale > 0 and np.isfinite([self.scale, *self.centre]).all()):
            raise PrtnetError(f"net: found centre {self.centre} and scale {self.scale}, expected finite, scale above 0")
        inputs = encoded_size(self.position_frequencies, self.normal_frequencies, self.encoding)
        inputs += sum(map(_grid_channels, self.grids)) + sum(map(_hash_channels, self.hashes))
        inputs += sum(map(_texel_channels, self.texels))
        found = [weight.shape for weight in self.weights]
        for weight, bias in zip(self.weights, self.biases, strict=True):
            if weight.shape != (len(bias), inputs):
                raise PrtnetError(f"net layers: found {found}, expected a chain in which one takes {inputs} inputs")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise PrtnetError("net weights: found NaN or infinity, expected finite numbers; train it again")
            inputs = len(bias)
        _one_of("groups", self.groups, (1, 4))
        expected = self.groups * sh.count(self.bands)
        if inputs != expected:
            words = f"{self.bands} bands" + (f" in {self.groups} groups" if self.groups > 1 else "")
            raise PrtnetError(f"net outputs: found {inputs}, expected {expected} for {words}")


def _one_of(field: str, found: str | int, expected: tuple[str, ...] | tuple[int, ...]) -> None:
    if found not in expected:
        raise PrtnetError(f"net {field}: found {found!r}, expected one of {', '.join(map(str, expected))}")


def _grid_channels(grid: Array) -> int:
    if grid.ndim != 4 or not _features(grid):
        found = f"{grid.shape} in {grid.dtype}"
        raise PrtnetError(f"net grid: found {found}, expected (z, y, x, channels) in float16 or float32, 4 n channels")
    _refuse_infinite("grid", grid)
    return grid.shape[3]


def _hash_channels(grid: HashGrid) -> int:
    table, entries = grid.table, len(grid.table)
    if table.ndim != 2 or not _features(table) or entries & (entries - 1) or not 1 <= grid.cells < 1 << 20:
        found = f"{grid.cells} cells, {table.shape} in {table.dtype}"
        expected = "cells of 1 or more, (2^m entries, 4 n channels) in float16 or float32"
        raise PrtnetError(f"net hash: found {found}, expected {expected}")
    _refuse_infinite("hash", table)
    return table.shape[1]


def _texel_channels(texels: Array) -> int:
    if texels.ndim != 3 or not _features(texels):
        found = f"{texels.shape} in {texels.dtype}"
        raise PrtnetError(f"net texels: found {found}, expected (y, x, channels) in float16 or float32, 4 n channels")
    _refuse_infinite("texels", texels)
    return texels.shape[2]


def _features(values: Array) -> bool:
    return values.size > 0 and values.shape[-1] % 4 == 0 and values.dtype in (np.float16, np.float32)


def _refuse_infinite(what: str, values: Array) -> None:
    if not np.isfinite(values).all():
        raise PrtnetError(f"net {what}: found NaN or infinity, expected finite numbers; train it again")


def activation(name: str, negative_slope: float = 0.01) -> Callable[[Array], Array]:
    """The activation as a function of an array. GELU is the tanh form (Hendrycks and Gimpel 2016).

    hard_gelu(x) = x clamp((1 + x) / 2, 0, 1) is GELU's shape without an exponential: 0 below -1, x above 1, a parabola
    between. It is the hard-swish of MobileNetV3 (Howard et al. 2019) of 3 x, over 3.
    """
    if name == "leaky_relu":
        return lambda x: np.maximum(x, negative_slope * x)
    if name == "relu":
        return lambda x: np.maximum(x, 0)
    if name == "sine":
        return np.sin
    if name == "hard_gelu":
        return lambda x: x * np.clip(0.5 + 0.5 * x, 0, 1)
    if name == "silu":
        return lambda x: x * _sigmoid(x)
    return lambda x: x * _sigmoid(2 * math.sqrt(2 / math.pi) * (x + 0.044715 * x**3))


def _sigmoid(x: Array) -> Array:
    return 0.5 + 0.5 * np.tanh(0.5 * x)


def evaluate(
    net: NetSpec, positions: Float[Array, "n 3"], normals: Float[Array, "n 3"], uv: Float[Array, "n 2"] | None = None
) -> Float[Array, "n c"]:
    """Transfer at points in file coordinates, with unit normals, in the type of `positions`.

    `uv` as in `evaluate_unit`.
    """
    unit = (np.asarray(positions, np.float64) - np.asarray(net.centre)) * net.scale
    return evaluate_unit(net, unit, normals, uv=uv).astype(np.result_type(positions, np.float32), copy=False)


def evaluate_unit(
    net: NetSpec,
    positions: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    sums: type = np.float64,
    uv: Float[Array, "n 2"] | None = None,
) -> Float[Array, "n c"]:
    """Transfer at centred positions in [-1, 1]^3.

    `uv`, the places of the points in the atlas, in [0, 1]^2, v up, are for nets with texels, which need them.
    Inputs are rounded to float32, as every exported form receives them, and all sums are taken in float64, or those of
    the layers in float32, about twice as fast and to about 1e-6, where `sums` says so.
    """
    check_uv(net, uv)
    # where there are no texels to look up, any will do
    places = np.zeros((len(positions), 2)) if uv is None else uv
    out = np.empty((len(positions), net.groups * sh.count(net.bands)), np.float64)
    for start in range(0, len(positions), _CHUNK):
        part = slice(start, start + _CHUNK)
        inputs = _rounded(positions[part]), _rounded(normals[part]), _rounded(places[part])
        out[part] = _evaluate_chunk(net, *inputs, sums)
    return out.astype(np.result_type(positions, np.float32), copy=False)


def check_uv(net: NetSpec, uv: object) -> None:
    """Raises PrtnetError where the net has texels and nobody says where in the atlas the points are."""
    if uv is None and net.texels:
        raise PrtnetError(
            "net texels: found no uv, expected the place of each point in the atlas of the net's training"
        )
    # where there are no texels to look up, any will do


def _rounded(x: Array) -> Array:
    return np.asarray(x, np.float32).astype(np.float64)


def _evaluate_chunk(net: NetSpec, positions: Array, normals: Array, uv: Array, sums: type) -> Array:
    position = encode(positions, net.position_frequencies, net.encoding)
    normal = encode(normals, net.normal_frequencies, net.encoding)
    features = [trilinear(each, positions) for each in net.grids] + [hashed(each, positions) for each in net.hashes]
    features += [bilinear(each, uv) for each in net.texels]
    h = np.concatenate([position, normal, *features], 1).astype(sums, copy=False)
    bend = activation(net.activation, net.negative_slope)
    last = len(net.weights) - 1
    for i, (weight, bias) in enumerate(zip(net.weights, net.biases, strict=True)):
        h = h @ weight.T.astype(sums) + bias.astype(sums)
        if i < last:
            h = bend(h)
        elif net.output == "tanh":
            h = np.tanh(h)
    h = net.output_scale * h
    return h + np.tile(sh.cosine_lobe(normals, net.bands), net.groups) if net.residual else h


def macs(net: NetSpec) -> int:
    """Multiply-adds of the layers for one point, 8 for a channel fetched from a grid, dense or hashed, 4 from texels.

    The encoding, activations and the analytic lobe are not counted.
    """
    features = (*net.grids, *(each.table for each in net.hashes))
    fetches = 8 * sum(values.shape[-1] for values in features) + 4 * sum(values.shape[-1] for values in net.texels)
    return sum(weight.size for weight in net.weights) + fetches


def byte_count(net: NetSpec) -> int:
    """Bytes of the weights, biases, grids and texels, as stored."""
    return sum(array.nbytes for array in _arrays(net))


def checksum(net: NetSpec) -> str:
    """SHA-256 of weights, biases, grids, tables and texels, little-endian, in this order."""
    total = hashlib.sha256()
    for array in _arrays(net):
        total.update(np.ascontiguousarray(array, array.dtype.newbyteorder("<")).tobytes())
    return total.hexdigest()


def _arrays(net: NetSpec) -> tuple[Array, ...]:
    return (*net.weights, *net.biases, *net.grids, *(each.table for each in net.hashes), *net.texels)


def save(net: NetSpec, path: Path | str) -> None:
    """Writes the net, atomically; the same net gives the same bytes. Inverse of `load`."""
    values = {field.name: (getattr(net, field.name), field.default) for field in fields(net)}
    descriptor = {name: value for name, (value, default) in values.items() if name not in _LATER or value != default}
    descriptor["centre"] = list(net.centre)
    del descriptor["weights"], descriptor["biases"]
    tensors = {}
    for i, (weight, bias) in enumerate(zip(net.weights, net.biases, strict=True)):
        tensors[f"layer.{i}.weight"] = np.ascontiguousarray(weight, np.float32)
        tensors[f"layer.{i}.bias"] = np.ascontiguousarray(bias, np.float32)
    tensors |= {f"grid.{i}": np.ascontiguousarray(grid) for i, grid in enumerate(net.grids)}
    tensors |= {f"hash.{i}": np.ascontiguousarray(each.table) for i, each in enumerate(net.hashes)}
    tensors |= {f"texels.{i}": np.ascontiguousarray(each) for i, each in enumerate(net.texels)}
    descriptor |= {name: len(getattr(net, name)) for name in ("grids", "texels") if name in descriptor}
    if net.hashes:
        descriptor["hashes"] = [each.cells for each in net.hashes]
    text = json.dumps({"format": FORMAT, "layers": len(net.weights), **descriptor, "sha256": checksum(net)})
    with store.atomic(Path(path)) as temporary:
        temporary.write_bytes(to_bytes(tensors, metadata={METADATA_KEY: text}))


def load(path: Path | str) -> NetSpec:
    """Reads a net. Inverse of `save`. Raises PrtnetError, with the file's name, for anything that is no whole net."""
    try:
        with safe_open(str(path), framework="numpy") as file:
            descriptor = _descriptor(file.metadata())
            # files of earlier versions have none
            written = descriptor.pop("sha256", None)
            layers = range(descriptor.pop("layers"))
            weights = tuple(file.get_tensor(f"layer.{i}.weight") for i in layers)
            biases = tuple(file.get_tensor(f"layer.{i}.bias") for i in layers)
            grids = tuple(file.get_tensor(f"grid.{i}") for i in range(descriptor.pop("grids", 0)))
            texels = tuple(file.get_tensor(f"texels.{i}") for i in range(descriptor.pop("texels", 0)))
            cells = descriptor.pop("hashes", [])
            hashes = tuple(HashGrid(each, file.get_tensor(f"hash.{i}")) for i, each in enumerate(cells))
        net = NetSpec(weights=weights, biases=biases, grids=grids, hashes=hashes, texels=texels, **descriptor)
        if written not in (None, checksum(net)):
            raise PrtnetError("found other weights than were written: their checksum differs")
        return net
    except FileNotFoundError:
        raise PrtnetError(f"{path}: no such file, expected a trained net; train and export one first") from None
    except (SafetensorError, OSError, ValueError, TypeError, KeyError, PrtnetError) as error:
        raise PrtnetError(f"{path}: {error}. Expected a whole net file (format {FORMAT}); export it again") from error


def _descriptor(metadata: dict[str, str] | None) -> dict:
    text = (metadata or {}).get(METADATA_KEY)
    if text is None:
        raise PrtnetError(f"found no descriptor {METADATA_KEY!r} in the metadata")
    descriptor = json.loads(text)
    found = descriptor.pop("format", None)
    if found != FORMAT:
        raise PrtnetError(f"found format {found}")
    descriptor["centre"] = tuple(descriptor["centre"])
    return descriptor
