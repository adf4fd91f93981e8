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
    """The kernel that finds the irradiance of a lamp of colour 1, in packets of `width` rays.

    `starts` are off the surface; `slots` is room for the index of each ray of a packet.
    """

    @njit(nogil=True, cache=True)
    def lit(
        function, scene, options, rays, valid, kind, place, aim, outer, inner,
        positions, normals, sides, starts, slots, out,
    ):  # fmt: skip
        filled = 0
        for i in range(positions.shape[0]):
            # to the lamp, from the point and from where its ray starts
            if kind == DIRECTIONAL:
                x, y, z, found = -aim[0], -aim[1], -aim[2], 1.0
            else:
                x, y, z = place[0] - positions[i, 0], place[1] - positions[i, 1], place[2] - positions[i, 2]
                found = 0.0
            out[i] = 0.0
            cosine = x * normals[i, 0] + y * normals[i, 1] + z * normals[i, 2]
            if cosine <= 0 or x * sides[i, 0] + y * sides[i, 1] + z * sides[i, 2] <= 0:
                continue
            if kind != DIRECTIONAL:
                distance = max(sqrt(x * x + y * y + z * z), 1e-9)
                x, y, z = x / distance, y / distance, z / distance
                cosine, found = cosine / distance, 1 / (distance * distance)
            if kind == SPOT:
                step = (-(x * aim[0] + y * aim[1] + z * aim[2]) - outer) / (inner - outer)
                step = min(max(step, 0.0), 1.0)
                found *= step * step * (3 - 2 * step)
            if found <= 0:
                continue
            out[i], slots[filled] = found * cosine, i
            put(kind == DIRECTIONAL, place, aim, starts[i, 0], starts[i, 1], starts[i, 2], rays, filled)
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
def put(distant, place, aim, x, y, z, rays, q):
    """Aims lane q of a packet from a start at the lamp, so long that it ends there."""
    rays[0, q], rays[1, q], rays[2, q], rays[3, q] = x, y, z, 0
    if distant:
        rays[4, q], rays[5, q], rays[6, q], rays[TFAR, q] = -aim[0], -aim[1], -aim[2], FAR
    else:
        dx, dy, dz = place[0] - x, place[1] - y, place[2] - z
        length = max(sqrt(dx * dx + dy * dy + dz * dz), 1e-9)
        rays[4, q], rays[5, q], rays[6, q], rays[TFAR, q] = dx / length, dy / length, dz / length, length


@njit(nogil=True, cache=True, inline="always")
def query(function, scene, options, rays, valid, filled, slots, out):
    """Traces a packet, and takes the light from points whose ray met something."""
    call_query(function, valid.ctypes.data, scene, rays.ctypes.data, options)  # pyright: ignore[reportCallIssue]
    for q in range(filled):
        if rays[TFAR, q] < 0:
            out[slots[q]] = 0.0
