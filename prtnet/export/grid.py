"""Feature grids of a net in GLSL: a 3D texture each, read texel by texel and blended in float32.

The filter of graphics cards blends in steps of 1/256, which is too coarse for a net to be the net that was trained. All
channels of a grid are in one RGBA texture: four in each block of slices, the blocks one behind the other.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from prtnet.export.spelling import CHOSEN, quads, vector
from prtnet.netspec import NetSpec

Array = np.ndarray

# corners in the order x, y, z; `slices` leads to the block of four channels
_FETCH = """\
vec4 prt_fetch(highp sampler3D grid, ivec3 low, ivec3 high, vec3 share, int slices) {
  ivec3 a = low + ivec3(0, 0, slices), b = high + ivec3(0, 0, slices);
  vec4 p = mix(texelFetch(grid, a, 0), texelFetch(grid, ivec3(b.x, a.y, a.z), 0), share.x);
  vec4 q = mix(texelFetch(grid, ivec3(a.x, b.y, a.z), 0), texelFetch(grid, ivec3(b.x, b.y, a.z), 0), share.x);
  vec4 r = mix(texelFetch(grid, ivec3(a.x, a.y, b.z), 0), texelFetch(grid, ivec3(b.x, a.y, b.z), 0), share.x);
  vec4 s = mix(texelFetch(grid, ivec3(a.x, b.y, b.z), 0), texelFetch(grid, b, 0), share.x);
  return mix(mix(p, q, share.y), mix(r, s, share.y), share.z);
}"""


def name(index: int) -> str:
    """Of the sampler of a grid."""
    return f"prt_grid{index}"


def texels(grid: Float[Array, "z y x c"]) -> Float[Array, "d y x 4"]:
    """The image of a grid's 3D texture: slice q * z + i has channels 4 q to 4 q + 3 of slice i."""
    z, y, x, channels = grid.shape
    blocks = grid.reshape(z, y, x, quads(channels), 4)
    return np.ascontiguousarray(np.moveaxis(blocks, 3, 0).reshape(-1, y, x, 4))


def declarations(net: NetSpec) -> list[str]:
    """GLSL before `prt_transfer`: nothing where there are no grids."""
    lines = []
    for index, grid in enumerate(net.grids):
        depth, y, x, _ = texels(grid).shape
        bits = 8 * grid.itemsize
        lines += [
            f"// grid.{index} of the net's file, {grid.shape[3]} channels: {x} x {y} x {depth} texels, RGBA{bits}F"
        ]
        lines += [f"uniform highp sampler3D {name(index)};"]
    return [*lines, *_FETCH.split("\n")] if net.grids else []


def statements(net: NetSpec, names: list[str], stack: int = 1) -> Iterator[str]:
    """GLSL after which `names` has the channels of all grids at `position`, the net's inputs that follow the normal.

    Of a `stack` of nets the grids stand one behind the other, and `spelling.CHOSEN` says which is meant.
    """
    for index, grid in enumerate(net.grids):
        z, channels = grid.shape[0], grid.shape[3]
        sizes = np.array(grid.shape[2::-1])
        # cells count from the middle one: there float32 has the most digits to say where in a cell a point is
        middle = sizes // 2
        place, low = f"g{index}", f"g{index}l"
        first = f"{CHOSEN} * {z} + " if stack > 1 else ""
        shift, least, most = (
            vector("vec3", v.astype(float)) for v in (sizes % 2 / 2 - 0.5, -middle, sizes - 1 - middle)
        )
        yield f"vec3 {place} = clamp({vector('vec3', sizes / 2)} * position + {shift}, {least}, {most});"
        yield f"ivec3 {low} = ivec3(floor({place})) + {_integers(middle)};"
        yield f"ivec3 {place}h = min({low} + 1, {_integers(sizes - 1)});"
        yield f"{place} -= floor({place});"
        for quad in range(quads(channels)):
            found = f"{place}q{quad}"
            yield f"vec4 {found} = prt_fetch({name(index)}, {low}, {place}h, {place}, {first}{quad * stack * z});"
            names += [f"{found}.{axis}" for axis in "xyzw"]


def _integers(values: Int[Array, " 3"]) -> str:
    return f"ivec3({', '.join(str(value) for value in values)})"
