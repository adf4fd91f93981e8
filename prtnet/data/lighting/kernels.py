"""Compiled shadow rays: what one lamp sends to many points. The NumPy twin is in direct.py.

Rays that carry nothing (the lamp is behind the surface, or the point is outside of a spot's cone) are not traced; the
others fill packets of W as they come. Layout and calls of packets are those of `prtnet.data.kernels`.
"""

from functools import lru_cache
from math import sqrt

from numba import njit

from prtnet.data.kernels import FAR, TFAR, call_query

DIRECTIONAL, POINT, SPOT = 0, 1, 2


@lru_cache(maxsize=3)
def lamp_kernel(width: int):
    """The kernel that finds the irradiance of a lamp of colour 1, for packets of `width` rays.

    `starts` are float32 and off the surface; `away` is 1 for points that a ray of length 0 would not leave.
    """

    @njit(nogil=True, cache=True)
    def lit(
        function, scene, options, rays, valid, kind, place, aim, outer, inner,
        positions, normals, sides, starts, slots, out,
    ):  # fmt: skip
        filled = 0
        for i in range(positions.shape[0]):
            out[i] = strength(kind, place, aim, outer, inner, positions[i], normals[i], sides[i])
            if out[i] <= 0:
                continue
            put(kind, place, aim, starts[i], rays, filled)
            slots[filled] = i
            filled += 1
            if filled == width:
                query(function, scene, options, rays, valid, filled, slots, out)
                filled = 0
        if filled:
            for q in range(filled, width):
                rays[:, q] = rays[:, 0]
            query(function, scene, options, rays, valid, filled, slots, out)

    return lit


@njit(nogil=True, cache=True, inline="always")
def strength(kind, place, aim, outer, inner, position, normal, side):
    """Irradiance of a lamp of colour 1 where nothing is in the way; 0 from behind the surface."""
    if kind == DIRECTIONAL:
        x, y, z, found = -aim[0], -aim[1], -aim[2], 1.0
    else:
        x, y, z = place[0] - position[0], place[1] - position[1], place[2] - position[2]
        distance = max(sqrt(x * x + y * y + z * z), 1e-9)
        x, y, z = x / distance, y / distance, z / distance
        found = 1 / (distance * distance)
    cosine = x * normal[0] + y * normal[1] + z * normal[2]
    if cosine <= 0 or x * side[0] + y * side[1] + z * side[2] <= 0:
        return 0.0
    if kind == SPOT:
        step = (-(x * aim[0] + y * aim[1] + z * aim[2]) - outer) / (inner - outer)
        step = min(max(step, 0.0), 1.0)
        found *= step * step * (3 - 2 * step)
    return found * cosine


@njit(nogil=True, cache=True, inline="always")
def put(kind, place, aim, start, rays, q):
    """Aims lane q of a packet at the lamp, so long that it ends there."""
    if kind == DIRECTIONAL:
        x, y, z, length = -aim[0], -aim[1], -aim[2], float(FAR)
    else:
        x, y, z = place[0] - start[0], place[1] - start[1], place[2] - start[2]
        length = max(sqrt(x * x + y * y + z * z), 1e-9)
        x, y, z = x / length, y / length, z / length
    rays[0, q], rays[1, q], rays[2, q] = start[0], start[1], start[2]
    rays[3, q] = 0
    rays[4, q], rays[5, q], rays[6, q] = x, y, z
    rays[7, q] = 0
    rays[TFAR, q] = length


@njit(nogil=True, cache=True, inline="always")
def query(function, scene, options, rays, valid, filled, slots, out):
    """Traces a packet, and takes the light from points whose ray met something."""
    call_query(function, valid.ctypes.data, scene, rays.ctypes.data, options)  # pyright: ignore[reportCallIssue]
    for q in range(filled):
        if rays[TFAR, q] < 0:
            out[slots[q]] = 0.0
