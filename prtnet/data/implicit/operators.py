"""Shapes from shapes: booleans, hard and smooth, and transforms."""

from functools import reduce

import numpy as np
from jaxtyping import Float

from prtnet.data.implicit.expression import Node, Point, dot, maximum, minimum
from prtnet.data.implicit.shapes import Shape


def union(*shapes: Shape, smooth: float = 0.0) -> Shape:
    """All of them. With `smooth` they flow into each other within that distance."""
    return lambda p: _joined([shape(p) for shape in shapes], smooth)


def intersection(*shapes: Shape, smooth: float = 0.0) -> Shape:
    """What is in all of them: a bound of the distance outside."""
    return lambda p: -_joined([-shape(p) for shape in shapes], smooth)


def difference(shape: Shape, *cut: Shape, smooth: float = 0.0) -> Shape:
    """The first without the others: a bound of the distance outside."""
    return lambda p: -_joined([-shape(p), *(each(p) for each in cut)], smooth)


def _joined(distances: list[Node], smooth: float) -> Node:
    if smooth <= 0:
        return minimum(*distances)
    return reduce(lambda a, b: smooth_minimum(a, b, smooth), distances)


def smooth_minimum(a: Node, b: Node, smooth: float) -> Node:
    """min(a, b) - h^2 k / 4 with h = max(0, 1 - |a - b| / k): the quadratic form (Quilez, *Smooth minimum*).

    Its gradient is a weighted mean of both, so that it stays a bound of the distance.
    """
    h = maximum(1 - abs(a - b) / smooth, 0)
    return minimum(a, b) - (0.25 * smooth) * (h * h)


def moved(shape: Shape, x: float, y: float, z: float) -> Shape:
    """By a vector."""
    return lambda p: shape((p[0] - x, p[1] - y, p[2] - z))


def scaled(shape: Shape, factor: float) -> Shape:
    """About the origin, the same along all axes."""

    def at(p: Point) -> Node:
        return shape((p[0] / factor, p[1] / factor, p[2] / factor)) * factor

    return at


def turned(shape: Shape, axis: str, degrees: float) -> Shape:
    """About an axis through the origin, counter-clockwise seen from its tip."""
    return _rotated(shape, rotation(axis, degrees))


def rotation(axis: str, degrees: float) -> Float[np.ndarray, "3 3"]:
    """The matrix of `turned`."""
    at = "xyz".index(axis)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix, (i, j) = np.eye(3), ((at + 1) % 3, (at + 2) % 3)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def _rotated(shape: Shape, matrix: Float[np.ndarray, "3 3"]) -> Shape:
    # the point goes back by the transpose
    columns = [[float(value) for value in column] for column in matrix.T]
    return lambda p: shape((dot(p, columns[0]), dot(p, columns[1]), dot(p, columns[2])))
