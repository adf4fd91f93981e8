"""Layers with their weights in uniform blocks, for graphics processors that read those faster than textures.

Blocks `prt_block0`, `prt_block1`, ... are std140 arrays of vec4. They hold the rows of `prtnet.export.form.rows`,
layer by layer, one row after the other; a row that would not fit begins the next block. llvmpipe takes minutes to
compile even small nets in this form, so it is validated and not run.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from prtnet.export import form
from prtnet.export.literal import bent
from prtnet.export.spelling import quads
from prtnet.netspec import NetSpec

Array = np.ndarray

NOT_RUN = "uniform blocks are validated and not run: software drivers take minutes to compile them"


class _Run(NamedTuple):
    """Rows first to last of a layer that stand in one block, from vec4 `start` on."""

    layer: int
    first: int
    last: int
    block: int
    start: int


def blocks(net: NetSpec, block_bytes: int) -> list[Float32[Array, "n 4"]]:
    """The contents of the blocks, each of at most `block_bytes` where a row has room in it."""
    parts: list[list[Array]] = []
    for run in _runs(net, block_bytes):
        if run.block == len(parts):
            parts.append([])
        parts[run.block].append(form.rows(net, run.layer)[run.first : run.last].reshape(-1, 4))
    return [np.concatenate(each) for each in parts]


def declarations(net: NetSpec, block_bytes: int) -> list[str]:
    """GLSL before the function."""
    sizes = map(len, blocks(net, block_bytes))
    return [
        f"layout(std140) uniform prt_block{i} {{ highp vec4 prt_values{i}[{size}]; }};" for i, size in enumerate(sizes)
    ]


def layers(net: NetSpec, names: list[str], count: int, block_bytes: int) -> Iterator[str]:
    """GLSL after which `names`, the inputs as vec4s, are the vec4s that leave layer `count`."""
    yield f"vec4 x0[{len(names)}];"
    for i, group in enumerate(names):
        yield f"x0[{i}] = {group};"
    size = len(names)
    for layer in range(count):
        before, size = size, len(form.padded(net, layer)[1]) // 4
        yield f"vec4 x{layer + 1}[{size}];"
        for run in _runs(net, block_bytes):
            if run.layer == layer:
                yield from _loop(net, run, before)
    names[:] = [f"x{count}[{i}]" for i in range(size)]


def _loop(net: NetSpec, run: _Run, before: int) -> Iterator[str]:
    values, layer = f"prt_values{run.block}", run.layer
    yield f"for (int o = {run.first}; o < {run.last}; ++o) {{"
    yield f"  int at = {run.start} + (o - {run.first}) * {1 + 4 * before};"
    yield f"  vec4 sum = {values}[at];"
    yield f"  for (int i = 0; i < {before}; ++i) {{"
    columns = ", ".join(f"{values}[at + 4 * i + {axis}]" for axis in range(1, 5))
    yield f"    sum += mat4({columns}) * x{layer}[i];"
    yield "  }"
    yield f"  x{layer + 1}[o] = {bent(net, layer, 'sum')};"
    yield "}"


def _runs(net: NetSpec, block_bytes: int) -> Iterator[_Run]:
    room, block, used = block_bytes // 16, 0, 0
    for layer, weight in enumerate(net.weights):
        length, count = 1 + 4 * quads(weight.shape[1]), len(form.padded(net, layer)[1]) // 4
        first = 0
        while first < count:
            if used and used + length > room:
                block, used = block + 1, 0
            # a row longer than a block gets one of its own, for the check of limits to find
            last = min(count, first + max(1, (room - used) // length))
            yield _Run(layer, first, last, block, used)
            used += (last - first) * length
            first = last
