"""A distance in the weights of a small network, and its file.

    q = p clamped to |q| <= half, the box that the network knows
    h = q;  h = sin(W h + b) for each hidden layer;  g = W h + b           (SIREN: Sitzmann et al. 2020)
    f(p) = g inside the box, sqrt(|p - q|^2 + g^2) outside of it

The surface lies inside the box, which is convex: outside, f is at most the distance that g has at q made exact, and no
steeper. All in unit coordinates.
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float64, Int
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as to_bytes

from prtnet import PrtnetError, store
from prtnet.data.implicit import neural_source
from prtnet.data.scene import IDENTITY, Frame

Array = np.ndarray

FORMAT = 1
METADATA_KEY = "prtnet_neural_sdf"
CHUNK = 1 << 13  # points whose layers stay in the cache


@dataclass(frozen=True, eq=False)
class Neural:
    """Weights are float32, (outputs, inputs) per layer, the last one with one output. A `Field`.

    `lipschitz`: the greatest slope in the box, see `steepest`. `half`: of the box about the origin that the network
    knows. `frame` leads from the coordinates of the mesh that it was fitted to.
    """

    weights: tuple[Float[Array, "_ _"], ...]
    biases: tuple[Float[Array, " _"], ...]
    half: tuple[float, float, float] = (1.1, 1.1, 1.1)
    lipschitz: float = 1.0
    frame: Frame = IDENTITY

    def __post_init__(self) -> None:
        inputs, found = 3, [weight.shape for weight in self.weights]
        for weight, bias in zip(self.weights, self.biases, strict=True):
            if weight.shape != (len(bias), inputs):
                raise PrtnetError(f"neural field: layers: found {found}, expected a chain that takes 3 inputs")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise PrtnetError("neural field: weights: found NaN or infinity, expected finite numbers; fit it again")
            inputs = len(bias)
        if inputs != 1:
            raise PrtnetError(f"neural field: outputs: found {inputs}, expected 1, the distance")
        if not (0 < self.lipschitz < np.inf and 0 < min(self.half) <= max(self.half) < np.inf):
            raise PrtnetError(
                f"neural field: found lipschitz {self.lipschitz} and half {self.half}, expected finite, above 0"
            )

    def distance(self, points: Float[Array, "n 3"]) -> Float64[Array, " n"]:
        """Float64: the plain twin of all compiled forms."""
        return self._evaluated(points, slopes=False)[:, 0]

    def gradient(self, points: Float[Array, "n 3"]) -> Float64[Array, "n 3"]:
        """Of the distance, by back-propagation, not normalised, float64."""
        return self._evaluated(points, slopes=True)[:, 1:]

    def part(self, points: Float[Array, "n 3"]) -> Int[Array, " n"]:
        """A network has one part."""
        return np.zeros(len(points), np.int64)

    def source(self) -> str:
        return neural_source.python(self.weights, self.biases, self.half)

    def digest(self) -> str:
        """sha256 of weights and biases, little-endian, layer by layer, and of the numbers beside them."""
        total = hashlib.sha256(repr((self.half, self.lipschitz)).encode())
        for array in (*self.weights, *self.biases):
            total.update(np.ascontiguousarray(array, "<f4").tobytes())
        return total.hexdigest()

    def _evaluated(self, points: Array, slopes: bool) -> Array:
        points = np.asarray(points, np.float64)
        out = np.empty((len(points), 4))
        for first in range(0, len(points), CHUNK):
            part = slice(first, first + CHUNK)
            self._chunk(points[part], out[part], slopes)
        return out

    def _chunk(self, points: Array, out: Array, slopes: bool) -> None:
        """Distance, and slopes where they are asked for, of some points."""
        inside = np.clip(points, -np.array(self.half), self.half)
        layers = [(w.astype(np.float64), b.astype(np.float64)) for w, b in zip(self.weights, self.biases, strict=True)]
        h, angles = inside, []
        for weight, bias in layers[:-1]:
            angles.append(h @ weight.T + bias)
            h = np.sin(angles[-1])
        within = (h @ layers[-1][0].T + layers[-1][1])[:, 0]
        away = points - inside
        squared = np.einsum("ni,ni->n", away, away)
        out[:, 0] = np.where(squared > 0, np.sqrt(squared + within**2), within)
        if not slopes:
            return
        back = np.broadcast_to(layers[-1][0], h.shape)
        for (weight, _), angle in zip(reversed(layers[:-1]), reversed(angles), strict=True):
            back = (back * np.cos(angle)) @ weight
        # a clamped coordinate does not move the network's point
        held = away + within[:, None] * np.where(away == 0, back, 0)
        beyond = (squared > 0)[:, None]
        out[:, 1:] = np.where(beyond, held / np.where(beyond, out[:, :1], 1), back)


def save(field: Neural, path: Path | str) -> None:
    """Writes a network, atomically; the same one gives the same bytes. Inverse of `load`."""
    frame = {"centre": field.frame.centre.tolist(), "scale": field.frame.scale}
    numbers = {"half": list(field.half), "lipschitz": field.lipschitz, **frame}
    text = json.dumps({"format": FORMAT, "layers": len(field.weights), **numbers, "sha256": _checksum(field)})
    tensors = {}
    for i, (weight, bias) in enumerate(zip(field.weights, field.biases, strict=True)):
        tensors[f"layer.{i}.weight"] = np.ascontiguousarray(weight, np.float32)
        tensors[f"layer.{i}.bias"] = np.ascontiguousarray(bias, np.float32)
    with store.atomic(Path(path)) as temporary:
        temporary.write_bytes(to_bytes(tensors, metadata={METADATA_KEY: text}))


def load(path: Path | str) -> Neural:
    """Reads a network. Inverse of `save`. Raises PrtnetError, with the file's name, for what is no whole one."""
    try:
        with safe_open(str(path), framework="numpy") as file:
            words = json.loads((file.metadata() or {}).get(METADATA_KEY, "{}"))
            if words.get("format") != FORMAT:
                raise PrtnetError(f"found format {words.get('format')}")
            layers = range(words["layers"])
            weights = tuple(file.get_tensor(f"layer.{i}.weight") for i in layers)
            biases = tuple(file.get_tensor(f"layer.{i}.bias") for i in layers)
        x, y, z = (float(value) for value in words["half"])
        frame = Frame(np.array(words["centre"], np.float64), float(words["scale"]))
        field = Neural(weights, biases, (x, y, z), float(words["lipschitz"]), frame)
        if words["sha256"] != _checksum(field):
            raise PrtnetError("found other numbers than were written: their checksum differs")
        return field
    except FileNotFoundError:
        raise PrtnetError(f"{path}: no such file, expected a neural distance; fit one first") from None
    except (SafetensorError, OSError, ValueError, TypeError, KeyError, PrtnetError) as error:
        raise PrtnetError(
            f"{path}: {error}. Expected a whole neural distance (format {FORMAT}); fit it again"
        ) from error


