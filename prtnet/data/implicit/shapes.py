"""Shapes as signed distances, below 0 inside. A shape is a function from a point to a distance, so that transforms are
functions of shapes (`prtnet.data.implicit.operators`).

All are exact distances or, where it is said, bounds: never more than the distance and with a slope of at most 1, so
that sphere tracing never steps through them (Hart 1996, *Sphere Tracing*).
"""

from collections.abc import Callable, Sequence
from math import sqrt as root

from prtnet import PrtnetError
from prtnet.data.implicit.expression import Node, Point, clamp, dot, length, maximum, minimum, sqrt

Shape = Callable[[Point], Node]
Triple = tuple[float, float, float]


def sphere(radius: float) -> Shape:
    """About the origin."""
    positive("sphere", radius=radius)
    return lambda p: length(*p) - radius


def ellipsoid(x: float, y: float, z: float) -> Shape:
    """With these radii, about the origin: a bound.

    With f = |p / radii|, least * (f - 1) has the slope least * |p / radii^2| / f, at most 1, and 1 at the ends of the
    shortest axis; |p| - greatest is the distance from a ball around the ellipsoid, exact at the ends of the longest
    axis and far away. Both are bounds outside, so their maximum is the better one; inside the first one is the greater.
    """
    positive("ellipsoid", x=x, y=y, z=z)
    least, greatest = min(x, y, z), max(x, y, z)
    if least == greatest:
        return sphere(x)

    def at(p: Point) -> Node:
        gauge = length(*(axis / radius for axis, radius in zip(p, (x, y, z), strict=True)))
        return maximum(least * (gauge - 1), length(*p) - greatest)

    return at


def plane(normal: Triple = (0.0, 1.0, 0.0), offset: float = 0.0) -> Shape:
    """All below the plane n.p = offset, n the normal brought to unit length."""
    size = root(sum(each * each for each in normal))
    positive("plane", normal=size)
    unit = [each / size for each in normal]
    return lambda p: dot(p, unit) - offset


def box(x: float, y: float, z: float, *, round: float = 0.0) -> Shape:
    """With half its extent along each axis, about the origin; its edges rounded by a radius, within that extent."""
    positive("box", x=x, y=y, z=z)
    _within("box", round, min(x, y, z))
    return lambda p: _outward([abs(axis) - (half - round) for axis, half in zip(p, (x, y, z), strict=True)]) - round


def cylinder(radius: float, height: float, *, round: float = 0.0) -> Shape:
    """About y, `height` being half of its extent; its edges rounded by a radius, within that extent."""
    positive("cylinder", radius=radius, height=height)
    _within("cylinder", round, min(radius, height))
    return lambda p: _outward([length(p[0], p[2]) - (radius - round), abs(p[1]) - (height - round)]) - round


def cone(bottom: float, top: float, height: float) -> Shape:
    """About y, from the radius `bottom` at -height to `top` at +height, either of which may be 0: a bound."""
    positive("cone", height=height, radius=max(bottom, top))
    slant = root((bottom - top) ** 2 + 4 * height * height)
    # the side's unit normal in the plane of radius and y
    outward, upward = 2 * height / slant, (bottom - top) / slant
    offset = outward * (bottom + top) / 2
    return lambda p: maximum(outward * length(p[0], p[2]) + upward * p[1] - offset, abs(p[1]) - height)


def torus(radius: float, thickness: float) -> Shape:
    """A ring about y; `thickness` is the radius of its tube."""
    positive("torus", radius=radius, thickness=thickness)
    return lambda p: length(length(p[0], p[2]) - radius, p[1]) - thickness


def capsule(start: Triple, end: Triple, radius: float, end_radius: float | None = None) -> Shape:
    """All that is nearer than `radius` to a segment; with `end_radius` all balls whose radii go from one to the other.

    The distance is the least of |p - c(s)| - r(s) over the segment, a convex function of s. Its derivative is 0 where
    the way from c(s) to p leans forward as much as the radius shrinks: for p at a distance w from the axis,
    w taper / sqrt(1 - taper^2) behind its foot.
    """
    along = [b - a for a, b in zip(start, end, strict=True)]
    size = root(sum(each * each for each in along))
    last = radius if end_radius is None else end_radius
    positive("capsule", radius=radius, length=size)
    taper = (radius - last) / size
    if last < 0 or abs(taper) >= 1:
        raise PrtnetError(
            f"capsule: end_radius: found {last}, expected at least 0 and within {size:.6g}, its length, of {radius}"
        )

    unit = [each / size for each in along]

    def at(p: Point) -> Node:
        away = [axis - first for axis, first in zip(p, start, strict=True)]
        foot = dot(away, unit)
        if not taper:
            nearest = clamp(foot, 0, size)
            return length(*(each - nearest * step for each, step in zip(away, unit, strict=True))) - radius
        off = [each - foot * step for each, step in zip(away, unit, strict=True)]
        squared = dot(off, off)
        nearest = clamp(foot - taper / root(1 - taper * taper) * sqrt(squared), 0, size)
        ahead = foot - nearest
        return sqrt(squared + ahead * ahead) + taper * nearest - radius

    return at


def chain(points: Sequence[Triple], radii: Sequence[float]) -> Shape:
    """Tapered capsules from each point to the next: limbs, tails, horns."""
    if not 2 <= len(points) == len(radii):
        raise PrtnetError(
            f"chain: found {len(points)} points and {len(radii)} radii, expected at least two, and one for each"
        )
    ends = zip(points, points[1:], radii, radii[1:], strict=False)
    links = [capsule(start, end, first, last) for start, end, first, last in ends]
    return lambda p: minimum(*(link(p) for link in links))


def _outward(coordinates: list[Node]) -> Node:
    """The distance from the corner in which all coordinates are below 0."""
    return length(*(maximum(each, 0) for each in coordinates)) + minimum(maximum(*coordinates), 0)


def positive(name: str, **values: float) -> None:
    """Raises PrtnetError for one that is not above 0."""
    for key, value in values.items():
        if not value > 0:
            raise PrtnetError(f"{name}: {key}: found {value}, expected more than 0")


def _within(name: str, round: float, half: float) -> None:
    if not 0 <= round <= half:
        raise PrtnetError(f"{name}: round: found {round}, expected 0 to {half}, half of the shortest extent")
