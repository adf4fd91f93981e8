"""The Python text of a network's distance, for numba.

A loop over neurons inside of a loop over points is no code that LLVM turns into vectors, and written out it takes a
minute to compile. So the text has two functions: `distances(p, count)` works on a packet of points, the rows of p being
x, y, z and the distance, with the loop over points innermost; `distance` is a packet of one.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float

Array = np.ndarray

BLOCK = 8  # inputs summed before the sum is stored

_HEAD = """def distance(x, y, z):
    p = np.empty((4, 1), np.float32)
    p[0, 0], p[1, 0], p[2, 0] = x, y, z
    distances(p, 1)
    return p[3, 0]


{constants}

@njit(error_model="numpy", fastmath=FAST, cache=True)
def distances(p, count):
    a = np.empty(count, np.float32)
    h0 = np.empty((3, count), np.float32)
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
    lines = [_HEAD.format(constants="\n".join(constants))[:-1]]
    lines += [f"    h{i + 1} = np.empty(({len(bias)}, count), np.float32)" for i, bias in enumerate(biases[:-1])]
    for axis, bound in enumerate(half):
        lines += ["    for q in range(count):"]
        lines += [f"        h0[{axis}, q] = min(max(p[{axis}, q], F({-bound!r})), F({bound!r}))"]
    for i, weight in enumerate(weights):
        lines += _layer(i, *weight.shape, last=i == len(weights) - 1)
    return "\n".join([*lines, *_beyond(), ""])


def _literal(array: Array) -> str:
    """Every bit of a float32 array."""
    text = np.ascontiguousarray(array, "<f4").tobytes().hex()
    return f'np.frombuffer(bytes.fromhex("{text}"), np.float32).reshape({array.shape})'


def _layer(layer: int, outputs: int, inputs: int, *, last: bool) -> Iterator[str]:
    """Rows of h{layer} to those of h{layer + 1}, or to the distance."""
    yield f"    for j in range({outputs}):"
    yield f"        start = B{layer}[j]"
    yield "        for q in range(count):"
    yield "            a[q] = start"
    whole = inputs // BLOCK * BLOCK
    if whole:
        yield f"        for i in range(0, {whole}, {BLOCK}):"
        yield from _block(layer, [f"i + {b}" for b in range(BLOCK)], "            ")
    if inputs > whole:
        yield from _block(layer, [str(i) for i in range(whole, inputs)], "        ")
    yield "        for q in range(count):"
    yield "            p[3, q] = a[q]" if last else f"            h{layer + 1}[j, q] = sin(a[q])"


def _block(layer: int, rows: list[str], indent: str) -> Iterator[str]:
    for b, row in enumerate(rows):
        yield f"{indent}w{b} = W{layer}[j, {row}]"
    yield f"{indent}for q in range(count):"
    yield f"{indent}    a[q] += " + " + ".join(f"w{b} * h{layer}[{row}, q]" for b, row in enumerate(rows))


def _beyond() -> Iterator[str]:
    """Outside of the box."""
    yield "    for q in range(count):"
    yield "        u, v, w = p[0, q] - h0[0, q], p[1, q] - h0[1, q], p[2, q] - h0[2, q]"
    yield "        away = u * u + v * v + w * w"
    yield "        p[3, q] = sqrt(away + p[3, q] * p[3, q]) if away > F(0) else p[3, q]"
