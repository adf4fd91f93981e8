"""Compiled search for the triangle nearest to a point. The twin that tries all is in signed_distance.py.

A complete binary tree of boxes over the triangles in Morton order: node i has the children 2 i + 1 and 2 i + 2, and
leaf j of L holds the triangles n j / L up to n (j + 1) / L. A box whose distance is above the best one is passed over,
so the answer is exact.
"""

import math

import numpy as np
from numba import njit

from prtnet.data.samples import morton_order

LEAF = 4  # triangles in a leaf, at most
DEPTH = 64  # of the stack: each level leaves one node behind


def boxes_of(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The order in which triangles "f 3 3" stand in the leaves, and the boxes (low, high) of all nodes."""
    order = morton_order(corners.mean(axis=1))
    leaves = 1 << max(0, math.ceil(math.log2(len(corners) / LEAF)))
    ends = np.arange(leaves + 1) * len(corners) // leaves
    boxes = np.empty((2 * leaves - 1, 2, 3))
    bottom = boxes[leaves - 1 :]
    bottom[:, 0] = np.minimum.reduceat(corners[order].min(axis=1), ends[:-1])
    bottom[:, 1] = np.maximum.reduceat(corners[order].max(axis=1), ends[:-1])
    for node in range(leaves - 2, -1, -1):
        boxes[node, 0] = np.minimum(boxes[2 * node + 1, 0], boxes[2 * node + 2, 0])
        boxes[node, 1] = np.maximum(boxes[2 * node + 1, 1], boxes[2 * node + 2, 1])
    return order, boxes


@njit(nogil=True, cache=True)
def nearest(points, corners, boxes, face, where):
    """Index of the nearest of `corners` "f 3 3", in the order of the leaves, and the nearest point on it, per point."""
    leaves, count = (len(boxes) + 1) // 2, len(corners)
    stack, away = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    for i in range(len(points)):
        x, y, z = points[i]
        best, top = np.inf, 1
        stack[0], away[0] = 0, 0.0
        while top:
            top -= 1
            node = stack[top]
            if away[top] >= best:
                continue
            if node >= leaves - 1:
                leaf = node - leaves + 1
                for j in range(count * leaf // leaves, count * (leaf + 1) // leaves):
                    u, v, w = closest(x, y, z, corners[j])
                    squared = (u - x) ** 2 + (v - y) ** 2 + (w - z) ** 2
                    if squared < best:
                        best, face[i] = squared, j
                        where[i, 0], where[i, 1], where[i, 2] = u, v, w
                continue
            first, second = 2 * node + 1, 2 * node + 2
            near, far = box_squared(x, y, z, boxes[first]), box_squared(x, y, z, boxes[second])
            if far < near:
                first, second, near, far = second, first, far, near
            stack[top], away[top] = second, far
            stack[top + 1], away[top + 1] = first, near
            top += 2


@njit(nogil=True, cache=True, inline="always")
def box_squared(x, y, z, box):
    """Squared distance to a box, 0 within."""
    a = max(box[0, 0] - x, 0.0, x - box[1, 0])
    b = max(box[0, 1] - y, 0.0, y - box[1, 1])
    c = max(box[0, 2] - z, 0.0, z - box[1, 2])
    return a * a + b * b + c * c


@njit(nogil=True, cache=True)
def closest(x, y, z, triangle):
    """The point of a triangle nearest to (x, y, z): by the Voronoi regions of its corners and edges (Ericson 2005,
    *Real-Time Collision Detection*, 5.1.5)."""
    ax, ay, az = triangle[0]
    bx, by, bz = triangle[1, 0] - ax, triangle[1, 1] - ay, triangle[1, 2] - az
    cx, cy, cz = triangle[2, 0] - ax, triangle[2, 1] - ay, triangle[2, 2] - az
    px, py, pz = x - ax, y - ay, z - az
    bb, bc, cc = bx * bx + by * by + bz * bz, bx * cx + by * cy + bz * cz, cx * cx + cy * cy + cz * cz
    # of p with both edges, seen from each corner in turn
    d1, d2 = px * bx + py * by + pz * bz, px * cx + py * cy + pz * cz
    d3, d4 = d1 - bb, d2 - bc
    d5, d6 = d1 - bc, d2 - cc
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0 and d2 <= 0:
        s, t = 0.0, 0.0
    elif d3 >= 0 and d4 <= d3:
        s, t = 1.0, 0.0
    elif d6 >= 0 and d5 <= d6:
        s, t = 0.0, 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        s, t = d1 / (d1 - d3), 0.0
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        s, t = 0.0, d2 / (d2 - d6)
    elif va <= 0 and d4 >= d3 and d5 >= d6:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        s = 1.0 - t
    else:
        s, t = vb / (va + vb + vc), vc / (va + vb + vc)
    return ax + s * bx + t * cx, ay + s * by + t * cy, az + s * bz + t * cz
