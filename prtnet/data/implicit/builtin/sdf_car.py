"""An open two-seater with wheel arches and wing mirrors, parked between two cones on a plate.

It is 3.7 long and heads for +x. Most of it is mirrored about z, the wheels about x as well.
"""

from prtnet.data.implicit.operators import (
    around,
    difference,
    intersection,
    mirrored,
    moved,
    repeated,
    rounded,
    shell,
    turned,
    union,
)
from prtnet.data.implicit.shapes import Shape, box, capsule, chain, cone, cylinder, ellipsoid, plane, sphere, torus
from prtnet.data.implicit.surface import Described, described

WHEEL = (1.1, 0.36, 0.6)  # centre of the front right one
COCKPIT = (-0.32, 0.92, 0.0)


def make() -> Described:
    ground = moved(box(2.3, 0.1, 1.5, round=0.04), 0, -0.1, 0)
    lines = moved(box(2.0, 0.02, 0.05), 0, 0, 1.28)
    parts = {
        "paint": (_paint(), (0.50, 0.05, 0.04)),
        "interior": (union(_lining(), _seats()), (0.42, 0.24, 0.12)),
        "chrome": (union(_chrome(), _rims()), (0.56, 0.57, 0.58)),
        "tyres": (_tyres(), (0.045, 0.045, 0.05)),
        "glass": (_windscreen(), (0.50, 0.60, 0.62)),
        "headlights": (_headlights(), (0.80, 0.77, 0.66)),
        "tail_lights": (_tail_lights(), (0.55, 0.02, 0.02)),
        "dark": (_dark(), (0.05, 0.05, 0.055)),
        "cones": (_cones(), (0.75, 0.22, 0.03)),
        "ground": (ground, (0.36, 0.36, 0.37)),
    }
    surface = union(*(shape for shape, _ in parts.values()))
    # painted on
    parts["lines"] = (mirrored(lines, "z"), (0.72, 0.70, 0.62))
    return described("sdf_car", parts, (-2.35, -0.22, -1.55), (2.35, 1.35, 1.55), joined=surface)


def _paint() -> Shape:
    sides = union(
        moved(ellipsoid(0.62, 0.36, 0.24), 1.08, 0.54, 0.5),
        moved(ellipsoid(0.6, 0.38, 0.24), -1.08, 0.56, 0.5),
        capsule((-0.72, 0.9, 0.24), (-1.3, 0.76, 0.2), 0.16, 0.06),
        smooth=0.1,
    )
    body = union(
        moved(box(1.72, 0.25, 0.6, round=0.24), 0, 0.5, 0),
        moved(ellipsoid(0.95, 0.28, 0.44), 0.86, 0.66, 0),
        moved(ellipsoid(0.8, 0.24, 0.5), -1.05, 0.66, 0),
        mirrored(sides, "z"),
        smooth=0.12,
    )
    arches = moved(turned(cylinder(0.42, 0.22, round=0.04), "x", 90), *WHEEL)
    air = moved(turned(ellipsoid(0.2, 0.13, 0.3), "z", -12), 1.76, 0.5, 0)
    cut = union(_cockpit(), mirrored(mirrored(arches, "x"), "z"), air)
    return difference(difference(body, cut, smooth=0.03), _gaps())


def _cockpit() -> Shape:
    return moved(box(0.44, 0.44, 0.43, round=0.14), *COCKPIT)


def _gaps() -> Shape:
    """Round the doors and the bonnet."""
    door = intersection(shell(moved(box(0.36, 0.3, 0.8, round=0.1), -0.2, 0.62, 0.0), 0.007), plane((0, 0, -1), -0.5))
    bonnet = intersection(shell(moved(box(0.62, 0.8, 0.33, round=0.1), 0.92, 1, 0), 0.007), plane((0, -1, 0), -0.72))
    return union(mirrored(door, "z"), bonnet)


def _lining() -> Shape:
    """What is left between the cockpit and a slightly smaller one, without a lid, and the dashboard."""
    bottom = moved(box(0.44, 0.05, 0.42, round=0.04), COCKPIT[0], 0.47, 0)
    dashboard = moved(capsule((0, 0, -0.4), (0, 0, 0.4), 0.08), 0.1, 0.84, 0)
    return union(bottom, dashboard, smooth=0.05)


