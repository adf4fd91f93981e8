"""Compiled loops that walk rays through a field, 16 at a time. The plain twin is `march.walked`.

They are compiled once for all fields, whose distance they call by its address (`compiled`).
"""

from math import inf

import numpy as np
from llvmlite import ir
from numba import carray, cfunc, njit, types
from numba.extending import intrinsic

from prtnet.data.implicit.compiled import LANES
from prtnet.data.kernels import LANES as BLOCK
from prtnet.data.kernels import to_world

FREE, HIT, LOST = 0, 1, 2  # how rays end; LOST: by their number of steps
POINTS = 8  # whose rays are walked together, so that no lane idles at the end of a point
TINY, INFINITE = np.float32(1e-9), np.float32(inf)
ZERO, HALF, ONE, TWO = np.float32(0), np.float32(0.5), np.float32(1), np.float32(2)
FREE_NOW, HIT_NOW, LOST_NOW = np.float32(1 + FREE), np.float32(1 + HIT), np.float32(1 + LOST)
STEEPEST = np.float32(0.95)  # slope along a ray above which it is not believed to leave any faster


@intrinsic
def call_lanes(typing_context, function, packet, count):
    """void lanes(float* packet, int64 count) at an address."""
    signature = types.void(types.int64, types.int64, types.int64)

    def generate(context, builder, signature, arguments):
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [word, word])
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    return signature, generate


@njit(nogil=True, cache=True)
def distances(function, points, out):
    """The field at a list of points, float32."""
    packet = np.zeros((4, LANES), np.float32)
    count = points.shape[0]
    for first in range(0, count, LANES):
        for q in range(LANES):
            i = min(first + q, count - 1)
            for axis in range(3):
                packet[axis, q] = points[i, axis]
        call_lanes(function, packet.ctypes.data, LANES)  # pyright: ignore[reportCallIssue]
        for q in range(min(LANES, count - first)):
            out[first + q] = packet[3, q]


# Rows of what is known of the rays in flight. Spheres about points of a ray are free; those from its start on meet each
# other up to BEFORE + RADIUS, and about FAR (inf: none) is one beyond that does not meet them yet. The last rows hold
# settings, the same in all lanes; DONE is 1 + how a ray ended, or 0.
POINT, DISTANCE, ORIGIN, DIRECTION, AT, BEFORE, RADIUS, FAR, FAR_RADIUS = 0, 3, 4, 7, 10, 11, 12, 13, 14
END, STEPS, DONE, SCALE, EPSILON, MOST, ANY, ROWS = 15, 16, 17, 18, 19, 20, 21, 22


@njit(nogil=True, cache=True)
def walk(function, low, high, settings, origins, radii, normals, directions, any_hit, ends, lengths):
    """Sphere tracing (Hart 1996) of rays, `directions` "n m 3" from `origins` "n 3": how each ends, and where it hit.

    `function`: the addresses of a field's loop and of `advance`. `settings`: 1 / lipschitz, epsilon, steps. `radii` are
    the distances at the origins, `normals` unit vectors along which they grow, or 0. Returns the number of distances
    that were evaluated.

    Steps are longer than the distance: so long that the next sphere touches the last one if the distance goes on as it
    went between the last two points (Balint and Valasek 2018, *Accelerating Sphere Tracing*). Where the spheres do not
    meet (Keinert et al. 2014, *Enhanced Sphere Tracing*), the ray looks into the middle of the gap and keeps what it
    found beyond. So a free ray is covered by free spheres. With `any_hit` a point inside ends the ray wherever it is.
    """
    many = directions.shape[1]
    total = origins.shape[0] * many
    state, ray = np.zeros((ROWS, LANES), np.float32), np.full(LANES, -1, np.int64)
    state[DONE] = 1 + FREE
    state[SCALE], state[EPSILON], state[MOST], state[ANY] = settings[0], settings[1], settings[2], any_hit
    i, taken, flying, evaluations = 0, 0, 0, 0
    while True:
        for q in range(LANES):
            if state[DONE, q] == 0:
                continue
            if ray[q] >= 0:
                hit = state[DONE, q] == HIT_NOW
                ends[ray[q]], lengths[ray[q]] = np.uint8(state[DONE, q] - ONE), state[AT, q] if hit else INFINITE
                ray[q] = -1
                flying -= 1
            while ray[q] < 0 and taken < total:
                if taken - i * many >= many:
                    i += 1
                end = begin(origins, directions, normals, radii, i, taken - i * many, low, high, state, q)
                if end == 0:
                    ray[q] = taken
                    flying += 1
                else:
                    ends[taken], lengths[taken] = end - 1, ZERO if end == 1 + HIT else INFINITE
                taken += 1
        if flying == 0:
            return evaluations
        call_lanes(function[0], state.ctypes.data, LANES)  # pyright: ignore[reportCallIssue]
        call_lanes(function[1], state.ctypes.data, LANES)  # pyright: ignore[reportCallIssue]
        evaluations += LANES


