"""Shapes from shapes: booleans, hard and smooth, and transforms."""

from functools import reduce

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError
from prtnet.data.implicit.expression import Node, Point, clamp, dot, floor, maximum, minimum, select
from prtnet.data.implicit.shapes import Shape, Triple, positive


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
    """min(a, b) - h^2 / 4k with h = max(0, k - |a - b|): the quadratic form (Quilez, *Smooth minimum*).

    Its gradient is a weighted mean of both, so that it stays a bound of the distance.
    """
    h = maximum(smooth - abs(a - b), 0)
    return minimum(a, b) - (0.25 / smooth) * (h * h)


def moved(shape: Shape, x: float, y: float, z: float) -> Shape:
    """By a vector."""
    return lambda p: shape((p[0] - x, p[1] - y, p[2] - z))


def scaled(shape: Shape, factor: float) -> Shape:
    """About the origin, the same along all axes."""
    positive("scaled", factor=factor)

    def at(p: Point) -> Node:
        return shape((p[0] / factor, p[1] / factor, p[2] / factor)) * factor

    return at


def stretched(shape: Shape, x: float, y: float, z: float) -> Shape:
    """About the origin, by a factor along each axis: a bound."""
    positive("stretched", x=x, y=y, z=z)
    return lambda p: shape((p[0] / x, p[1] / y, p[2] / z)) * min(x, y, z)


def elongated(shape: Shape, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Shape:
    """Cut at the origin and pulled apart by twice these lengths, filled between: exact outside of convex shapes."""
    halves = (x, y, z)
    if min(halves) < 0:
        raise PrtnetError(f"elongated: found {halves}, expected lengths of at least 0")

    def at(p: Point) -> Node:
        a, b, c = (axis - clamp(axis, -half, half) if half else axis for axis, half in zip(p, halves, strict=True))
        return shape((a, b, c))

    return at


def shell(shape: Shape, thickness: float) -> Shape:
    """Its surface alone, this thick to either side."""
    positive("shell", thickness=thickness)
    return lambda p: abs(shape(p)) - thickness


def rounded(shape: Shape, radius: float) -> Shape:
    """Grown by a radius, which rounds its edges."""
    return lambda p: shape(p) - radius


def mirrored(shape: Shape, axis: str = "x") -> Shape:
    """What of it lies on the positive side of an axis, on both sides.

    Folding space brings no two points further apart, so that a bound stays one.
    """
    at = _index(axis)
    return lambda p: shape(_replaced(p, at, abs(p[at])))


def repeated(shape: Shape, axis: str, spacing: float, count: int | None = None) -> Shape:
    """Copies along an axis, `spacing` apart: as many as `count`, the first in place, or without end.

    The shape has to lie within half a spacing of the origin along that axis. Each point of it is then nearest in the
    cell of the point asked for or in the neighbour on its side of the middle, so that two copies give the distance of
    all, also across the borders of cells.
    """
    at = _index(axis)
    positive("repeated", spacing=spacing, count=1 if count is None else count)

    def within(cell: Node) -> Node:
        return cell if count is None else clamp(cell, 0, count - 1)

    def copies(p: Point) -> Node:
        cell = floor(p[at] / spacing + 0.5)
        beside = cell + select(p[at], cell * spacing, -1, 1)
        return minimum(*(shape(_replaced(p, at, p[at] - spacing * within(each))) for each in (cell, beside)))

    return copies


def around(shape: Shape, axis: str, count: int) -> Shape:
    """Copies about an axis, evenly, the first in place: about x it is at +y, about y and z at +x.

    The plane is folded at mirrors half-way between copies until one is left, with fewer mirrors than copies; so every
    second copy is a mirror image, and a shape that reaches across a mirror is cut there.
    """
    along, across = (each for each in range(3) if each != _index(axis))
    positive("around", count=count)
    angles = _mirrors(count)

    def at(p: Point) -> Node:
        u, v = p[along], abs(p[across]) if angles else p[across]
        for angle in angles:
            c, s = float(np.cos(angle)), float(np.sin(angle))
            beyond = 2 * maximum(v * c - u * s, 0)
            u, v = u + beyond * s, v - beyond * c
        return shape(_replaced(_replaced(p, along, u), across, v))

    return at


def _mirrors(count: int) -> list[float]:
    """Angles at which the half plane is folded, in radians, each the least that keeps to the sector of the first copy
    what it brings back."""
    half, found, reach = np.pi / count, [], np.pi
    while reach > half * 1.000001:
        odd = int(np.ceil((reach / half - 1) / 2 - 1e-6))
        reach = (odd + 1 - odd % 2) * half
        found.append(float(reach))
    return found


def turned(shape: Shape, axis: str | Triple, degrees: float) -> Shape:
    """About an axis through the origin, x, y, z or a vector, counter-clockwise seen from its tip."""
    # the point goes back by the transpose
    columns = [[float(value) for value in column] for column in rotation(axis, degrees).T]
    return lambda p: shape((dot(p, columns[0]), dot(p, columns[1]), dot(p, columns[2])))


def rotation(axis: str | Triple, degrees: float) -> Float[np.ndarray, "3 3"]:
    """The matrix of `turned`, by Rodrigues' formula."""
    along = np.eye(3)[_index(axis)] if isinstance(axis, str) else np.asarray(axis, np.float64)
    size = float(np.linalg.norm(along))
    positive("turned", axis=size)
    x, y, z = along / size
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    matrix = np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * across @ across
    # quarter turns leave zeros, which cost nothing
    return np.where(np.abs(matrix) < 1e-15, 0.0, matrix)


def _index(axis: str) -> int:
    if axis not in ("x", "y", "z"):
        raise PrtnetError(f"axis: found {axis!r}, expected x, y or z")
    return "xyz".index(axis)


def _replaced(p: Point, at: int, value: Node) -> Point:
    x, y, z = (value if each == at else axis for each, axis in enumerate(p))
    return x, y, z
