"""Compiled loops that trace packets of rays through Embree. The NumPy twins are in tracer.py.

Compiled on first use and cached on disk beside this file; that is why Embree's function comes in as an address and
not as a global. No fast-math: directions must round exactly as NumPy rounds them, so that both twins trace the same
rays.

A packet of W rays is Embree's RTCRayW, twelve rows of W: origin x y z, tnear, direction x y z, time, tfar, mask, id,
flags. Occlusion writes tfar = -inf where something was hit, and nothing else. For closest hits RTCHitW follows: normal
x y z, u, v, face, geometry, instance; a face is valid where geometry is not -1, and then tfar is the distance.
"""

from functools import lru_cache

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

FAR = np.float32(1e37)  # what embreex uses
TFAR, NORMAL, U, V, FACE, GEOMETRY = 8, 12, 15, 16, 17, 18
LANES = 8  # SH rows are summed in blocks of this many, so that the inner loop has a fixed length


@intrinsic
def call_query(typing_context, function, valid, scene, rays, options):
    """void rtcOccludedW or rtcIntersectW(const int* valid, RTCScene, RTCRayW*, RTC...Arguments*) at an address."""
    signature = types.void(types.int64, types.int64, types.int64, types.int64, types.int64)

    def generate(context, builder, signature, arguments):
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [word] * 4)
        pointer = builder.inttoptr(arguments[0], kind.as_pointer())
        builder.call(pointer, arguments[1:])
        return context.get_dummy_value()

    return signature, generate


def packet(width: int) -> tuple[np.ndarray, np.ndarray]:
    """A ray packet and its mask (all rays on), aligned as Embree wants them."""
    # 24 rows: RTCRayHitW has 20, or more where Embree was built for nested instances
    rays, valid = _aligned(24 * width).reshape(24, width), _aligned(width).view(np.int32)
    rays.view(np.int32)[9] = -1
    valid[:] = -1
    return rays, valid


def _aligned(size: int) -> np.ndarray:
    raw = np.zeros(size + 16, np.float32)
    start = (-raw.ctypes.data % 64) // 4
    return raw[start : start + size]


@lru_cache(maxsize=3)
def gather_kernel(width: int):
    """The kernel that sums SH rows over the free directions of each point, for packets of `width` rays."""

    @njit(nogil=True, cache=True)
    def gather(
        function, scene, options, rays, valid, origins, frames, turns,
        directions, rows, sums, flip_row, flip_column, flip_value, bands, out,
    ):  # fmt: skip
        blocks = rows.shape[1]
        valid_address, rays_address = valid.ctypes.data, rays.ctypes.data
        total, work = np.empty((blocks, LANES)), np.empty(blocks * LANES)
        for i in range(origins.shape[0]):
            total[:] = 0
            for axis in range(3):
                rays[axis, :] = origins[i, axis]
            for j in range(directions.shape[0]):
                aim(width, frames[i], directions[j], rays)
                call_query(function, valid_address, scene, rays_address, options)  # pyright: ignore[reportCallIssue]
                free = 0
                for q in range(width):
                    free += rays[TFAR, q] > 0
                if free == width:
                    for b in range(blocks):
                        for k in range(LANES):
                            total[b, k] += sums[j, b, k]
                elif free > 0:
                    for q in range(width):
                        if rays[TFAR, q] > 0:
                            for b in range(blocks):
                                for k in range(LANES):
                                    total[b, k] += rows[j * width + q, b, k]
            to_world(total.ravel(), work, turns[i], flip_row, flip_column, flip_value, bands, out[i])

    return gather


@njit(nogil=True, cache=True, inline="always")
def aim(width, frame, local, rays):
    """Points a packet along local directions "3 w" in a frame, in the order of operations of its NumPy twin."""
    ax, ay, az = frame[0, 0], frame[1, 0], frame[2, 0]
    bx, by, bz = frame[0, 1], frame[1, 1], frame[2, 1]
    nx, ny, nz = frame[0, 2], frame[1, 2], frame[2, 2]
    for q in range(width):
        x, y, z = local[0, q], local[1, q], local[2, q]
        rays[4, q] = x * ax + y * bx + z * nx
        rays[5, q] = x * ay + y * by + z * ny
        rays[6, q] = x * az + y * bz + z * nz
        rays[TFAR, q] = FAR


@njit(nogil=True, cache=True)
def to_world(local, work, turn, row, column, value, bands, out):
    """Coefficients in a local frame R = Rz(a) Ry(b) Rz(c) to world axes; `turn` holds cos, sin of c, b, a.

    Ry is a turn about z between two fixed quarter turns, given by their entries other than zero, so every step is
    orthogonal at any number of bands.
    """
    turn_z(local, turn[0], turn[1], bands)
    multiply(column, row, value, local, work)
    turn_z(work, turn[2], turn[3], bands)
    multiply(row, column, value, work, local)
    turn_z(local, turn[4], turn[5], bands)
    for k in range(bands * bands):
        out[k] = local[k]


