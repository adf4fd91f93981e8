"""How a net is spelt in GLSL: the dialect, where the weights are, how they are rounded; and the net that this gives."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Float32, Int

from prtnet import PrtnetError
from prtnet.export.spelling import quads
from prtnet.netspec import NetSpec

Array = np.ndarray

VERSIONS = ("330", "430", "300 es")
STORAGES = ("auto", "literal", "texture", "ubo")
PRECISIONS = ("float32", "float16")
DIGITS = range(4, 10)
AUTO_LITERAL_MACS = 20_000  # above, a weight texture is ready in a second and literals take many
MAX_LITERAL_MACS = 60_000


@dataclass(frozen=True)
class Form:
    """Raises PrtnetError, naming the configuration's key, for a word that means nothing."""

    version: str = "330"
    storage: str = "auto"  # literal up to AUTO_LITERAL_MACS padded multiply-adds, above that texture
    precision: str = "float32"  # of weights and biases; grids have their own
    digits: int = 9  # of literals; 9 say every float32

    def __post_init__(self) -> None:
        allowed = {"version": VERSIONS, "storage": STORAGES, "precision": PRECISIONS, "digits": DIGITS}
        for name, expected in allowed.items():
            found = getattr(self, name)
            if found not in expected:
                words = ", ".join(map(str, expected))
                raise PrtnetError(f"export.{name}: found {found!r}, expected one of {words}")
        if self.storage == "ubo" and self.precision == "float16":
            raise PrtnetError(
                "export.precision: found float16 with export.storage=ubo, whose blocks hold float32; expected float32, "
                "or export.storage=texture"
            )

    def of_sizes(self, sizes: list[int], groups: int = 1) -> "Form":
        """With a storage for layers of these sizes, inputs first. Raises PrtnetError for literals that are too many."""
        if self.storage == "auto":
            few = padded_macs_of(sizes, groups) <= AUTO_LITERAL_MACS
            return replace(self, storage="literal" if few else "texture")
        if self.storage == "literal":
            check_size(sizes, groups)
        return self

    def of(self, net: NetSpec) -> "Form":
        """With a storage for this net."""
        return self.of_sizes(sizes_of(net), net.groups)


def rounded(net: NetSpec, form: Form) -> NetSpec:
    """The net that the exported form computes: weights and biases rounded as that form holds them.

    `form.storage` is not auto. Raises PrtnetError where a weight is beyond float16.
    """

    def held(values: Float[Array, "..."]) -> Float32[Array, "..."]:
        if form.precision == "float16":
            values = _halves(values)
        if form.storage == "literal" and form.digits < 9:
            texts = [f"{value:.{form.digits}g}" for value in values.ravel()]
            values = np.array(texts, np.float64).reshape(values.shape)
        return values.astype(np.float32)

    return replace(net, weights=tuple(map(held, net.weights)), biases=tuple(map(held, net.biases)))


def _halves(values: Float[Array, "..."]) -> Float[Array, "..."]:
    highest, limit = float(np.abs(values).max(initial=0)), float(np.finfo(np.float16).max)
    if highest > limit:
        raise PrtnetError(
            f"export.precision: found a weight of {highest:g}, expected at most {limit:g} in float16; choose float32"
        )
    return values.astype(np.float16)


def sizes_of(net: NetSpec) -> list[int]:
    """Numbers that enter the first layer and leave each layer."""
    return [net.weights[0].shape[1], *map(len, net.biases)]


def padded_macs_of(sizes: list[int], groups: int) -> int:
    """Multiply-adds of layers with every size rounded up to a multiple of 4."""
    vectors = [*map(quads, sizes[:-1]), groups * quads(sizes[-1] // groups)]
    return sum(16 * before * after for before, after in pairwise(vectors))


def check_size(sizes: list[int], groups: int = 1) -> None:
    """Raises PrtnetError where a net of these layers, inputs first, is too large for literals."""
    if padded_macs_of(sizes, groups) > MAX_LITERAL_MACS:
        raise PrtnetError(
            f"GLSL export: found {padded_macs_of(sizes, groups)} padded multiply-adds, expected at most"
            f" {MAX_LITERAL_MACS} as literals, since compilers take minutes; choose export.storage=texture, or lower"
            " model.width or model.depth"
        )


def padded(net: NetSpec, layer: int) -> tuple[Float32[Array, "rows columns"], Float32[Array, " rows"]]:
    """Weights and biases of a layer with zeros up to whole vec4s; of the last one each group begins with a vec4."""
    weight, bias = net.weights[layer], net.biases[layer]
    groups = net.groups if layer == len(net.weights) - 1 else 1
    each, columns = quads(len(bias) // groups), quads(weight.shape[1])
    place = _padded_rows(len(bias) // groups, groups)
    matrix = np.zeros((4 * groups * each, 4 * columns), np.float32)
    shift = np.zeros(4 * groups * each, np.float32)
    matrix[place, : weight.shape[1]], shift[place] = weight, bias
    return matrix, shift


def _padded_rows(size: int, groups: int) -> Int[Array, " n"]:
    """Where groups of `size` rows stand when each begins with a vec4 of its own."""
    return (np.arange(size) + 4 * quads(size) * np.arange(groups)[:, None]).ravel()


def rows(net: NetSpec, layer: int) -> Float32[Array, "r w 4"]:
    """A layer as rows of vec4s, one row for four outputs: their biases, then their weights for each input in turn.

    A storage multiplies as many inputs as `quads` pads them to.
    """
    matrix, shift = padded(net, layer)
    weights = matrix.reshape(-1, 4, matrix.shape[1]).transpose(0, 2, 1)
    return np.ascontiguousarray(np.concatenate([shift.reshape(-1, 1, 4), weights], axis=1))