def _checksum(field: Neural) -> str:
    """Of all that the file holds."""
    frame = repr((field.frame.centre.tolist(), field.frame.scale))
    return hashlib.sha256((field.digest() + frame).encode()).hexdigest()


def steepest(field: Neural, rng: np.random.Generator, count: int = 1 << 16, climbs: int = 64) -> Float64[Array, " n"]:
    """The greatest slopes found in the box, the first the greatest of all: an estimate from below of the true bound.

    Dense random points, and from the steepest of them a climb by random steps that shrink.
    """
    half = np.array(field.half)
    points = rng.uniform(-1, 1, (count, 3)) * half
    slopes = np.linalg.norm(field.gradient(points), axis=1)
    best = np.argsort(slopes)[-climbs:]
    points, slopes = points[best], slopes[best]
    for step in 0.05 * 0.7 ** np.arange(24):
        tried = np.clip(points + step * rng.normal(size=(8, *points.shape)), -half, half)
        found = np.linalg.norm(field.gradient(tried.reshape(-1, 3)), axis=1).reshape(8, -1)
        pick = found.argmax(axis=0), np.arange(len(slopes))
        better = found[pick] > slopes
        points = np.where(better[:, None], tried[pick], points)
        slopes = np.where(better, found[pick], slopes)
    return np.sort(slopes)[::-1]