@njit(nogil=True, cache=True)
def turn_z(c, cosine, sine, bands):
    """Turns coefficients about z in place: Y_l,m and Y_l,-m mix by the angle m a."""
    cm, sm = 1.0, 0.0
    for m in range(1, bands):
        cm, sm = cm * cosine - sm * sine, sm * cosine + cm * sine
        for l in range(m, bands):
            p, q = l * l + l + m, l * l + l - m
            c[p], c[q] = cm * c[p] - sm * c[q], sm * c[p] + cm * c[q]


@njit(nogil=True, cache=True)
def multiply(row, column, value, c, out):
    """out = M c for a sparse M."""
    out[:] = 0
    for e in range(len(value)):
        out[row[e]] += value[e] * c[column[e]]


@njit(nogil=True, cache=True, inline="always")
def fill(width, first, origins, directions, rays):
    """Puts the rays of a list from `first` on into a packet; the last ray fills up what is left of it."""
    for q in range(width):
        i = min(first + q, origins.shape[0] - 1)
        for axis in range(3):
            rays[axis, q] = origins[i, axis]
            rays[4 + axis, q] = directions[i, axis]
        rays[TFAR, q] = FAR


@lru_cache(maxsize=3)
def occluded_kernel(width: int):
    """The kernel that answers a list of rays, in packets of `width`."""

    @njit(nogil=True, cache=True)
    def occluded(function, scene, options, rays, valid, origins, directions, out):
        count = origins.shape[0]
        for first in range(0, count, width):
            fill(width, first, origins, directions, rays)
            call_query(function, valid.ctypes.data, scene, rays.ctypes.data, options)  # pyright: ignore[reportCallIssue]
            for q in range(min(width, count - first)):
                out[first + q] = rays[TFAR, q] < 0

    return occluded


@lru_cache(maxsize=3)
def closest_kernel(width: int):
    """The kernel that finds what a list of rays hits first: face (-1: nothing), barycentric u and v, distance."""

    @njit(nogil=True, cache=True)
    def closest(function, scene, options, rays, valid, origins, directions, face, where, distance):
        count, words = origins.shape[0], rays.view(np.int32)
        for first in range(0, count, width):
            fill(width, first, origins, directions, rays)
            words[GEOMETRY, :] = -1
            call_query(function, valid.ctypes.data, scene, rays.ctypes.data, options)  # pyright: ignore[reportCallIssue]
            for q in range(min(width, count - first)):
                hit = words[GEOMETRY, q] != -1
                face[first + q] = words[FACE, q] if hit else -1
                where[first + q, 0], where[first + q, 1] = rays[U, q], rays[V, q]
                distance[first + q] = rays[TFAR, q] if hit else np.inf

    return closest


@lru_cache(maxsize=3)
def bounce_kernel(width: int):
    """The kernel that sums what the surfaces that a point sees send back, weighted by direction.

    Every direction has a row: with its weight alone the sum is irradiance, with its weighted SH it is the SH of
    incoming radiance times the cosine, in the point's own frame.
    """

    @njit(nogil=True, cache=True)
    def bounce(
        function, scene, options, rays, valid, origins, frames, directions,
        corners, behind, place, texels, values, rows, out,
    ):  # fmt: skip
        words, channels, harmonics = rays.view(np.int32), values.shape[1], rows.shape[1]
        total = np.empty(channels * harmonics)
        for i in range(origins.shape[0]):
            total[:] = 0
            for axis in range(3):
                rays[axis, :] = origins[i, axis]
            for j in range(directions.shape[0]):
                aim(width, frames[i], directions[j], rays)
                words[GEOMETRY, :] = -1
                call_query(function, valid.ctypes.data, scene, rays.ctypes.data, options)  # pyright: ignore[reportCallIssue]
                for q in range(width):
                    if words[GEOMETRY, q] == -1:
                        continue
                    facing = rays[4, q] * rays[NORMAL, q] + rays[5, q] * rays[NORMAL + 1, q]
                    facing += rays[6, q] * rays[NORMAL + 2, q]
                    texel = look_up(words[FACE, q], facing < 0, rays[U, q], rays[V, q], corners, behind, place, texels)
                    if texel < 0:
                        continue
                    ray = j * width + q
                    if harmonics == 1:
                        for c in range(channels):
                            total[c] += rows[ray, 0] * values[texel, c]
                    else:
                        for c in range(channels):
                            for k in range(harmonics):
                                total[c * harmonics + k] += values[texel, c] * rows[ray, k]
            out[i] = total

    return bounce


@njit(nogil=True, cache=True, inline="always")
def look_up(face, front, u, v, corners, behind, place, texels):
    """The row of values at a point of a face, seen from its front or back; -1 where nothing is kept."""
    side = face if front else behind[face]
    if side < 0:
        return -1
    size, start = place[side, 0], place[side, 1]
    w = np.float32(1) - u - v
    x = w * corners[side, 0, 0] + u * corners[side, 1, 0] + v * corners[side, 2, 0]
    y = w * corners[side, 0, 1] + u * corners[side, 1, 1] + v * corners[side, 2, 1]
    column = min(max(int(x * size), 0), size - 1)
    row = size - 1 - min(max(int(y * size), 0), size - 1)
    return texels[start + row * size + column]
