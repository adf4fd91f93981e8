"""Arrays of a scene packed small for a web page: the mesh in 16 bits, textures in 8, all as gzip of differences.

A block is the bytes of an integer array, column by column; `delta` blocks hold differences of neighbours (modulo the
type's range), and every column stands as its low bytes, then the next ones: like bytes beside like bytes compress best.
web/unpack.js is the inverse that a page runs; those here are for tests.
"""

import base64
import gzip
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Integer, Num, UInt8

from prtnet import PrtnetError

Array = np.ndarray
KINDS = ("uint8", "uint16", "uint32")
TOP = 65535


@dataclass(frozen=True, eq=False)
class Block:
    """A packed array. `data` is gzip; the same array gives the same bytes."""

    data: bytes
    kind: str
    shape: tuple[int, int]
    delta: bool

    def about(self) -> dict[str, Any]:
        """What a reader must know beside the bytes, as JSON."""
        return {"kind": self.kind, "shape": list(self.shape), "delta": self.delta}

    def text(self) -> str:
        """base64 of the bytes."""
        return base64.b64encode(self.data).decode("ascii")


def pack(values: Num[Array, "n c"], *, delta: bool = False) -> Block:
    """An array of unsigned integers of 8, 16 or 32 bits. Inverse: `unpack`."""
    kind = values.dtype.name
    if kind not in KINDS:
        raise PrtnetError(f"packing: found {kind}, expected one of {', '.join(KINDS)}")
    columns = np.ascontiguousarray(values.T)
    if delta:
        # wraps around, and so does the sum that undoes it
        columns = np.diff(columns, axis=1, prepend=columns[:, :1] * 0)
    planes = np.moveaxis(np.ascontiguousarray(columns).view(np.uint8).reshape(*columns.shape, -1), 2, 1)
    return Block(gzip.compress(planes.tobytes(), 9, mtime=0), kind, (values.shape[0], values.shape[1]), delta)


def unpack(block: Block) -> Integer[Array, "n c"]:
    """Inverse of `pack`."""
    rows, count = block.shape
    kind = np.dtype(block.kind)
    planes = np.frombuffer(gzip.decompress(block.data), np.uint8).reshape(count, kind.itemsize, rows)
    columns = np.ascontiguousarray(np.moveaxis(planes, 1, 2)).view(kind).reshape(count, rows)
    return (np.cumsum(columns, axis=1, dtype=kind) if block.delta else columns).T


def pack_text(text: str) -> Block:
    """Text as UTF-8."""
    return pack(np.frombuffer(text.encode(), np.uint8)[:, None])


def pack_floats(values: Float[Array, "..."]) -> Block:
    """The bits of float16 or float32 numbers, in one column, exact."""
    bits = np.ascontiguousarray(values).view(np.uint16 if values.itemsize == 2 else np.uint32)
    return pack(bits.reshape(-1, 1))


@dataclass(frozen=True, eq=False)
class Box:
    """What positions are rounded within: 65536 steps along each side."""

    low: Float32[Array, " 3"]
    span: Float32[Array, " 3"]


def box_of(positions: Float[Array, "v 3"]) -> Box:
    """The box of unit positions; no side is flat."""
    low, high = positions.min(axis=0).astype(np.float32), positions.max(axis=0).astype(np.float32)
    return Box(low, np.maximum(high - low, np.float32(1e-6)))


def to_steps(positions: Float[Array, "v 3"], box: Box) -> Integer[Array, "v 3"]:
    """Positions as steps of their box, off by half a step at most. Inverse: `from_steps`."""
    return np.rint(np.clip((positions - box.low) / box.span, 0, 1) * TOP).astype(np.uint16)


def from_steps(steps: Integer[Array, "v 3"], box: Box) -> Float32[Array, "v 3"]:
    """Inverse of `to_steps`, as the vertex shader does it in float32."""
    return steps.astype(np.float32) / np.float32(TOP) * box.span + box.low


def to_octahedron(normals: Float[Array, "v 3"]) -> Integer[Array, "v 2"]:
    """Unit normals on the unfolded octahedron, 16 bits each way, off by 0.003 degrees at most.

    Meyer et al. 2010, *On Floating-Point Normal Vectors*. Inverse: `from_octahedron`.
    """
    n = np.asarray(normals, np.float64)
    flat = n / np.abs(n).sum(axis=1, keepdims=True)
    folded = (1 - np.abs(flat[:, 1::-1])) * np.where(flat[:, :2] >= 0, 1, -1)
    place = np.where(flat[:, 2:] < 0, folded, flat[:, :2])
    return np.rint((place / 2 + 0.5) * TOP).astype(np.uint16)


def from_octahedron(places: Integer[Array, "v 2"]) -> Float32[Array, "v 3"]:
    """Inverse of `to_octahedron`, as the vertex shader does it."""
    place = places.astype(np.float32) / np.float32(TOP) * 2 - 1
    z = 1 - np.abs(place).sum(axis=1, keepdims=True)
    away = np.maximum(-z, 0)
    found = np.concatenate([place - np.where(place >= 0, away, -away), z], axis=1)
    return (found / np.linalg.norm(found, axis=1, keepdims=True)).astype(np.float32)


def predicted(image: UInt8[Array, "h w k"], used: Bool[Array, "h w"]) -> UInt8[Array, "n k"]:
    """The used texels, row by row, each less the mean of its used neighbours to the left and above (128 where there
    are none), rounded down, modulo 256. Inverse: `unpredicted`."""
    wide = image.astype(np.int32)
    sums = np.zeros_like(wide)
    counts = np.zeros(used.shape, np.int32)
    for target, source in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
        sums[target] += wide[source] * used[source][..., None]
        counts[target] += used[source]
    guess = np.where(counts[..., None] > 0, sums // np.maximum(counts, 1)[..., None], 128)
    return ((wide - guess)[used] & 255).astype(np.uint8)


def unpredicted(rest: UInt8[Array, "n k"], used: Bool[Array, "h w"]) -> UInt8[Array, "h w k"]:
    """Inverse of `predicted`; 0 where a texel is not used. The plain twin of the page's."""
    image = np.zeros((*used.shape, rest.shape[1]), np.int32)
    for (row, column), value in zip(np.argwhere(used), rest.astype(np.int32), strict=True):
        near = [(row, column - 1)] if column and used[row, column - 1] else []
        near += [(row - 1, column)] if row and used[row - 1, column] else []
        guess = sum(image[place] for place in near) // len(near) if near else 128
        image[row, column] = (value + guess) & 255
    return image.astype(np.uint8)


def sizes(blocks: Mapping[str, Block]) -> dict[str, int]:
    """Bytes of each block in a page."""
    return {name: -(-len(block.data) // 3) * 4 for name, block in blocks.items()}
