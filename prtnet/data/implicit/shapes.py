"""Shapes as signed distances, below 0 inside. A shape is a function from a point to a distance, so that transforms are
functions of shapes (`prtnet.data.implicit.operators`).

All are exact distances or, where it is said, bounds: never more than the distance, so that sphere tracing never steps
through them (Hart 1996, *Sphere Tracing*).
"""

from collections.abc import Callable

from prtnet.data.implicit.expression import Node, Point, clamp, dot, length, maximum, minimum

Shape = Callable[[Point], Node]


def sphere(radius: float) -> Shape:
    """About the origin."""
    return lambda p: length(*p) - radius


def plane(normal: tuple[float, float, float] = (0.0, 1.0, 0.0), offset: float = 0.0) -> Shape:
    """All below the plane n.p = offset, with a unit normal."""
    return lambda p: dot(p, normal) - offset


def box(x: float, y: float, z: float, *, round: float = 0.0) -> Shape:
    """With half its extent along each axis, about the origin; its edges rounded by a radius, within that extent."""

    def at(p: Point) -> Node:
        q = [abs(axis) - (half - round) for axis, half in zip(p, (x, y, z), strict=True)]
        outside = length(*(maximum(each, 0) for each in q))
        return outside + minimum(maximum(*q), 0) - round

    return at


def torus(radius: float, thickness: float) -> Shape:
    """A ring about y; `thickness` is the radius of its tube."""
    return lambda p: length(length(p[0], p[2]) - radius, p[1]) - thickness


def capsule(start: tuple[float, float, float], end: tuple[float, float, float], radius: float) -> Shape:
    """All that is nearer than `radius` to a segment."""
    along = [b - a for a, b in zip(start, end, strict=True)]
    squared = sum(each * each for each in along)

    def at(p: Point) -> Node:
        away = [axis - first for axis, first in zip(p, start, strict=True)]
        share = clamp(dot(away, along) / squared, 0, 1)
        return length(*(each - share * step for each, step in zip(away, along, strict=True))) - radius

    return at
