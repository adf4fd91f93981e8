"""Hashed feature grids of a net in GLSL: the table of each in a 2D texture, its corners found by integer arithmetic.

Texels are read one by one and blended in float32, as those of dense grids are (`prtnet.export.grid`).
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from prtnet.encoding import PRIMES
from prtnet.export.spelling import CHOSEN, number, quads
from prtnet.netspec import NetSpec

Array = np.ndarray

ROW = 256  # texels of a row: every power of two entries from here on fills whole rows

_FETCH = f"""\
vec4 prt_entry(highp sampler2D table, uvec3 corner, uint mask, uint quads, uint quad) {{
  uint texel = ((corner.x ^ (corner.y * {PRIMES[1]}u) ^ (corner.z * {PRIMES[2]}u)) & mask) * quads + quad;
  return texelFetch(table, ivec2(int(texel % {ROW}u), int(texel / {ROW}u)), 0);
}}
vec4 prt_edge(highp sampler2D table, uvec3 low, float share, uint mask, uint quads, uint quad) {{
  vec4 first = prt_entry(table, low, mask, quads, quad);
  return mix(first, prt_entry(table, low + uvec3(1u, 0u, 0u), mask, quads, quad), share);
}}
vec4 prt_hash(highp sampler2D table, uvec3 low, vec3 share, uint mask, uint quads, uint quad) {{
  vec4 p = prt_edge(table, low, share.x, mask, quads, quad);
  vec4 q = prt_edge(table, low + uvec3(0u, 1u, 0u), share.x, mask, quads, quad);
  vec4 r = prt_edge(table, low + uvec3(0u, 0u, 1u), share.x, mask, quads, quad);
  vec4 s = prt_edge(table, low + uvec3(0u, 1u, 1u), share.x, mask, quads, quad);
  return mix(mix(p, q, share.y), mix(r, s, share.y), share.z);
}}"""


def name(index: int) -> str:
    """Of the sampler of a table."""
    return f"prt_hash{index}"


def texels(table: Float[Array, "entries c"]) -> Float[Array, "h w 4"]:
    """The image of a table: entry e has its channels in texels e c / 4 and on, in rows of `ROW`."""
    return np.ascontiguousarray(table.reshape(-1, ROW, 4))


def declarations(net: NetSpec) -> list[str]:
    """GLSL before `prt_transfer`: nothing where there are no tables."""
    lines = []
    for index, (cells, table) in enumerate(net.hashes):
        rows, bits = texels(table).shape[0], 8 * table.itemsize
        what = f"{table.shape[1]} channels for corners of {cells}^3 cells"
        lines += [f"// hash.{index} of the net's file, {what}: {ROW} x {rows} texels, RGBA{bits}F"]
        lines += [f"uniform highp sampler2D {name(index)};"]
    return [*lines, *_FETCH.split("\n")] if net.hashes else []


def statements(net: NetSpec, names: list[str], stack: int = 1) -> Iterator[str]:
    """GLSL after which `names` has the channels of all tables at `position`, the last of the net's inputs.

    Of a `stack` of nets the tables stand one below the other, and `spelling.CHOSEN` says which is meant.
    """
    for index, (cells, table) in enumerate(net.hashes):
        place, count = f"h{index}", quads(table.shape[1])
        # counted from the middle of the cube; below it, integers wrap around as those without a sign do
        yield f"vec3 {place} = {number(cells / 2)} * position;"
        yield f"uvec3 {place}l = uvec3(ivec3(floor({place})));"
        yield f"{place} -= floor({place});"
        for quad in range(count):
            found = f"{place}q{quad}"
            first = f" + {len(table) * count}u * uint({CHOSEN})" if stack > 1 else ""
            arguments = f"{name(index)}, {place}l, {place}, {len(table) - 1}u, {count}u, {quad}u{first}"
            yield f"vec4 {found} = prt_hash({arguments});"
            names += [f"{found}.{axis}" for axis in "xyzw"]