def _seats() -> Shape:
    cushion = moved(box(0.2, 0.09, 0.17, round=0.08), -0.3, 0.55, 0.2)
    back = moved(turned(box(0.09, 0.26, 0.17, round=0.08), "z", 14), -0.58, 0.76, 0.2)
    head = moved(box(0.06, 0.07, 0.1, round=0.06), -0.68, 1.06, 0.2)
    return mirrored(union(union(cushion, back, smooth=0.04), head), "z")


def _chrome() -> Shape:
    bumper = union(
        chain([(1.9, 0.36, 0.0), (1.86, 0.36, 0.35), (1.66, 0.37, 0.64)], [0.05, 0.05, 0.04]),
        chain([(-1.88, 0.38, 0.0), (-1.84, 0.38, 0.35), (-1.62, 0.38, 0.66)], [0.05, 0.05, 0.04]),
        capsule((1.9, 0.28, 0.2), (1.9, 0.5, 0.2), 0.035, 0.03),
    )
    mirror = union(
        capsule((0.26, 0.68, 0.5), (0.3, 0.93, 0.7), 0.022),
        moved(difference(ellipsoid(0.1, 0.075, 0.1), moved(sphere(0.12), -0.15, 0, 0), smooth=0.02), 0.3, 0.98, 0.74),
    )
    handle = capsule((-0.48, 0.68, 0.62), (-0.34, 0.69, 0.62), 0.02)
    lamp = capsule((1.4, 0.64, 0.46), (1.57, 0.66, 0.46), 0.16, 0.15)
    frame = chain([(0.22, 0.85, 0.44), (0.04, 1.19, 0.4), (0.03, 1.21, 0.0)], [0.028, 0.022, 0.022])
    slats = moved(repeated(capsule((0, -0.11, 0), (-0.03, 0.11, 0), 0.012), "z", 0.07, 4), 1.72, 0.5, 0.0)
    pipe = moved(turned(difference(cylinder(0.05, 0.16), cylinder(0.035, 0.3)), "z", 90), -1.8, 0.26, 0.34)
    return mirrored(union(bumper, mirror, handle, lamp, frame, slats, pipe), "z")


def _wheel(shape: Shape) -> Shape:
    """A shape about y, at all four wheels."""
    return mirrored(mirrored(moved(turned(shape, "x", 90), *WHEEL), "x"), "z")


def _tyres() -> Shape:
    tyre = difference(cylinder(0.35, 0.12, round=0.07), cylinder(0.22, 0.3), smooth=0.03)
    return _wheel(tyre)


def _rims() -> Shape:
    spoke = capsule((0.04, 0.06, 0), (0.2, 0.03, 0), 0.028, 0.036)
    dish = difference(cylinder(0.23, 0.1, round=0.01), moved(cylinder(0.2, 0.1), 0, 0.09, 0), smooth=0.02)
    hub = moved(ellipsoid(0.06, 0.05, 0.06), 0, 0.06, 0)
    return _wheel(union(dish, around(spoke, "y", 5), hub, smooth=0.02))


def _windscreen() -> Shape:
    pane = moved(turned(box(0.008, 0.19, 0.42), "z", 28), 0.12, 1.02, 0)
    return rounded(pane, 0.004)


def _headlights() -> Shape:
    return mirrored(moved(ellipsoid(0.07, 0.12, 0.12), 1.69, 0.665, 0.46), "z")


def _tail_lights() -> Shape:
    return mirrored(moved(ellipsoid(0.06, 0.11, 0.07), -1.655, 0.62, 0.5), "z")


def _dark() -> Shape:
    """Steering wheel with its column, underbody, number plates, bonnet vents."""
    wheel = moved(
        turned(union(torus(0.13, 0.016), capsule((-0.13, 0, 0), (0.13, 0, 0), 0.016)), "z", 62), -0.03, 0.88, 0.2
    )
    column = capsule((-0.03, 0.88, 0.2), (0.12, 0.8, 0.2), 0.022)
    under = moved(box(1.4, 0.06, 0.42, round=0.04), 0, 0.26, 0)
    plates = moved(box(1.91, 0.05, 0.16, round=0.01), 0, 0.32, 0)
    return union(wheel, column, under, plates)


def _cones() -> Shape:
    one = union(
        moved(cone(0.13, 0.035, 0.24), 0, 0.28, 0),
        moved(box(0.19, 0.025, 0.19, round=0.02), 0, 0.025, 0),
        smooth=0.02,
    )
    return union(moved(one, 1.75, 0, 1.1), moved(turned(one, "y", 30), -1.7, 0, 1.12))
