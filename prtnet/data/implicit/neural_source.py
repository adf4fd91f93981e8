"""The Python text of a network's distance, for numba.

A loop over neurons inside of a loop over points is no code that LLVM turns into vectors, and written out it takes a
minute to compile. So the text has two functions: `distances(p, count)` works on a packet of points, the rows of p being
x, y, z and the distance, with the loop over points innermost; `distance` is a packet of one.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

Array = np.ndarray

LANES = 16  # points of a packet
# sums at a time, which share what they read, and inputs summed before the sums are stored
OUTPUTS, INPUTS = 4, 8

_HEAD = """def distance(x, y, z):
    p = np.zeros((4, LANES), np.float32)
    p[0, 0], p[1, 0], p[2, 0] = x, y, z
    distances(p, 1)
    return p[3, 0]


LANES = {lanes}
{constants}

@njit(error_model="numpy", fastmath=FAST, cache=True)
def distances(p, count):
    h0 = np.empty((3, LANES), np.float32)
"""


def python(
    weights: Sequence[Float[Array, "_ _"]], biases: Sequence[Float[Array, " _"]], half: tuple[float, float, float]
) -> str:
    """Text that uses np, njit, sin, sqrt, FAST (flags of fast mathematics), and F, which makes a float32."""
    constants = [
        f"{name}{i} = {_literal(array)}"
        for i, layer in enumerate(zip(weights, biases, strict=True))
        for name, array in zip("WB", layer, strict=True)
    ]
    lines = [_HEAD.format(constants="\n".join(constants), lanes=LANES)[:-1]]
    lines += [f"    a{r} = np.empty(LANES, np.float32)" for r in range(OUTPUTS)]
    lines += [f"    h{i + 1} = np.empty(({len(bias)}, LANES), np.float32)" for i, bias in enumerate(biases[:-1])]
    for axis, bound in enumerate(half):
        lines += ["    for q in range(LANES):"]
        lines += [f"        h0[{axis}, q] = min(max(p[{axis}, q], F({-bound!r})), F({bound!r}))"]
    for i, weight in enumerate(weights):
        lines += _layer(i, *weight.shape, last=i == len(weights) - 1)
    return "\n".join([*lines, *_beyond(), ""])


def _literal(array: Array) -> str:
    """Every bit of a float32 array."""
    text = np.ascontiguousarray(array, "<f4").tobytes().hex()
    return f'np.frombuffer(bytes.fromhex("{text}"), np.float32).reshape({array.shape})'


def _layer(layer: int, outputs: int, inputs: int, *, last: bool) -> Iterator[str]:
    """Rows of h{layer} to those of h{layer + 1}, or to the distance: OUTPUTS sums at a time, each over INPUTS rows."""
    whole = outputs // OUTPUTS * OUTPUTS
    if whole:
        yield f"    for j in range(0, {whole}, {OUTPUTS}):"
        yield from _sums(layer, [f"j + {r}" for r in range(OUTPUTS)], inputs, last)
    if outputs > whole:
        yield "    if True:"
        yield from _sums(layer, [str(j) for j in range(whole, outputs)], inputs, last)


def _sums(layer: int, outputs: list[str], inputs: int, last: bool) -> Iterator[str]:
    yield "        for q in range(LANES):"
    yield from (f"            a{r}[q] = B{layer}[{j}]" for r, j in enumerate(outputs))
    whole = inputs // INPUTS * INPUTS
    if whole:
        yield f"        for i in range(0, {whole}, {INPUTS}):"
        yield from _block(layer, outputs, [f"i + {b}" for b in range(INPUTS)], "            ")
    if inputs > whole:
        yield from _block(layer, outputs, [str(i) for i in range(whole, inputs)], "        ")
    yield "        for q in range(LANES):"
    for r, j in enumerate(outputs):
        yield f"            p[3, q] = a{r}[q]" if last else f"            h{layer + 1}[{j}, q] = sin(a{r}[q])"


def _block(layer: int, outputs: list[str], rows: list[str], indent: str) -> Iterator[str]:
    for r, j in enumerate(outputs):
        yield from (f"{indent}w{r}_{b} = W{layer}[{j}, {row}]" for b, row in enumerate(rows))
    yield f"{indent}for q in range(LANES):"
    yield from (f"{indent}    x{b} = h{layer}[{row}, q]" for b, row in enumerate(rows))
    for r in range(len(outputs)):
        yield f"{indent}    a{r}[q] += " + " + ".join(f"w{r}_{b} * x{b}" for b in range(len(rows)))


def _beyond() -> Iterator[str]:
    """Outside of the box."""
    yield "    for q in range(LANES):"
    yield "        u, v, w = p[0, q] - h0[0, q], p[1, q] - h0[1, q], p[2, q] - h0[2, q]"
    yield "        away = u * u + v * v + w * w"
    yield "        p[3, q] = sqrt(away + p[3, q] * p[3, q]) if away > F(0) else p[3, q]"
