"""Texel features of a net in GLSL: an image over the atlas as a 2D texture, read texel by texel and blended in float32.

As for grids, the filter of graphics cards is too coarse (`prtnet.export.grid`). All channels are in one RGBA texture:
the vectors of four that one texel of the image has stand side by side.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from prtnet.export.spelling import number, quads, vector
from prtnet.netspec import NetSpec

Array = np.ndarray

STEPS = 4096  # of a coordinate: whole ones times as many texels are exact in float32, and what is left is small

# corners in the order x, y; an x counts vectors
_FETCH = """\
vec4 prt_texel(highp sampler2D texels, ivec2 low, ivec2 high, vec2 share) {
  vec4 p = mix(texelFetch(texels, low, 0), texelFetch(texels, ivec2(high.x, low.y), 0), share.x);
  vec4 q = mix(texelFetch(texels, ivec2(low.x, high.y), 0), texelFetch(texels, high, 0), share.x);
  return mix(p, q, share.y);
}"""


def name(index: int) -> str:
    """Of the sampler of an image."""
    return f"prt_texels{index}"


def texels(image: Float[Array, "y x c"]) -> Float[Array, "y w 4"]:
    """The image of the texture, row 0 at v = 0: channels 4 q to 4 q + 3 of column x are in column x c / 4 + q."""
    return np.ascontiguousarray(image[::-1].reshape(image.shape[0], -1, 4))


def declarations(net: NetSpec) -> list[str]:
    """GLSL before `prt_transfer`: nothing where there are no texels."""
    if not net.texels:
        return []
    lines = ["// uv: the point's place in the atlas that the net was trained with, in [0, 1]^2, v up"]
    for index, image in enumerate(net.texels):
        y, x, channels = image.shape
        what = f"{channels} channels at {x} x {y} places of the atlas: {x * quads(channels)} x {y} texels"
        lines += [f"// texels.{index} of the net's file, {what}, RGBA{8 * image.itemsize}F"]
        lines += [f"uniform highp sampler2D {name(index)};"]
    return [*lines, *_FETCH.split("\n")]


def statements(net: NetSpec, names: list[str]) -> Iterator[str]:
    """GLSL after which `names` has the channels of all images at `uv`, the last of the net's inputs."""
    for index, image in enumerate(net.texels):
        y, x, channels = image.shape
        count, place, low, high = quads(channels), f"u{index}", f"u{index}l", f"u{index}h"
        sizes, last = vector("vec2", np.array([x, y], float)), f"ivec2({x - 1}, {y - 1})"
        # whole texels and shares apart, or a share would lose the digits that the number of the texel takes
        yield f"vec2 {place}s = floor({number(STEPS)} * clamp(uv, 0.0, 1.0)) * {number(1 / STEPS)};"
        yield f"vec2 {place}t = {sizes} * {place}s;"
        yield f"vec2 {place} = fract({place}t) - 0.5 + {sizes} * (clamp(uv, 0.0, 1.0) - {place}s);"
        yield f"ivec2 {low} = ivec2(floor({place}t)) + ivec2(floor({place}));"
        yield f"ivec2 {high} = min({low} + 1, {last});"
        yield f"{low} = max({low}, 0);"
        yield f"{place} -= floor({place});"
        for quad in range(count):
            found = f"{place}q{quad}"
            low_q, high_q = (_vector(corner, count, quad) for corner in (low, high))
            yield f"vec4 {found} = prt_texel({name(index)}, {low_q}, {high_q}, {place});"
            names += [f"{found}.{axis}" for axis in "xyzw"]


def _vector(corner: str, count: int, quad: int) -> str:
    """Where a texel of the image has its vector number `quad`."""
    return f"ivec2({corner}.x * {count} + {quad}, {corner}.y)"
