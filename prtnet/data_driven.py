"""The hand-over format of data-driven transfer, and the plain evaluator that every fast path is tested against.

    u = M x^(1/g)        x: direct light at m measurement points, per colour; M: "n m"
    I = (B u)^g          B: n basis textures; g: 1 (linear) or that of a gamma space

Belcour, Deliot, Barbier and Soler 2022, *A Data-Driven Paradigm for Precomputed Radiance Transfer*: B comes from an SVD
of lightmaps under random lights, M from a ridge regression of their coefficients (`prtnet.models.data_driven`). With
g = 1 the map from light to light is linear to rounding: the mean of the lightmaps is the first element of the basis,
with a coefficient of its own, rather than a constant that every light would add.

The file is safetensors with one JSON descriptor in its metadata.
"""

import json
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int
from safetensors import SafetensorError, safe_open

from prtnet import PrtnetError, store

Array = np.ndarray

FORMAT = 1
METADATA_KEY = "prtnet_data_driven"
# what the basis textures add up to: irradiance, which is shown as albedo / pi times it beside what is lit directly; or
# all radiance that leaves a surface, the same in all directions, shown as it is (subsurface scattering, hair)
QUANTITIES = ("irradiance", "radiance")


@dataclass(frozen=True, eq=False)
class Measurement:
    """Where direct light is measured: m points, each the mean of s surface points near it, in unit coordinates.

    An entry of the direct vector is the mean of albedo / pi times direct irradiance over the s points, per colour.
    """

    positions: Float32[Array, "m s 3"]
    normals: Float32[Array, "m s 3"]  # unit, shading
    geometric_normals: Float32[Array, "m s 3"]  # unit, the side on which shadow rays start
    albedo: Float32[Array, "m s 3"]  # linear RGB
    # the mean of albedo / pi times transfer: what light from far away adds to an entry; k = 0 where none is expected
    transfer: Float32[Array, "m k 3"]

    @property
    def count(self) -> int:
        return len(self.positions)


@dataclass(frozen=True, eq=False)
class DataDriven:
    """Basis and operator. One bank serves all colours, three are of red, green and blue."""

    basis: Float32[Array, "banks n t"]  # rows orthonormal; t texels in the order of `texels`
    matrices: Float32[Array, "keyframes banks n m"]
    measurements: tuple[Measurement, ...]  # of each keyframe
    texels: Int[Array, " t"]  # flat index, row * size + column, row 0 on top
    size: int  # texels along one side
    scene: str  # digest of the scene it was made for
    gamma: float = 1.0
    quantity: str = "irradiance"

    @property
    def elements(self) -> int:
        return self.basis.shape[1]

    def __post_init__(self) -> None:
        banks, n, t = self.basis.shape
        keyframes, _, _, m = self.matrices.shape
        shapes_fit = banks in (1, 3) and self.matrices.shape[1:3] == (banks, n) and len(self.texels) == t
        if not shapes_fit or len(self.measurements) != keyframes or any(each.count != m for each in self.measurements):
            raise PrtnetError(
                f"data-driven: found a basis {self.basis.shape}, matrices {self.matrices.shape},"
                f" {len(self.texels)} texels and measurements of {[each.count for each in self.measurements]} points,"
                " expected sizes that agree"
            )
        if self.quantity not in QUANTITIES or not self.gamma > 0:
            raise PrtnetError(
                f"data-driven: found the quantity {self.quantity!r} and gamma {self.gamma}, expected one of"
                f" {', '.join(QUANTITIES)} and a gamma above 0"
            )


def coefficients(spec: DataDriven, direct: Float[Array, "m 3"], keyframe: int = 0) -> Float[Array, "n 3"]:
    """u, per colour, of direct light at the measurement points."""
    if len(direct) != spec.matrices.shape[3]:
        raise PrtnetError(f"data-driven: found {len(direct)} measurements, expected {spec.matrices.shape[3]}")
    light = to_space(np.asarray(direct, np.float64), spec.gamma)
    matrix = np.broadcast_to(spec.matrices[keyframe], (3, *spec.matrices.shape[2:])).astype(np.float64)
    return np.einsum("cnm,mc->nc", matrix, light)