@njit(nogil=True, cache=True, forceinline=True, error_model="numpy")
def begin(origins, directions, normals, radii, i, j, low, high, state, q):
    """Puts a ray into a lane and returns 0; or 1 + how it ends if it does so at once."""
    enter, leave = ZERO, INFINITE
    slope, radius = ZERO, radii[i] * state[SCALE, q]
    for axis in range(3):
        start, step = origins[i, axis], directions[i, j, axis]
        slope += normals[i, axis] * step * state[SCALE, q]
        if step == 0:
            leave = leave if low[axis] <= start <= high[axis] else -ONE
        else:
            inverse = ONE / step
            a, b = (low[axis] - start) * inverse, (high[axis] - start) * inverse
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    if leave < enter:
        return 1 + FREE
    if enter == 0 and radius < state[EPSILON, q]:
        return 1 + HIT
    radius = radius if enter == 0 else ZERO
    at = min(enter + stride(radius, slope), leave)
    for axis in range(3):
        start, step = origins[i, axis], directions[i, j, axis]
        state[ORIGIN + axis, q], state[DIRECTION + axis, q], state[POINT + axis, q] = start, step, start + at * step
    state[AT, q], state[BEFORE, q], state[RADIUS, q], state[END, q] = at, enter, radius, leave
    state[FAR, q], state[FAR_RADIUS, q], state[STEPS, q], state[DONE, q] = INFINITE, ZERO, ZERO, ZERO
    return 0


@njit(nogil=True, cache=True, forceinline=True, error_model="numpy")
def stride(radius, slope):
    """To where a sphere touches one of this radius, if the radius grows along the ray as it did."""
    return TWO * radius / (ONE - (slope if slope < STEEPEST else STEEPEST))


@cfunc(types.void(types.CPointer(types.float32), types.int64), cache=True, error_model="numpy", fastmath={"nsz"})
def advance(packet, count):
    """One step of all rays in flight, by the distances at their points."""
    state = carray(packet, (ROWS, LANES))
    for q in range(count):
        at, before, last, epsilon = state[AT, q], state[BEFORE, q], state[RADIUS, q], state[EPSILON, q]
        far, beyond = state[FAR, q], state[FAR_RADIUS, q]
        radius = state[DISTANCE, q] * state[SCALE, q]
        free = radius if radius > ZERO else ZERO
        gap = at - before
        meets = gap <= last + free + epsilon
        # the sphere beyond, once this one meets it
        joins = meets & (at + free >= far - beyond)
        rise, run = (beyond - radius, far - at) if joins else (radius - last, gap)
        slope = rise / (run if run > TINY else TINY)
        reached = far if joins else (at if meets else before)
        within = beyond if joins else (free if meets else last)
        far = INFINITE if joins else (far if meets else at)
        beyond = beyond if meets else free
        middle = HALF * (reached + within + far - beyond)
        onward = reached + stride(within, slope)
        onward = onward if meets & (onward < middle) else middle
        onward = onward if onward < state[END, q] else state[END, q]
        steps = state[STEPS, q] + ONE
        hit = (radius < epsilon) & (meets | (state[ANY, q] > ZERO))
        done = LOST_NOW if steps >= state[MOST, q] else ZERO
        done = FREE_NOW if reached + within >= state[END, q] else done
        done = HIT_NOW if hit else done
        state[DONE, q] = done if state[DONE, q] == ZERO else state[DONE, q]
        state[BEFORE, q] = reached
        state[RADIUS, q] = within
        state[FAR, q] = far
        state[FAR_RADIUS, q] = beyond
        state[STEPS, q] = steps
        onward = at if hit else onward
        state[AT, q] = onward
        state[POINT, q] = state[ORIGIN, q] + onward * state[DIRECTION, q]
        state[POINT + 1, q] = state[ORIGIN + 1, q] + onward * state[DIRECTION + 1, q]
        state[POINT + 2, q] = state[ORIGIN + 2, q] + onward * state[DIRECTION + 2, q]


@njit(nogil=True, cache=True)
def gather(
    function, low, high, settings, origins, radii, frames, turns, directions, rows, sums,
    flip_row, flip_column, flip_value, bands, counts, out,
):  # fmt: skip
    """Sums rows over the free directions of each point, turned to the world. `counts`: rays lost, steps walked."""
    many, blocks = directions.shape[0], rows.shape[1]
    world, ends = np.empty((POINTS, many, 3), np.float32), np.empty((POINTS, many), np.uint8)
    lengths = np.empty((POINTS, many), np.float32)
    total, work = np.empty((blocks, BLOCK)), np.empty(blocks * BLOCK)
    for first in range(0, origins.shape[0], POINTS):
        last = min(first + POINTS, origins.shape[0])
        for i in range(first, last):
            frame = frames[i]
            for j in range(many):
                x, y, z = directions[j, 0], directions[j, 1], directions[j, 2]
                for axis in range(3):
                    world[i - first, j, axis] = x * frame[axis, 0] + y * frame[axis, 1] + z * frame[axis, 2]
        block = slice(first, last)
        normals = np.ascontiguousarray(frames[block, :, 2])
        counts[1] += walk(
            function, low, high, settings, origins[block], radii[block], normals, world[: last - first], True,
            ends.ravel(), lengths.ravel(),
        )  # fmt: skip
        for i in range(last - first):
            total[:] = 0
            for j in range(0, many, LANES):
                free = 0
                for q in range(LANES):
                    free += ends[i, j + q] == FREE
                    counts[0] += ends[i, j + q] == LOST
                if free == LANES:
                    for b in range(blocks):
                        for k in range(BLOCK):
                            total[b, k] += sums[j // LANES, b, k]
                elif free > 0:
                    for q in range(j, j + LANES):
                        if ends[i, q] == FREE:
                            for b in range(blocks):
                                for k in range(BLOCK):
                                    total[b, k] += rows[q, b, k]
            to_world(total.ravel(), work, turns[first + i], flip_row, flip_column, flip_value, bands, out[first + i])
