"""Layers with their weights in a texture, for nets of any size: loops over texelFetch.

One RGBA 2D texture `prt_weights` has the layers one below the other, four outputs in a row: texel 0 their biases, texel
1 + j their weights for input j. What is left of a row is 0.

A compiler that knows how often a loop runs may unroll it, and then takes as long as for literals. It cannot know the
size of the texture that will be bound, so that every bound has `one`, which is 1, in it: as good as a uniform, and
nobody has to set it.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from prtnet.export import form
from prtnet.export.literal import bent
from prtnet.export.spelling import CHOSEN
from prtnet.netspec import NetSpec

Array = np.ndarray

NAME = "prt_weights"


def texels(net: NetSpec, precision: str = "float32") -> Float[Array, "h w 4"]:
    """The image of the texture, row 0 first, in the type that `precision` names."""
    layers = [form.rows(net, layer) for layer in range(len(net.weights))]
    image = np.zeros((sum(map(len, layers)), max(each.shape[1] for each in layers), 4), precision)
    first = 0
    for each in layers:
        image[first : first + len(each), : each.shape[1]] = each
        first += len(each)
    return image


def declarations(net: NetSpec, precision: str) -> list[str]:
    """GLSL before the function."""
    height, width, _ = texels(net).shape
    bits = 8 * np.dtype(precision).itemsize
    return [f"// weights: {width} x {height} texels, RGBA{bits}F", f"uniform highp sampler2D {NAME};"]


def layers(net: NetSpec, names: list[str], count: int, stack: int = 1) -> Iterator[str]:
    """GLSL after which `names`, the inputs as vec4s, are the vec4s that leave layer `count`.

    Of a `stack` of nets the images stand one below the other, and `spelling.CHOSEN` says which is meant.
    """
    sizes = [len(names), *(len(form.padded(net, layer)[1]) // 4 for layer in range(count))]
    yield f"int one = min(textureSize({NAME}, 0).x, 1);"
    yield f"vec4 x0[{sizes[0]}];"
    # without these zeros llvmpipe takes ten times as long to compile a wide net with grids
    yield f"for (int i = 0; i < {sizes[0]} * one; ++i) x0[i] = vec4(0.0);"
    for i, group in enumerate(names):
        yield f"x0[{i}] = {group};"
    first = 0
    if stack > 1:
        yield f"int top = {CHOSEN} * {sum(len(form.rows(net, layer)) for layer in range(len(net.weights)))};"
    top = "top + " if stack > 1 else ""
    for layer in range(count):
        yield f"vec4 x{layer + 1}[{sizes[layer + 1]}];"
        yield f"for (int o = 0; o < {sizes[layer + 1]} * one; ++o) {{"
        yield f"  vec4 sum = texelFetch({NAME}, ivec2(0, {top}o + {first}), 0);"
        yield f"  for (int i = 0; i < {sizes[layer]} * one; ++i) {{"
        for axis, letter in enumerate("xyzw"):
            weight = f"texelFetch({NAME}, ivec2(4 * i + {axis + 1}, {top}o + {first}), 0)"
            yield f"    sum += {weight} * x{layer}[i].{letter};"
        yield "  }"
        yield f"  x{layer + 1}[o] = {bent(net, layer, 'sum')};"
        yield "}"
        first += sizes[layer + 1]
    names[:] = [f"x{count}[{i}]" for i in range(sizes[-1])]