def indirect(spec: DataDriven, direct: Float[Array, "m 3"], keyframe: int = 0) -> Float[Array, "t 3"]:
    """The quantity of `spec` at each texel; ringing below 0 is left in a linear space."""
    u = coefficients(spec, direct, keyframe)
    basis = np.broadcast_to(spec.basis, (3, *spec.basis.shape[1:]))
    return from_space(np.einsum("cnt,nc->tc", basis, u, dtype=np.float64), spec.gamma)


def to_space(values: Array, gamma: float) -> Array:
    """Light in the space that the operator works in. Inverse: `from_space`."""
    return values if gamma == 1 else np.maximum(values, 0) ** (1 / gamma)


def from_space(values: Array, gamma: float) -> Array:
    """Inverse of `to_space`."""
    return values if gamma == 1 else np.maximum(values, 0) ** gamma


def image(spec: DataDriven, values: Float[Array, "t c"]) -> Float32[Array, "size size c"]:
    """Values of the texels as an image, 0 where none is."""
    flat = np.zeros((spec.size * spec.size, values.shape[1]), np.float32)
    flat[spec.texels] = values
    return flat.reshape(spec.size, spec.size, -1)


def channels(spec: DataDriven) -> int:
    """Of the basis textures: four to a texel, in each bank."""
    return 4 * -(-spec.elements // 4) * spec.basis.shape[0]


def macs(spec: DataDriven) -> int:
    """Multiply-adds per pixel of what the operator adds: a bilinear fetch of every channel, and their sum."""
    return 4 * channels(spec) + 3 * spec.elements


def point_bytes(spec: DataDriven) -> int:
    """Bytes of the measurement points of all keyframes on the graphics card."""
    return sum(2 * 12 * each.positions.shape[0] * each.positions.shape[1] for each in spec.measurements)


def byte_count(spec: DataDriven, texel_bytes: int = 4) -> int:
    """Bytes of basis textures, matrices of all keyframes and measurement points on the graphics card."""
    return channels(spec) * spec.size**2 * texel_bytes + 4 * spec.matrices.size + point_bytes(spec)


def save(spec: DataDriven, path: Path) -> None:
    """Write the file. Inverse of `load`."""
    arrays = {"basis": spec.basis, "matrices": spec.matrices, "texels": np.asarray(spec.texels, np.int32)}
    for number, each in enumerate(spec.measurements):
        arrays |= {f"{field.name}.{number}": getattr(each, field.name) for field in fields(Measurement)}
    words = {"format": FORMAT, "keyframes": len(spec.measurements)}
    words |= {name: getattr(spec, name) for name in ("size", "scene", "gamma", "quantity")}
    store.save_arrays(path, arrays, {METADATA_KEY: json.dumps(words, sort_keys=True)})


def load(path: Path) -> DataDriven:
    """Read a file. Inverse of `save`. Raises PrtnetError, naming the file, for anything else."""
    arrays = store.load_arrays(path)
    try:
        with safe_open(path, "numpy") as file:
            words = json.loads((file.metadata() or {})[METADATA_KEY])
        if words.pop("format") != FORMAT:
            raise ValueError("of another format")
        names = [field.name for field in fields(Measurement)]
        measurements = tuple(
            Measurement(**{name: arrays[f"{name}.{number}"] for name in names})
            for number in range(words.pop("keyframes"))
        )
        return DataDriven(arrays["basis"], arrays["matrices"], measurements, arrays["texels"], **words)
    except (KeyError, TypeError, ValueError, SafetensorError) as error:
        raise PrtnetError(f"{path}: found no data-driven transfer ({error}), expected one of format {FORMAT}") from None
