"""A clownfish with its mouth open above a sea floor: an arch of rock, corals, a starfish, an anemone, bubbles.

The plate is 3.2 across; the fish is 2 long, heads for +x and is mirrored about z.
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
from prtnet.data.implicit.shapes import Shape, box, capsule, chain, cylinder, ellipsoid, plane, sphere, torus
from prtnet.data.implicit.surface import Described, described

FISH = (0.15, 1.35, 0.15)


def make() -> Described:
    body, fins, mouth = _fish(_body()), _fish(_fins()), _fish(_mouth())
    swimmer = difference(union(body, fins, smooth=0.05), mouth, _fish(_gills()), smooth=0.03)
    eyes, pupils = _fish(_eyes()), _fish(_pupils())
    sand = union(moved(cylinder(1.6, 0.1, round=0.05), 0, -0.1, 0), _ripples(), smooth=0.06)
    rock, coral, star, anemone, bubbles = _rock(), _coral(), _star(), _anemone(), _bubbles()
    bands = _fish(_bands())
    parts = {
        "orange": (swimmer, (0.74, 0.23, 0.03)),
        "white": (intersection(rounded(swimmer, 0.004), bands), (0.80, 0.77, 0.70)),
        "black": (intersection(rounded(swimmer, 0.006), shell(bands, 0.02)), (0.03, 0.03, 0.035)),
        "mouth": (intersection(rounded(swimmer, 0.006), rounded(mouth, 0.01)), (0.42, 0.07, 0.06)),
        "eyes": (eyes, (0.80, 0.78, 0.72)),
        "pupils": (pupils, (0.02, 0.02, 0.03)),
        "sand": (sand, (0.66, 0.56, 0.40)),
        "rock": (rock, (0.28, 0.29, 0.33)),
        "coral": (coral, (0.62, 0.13, 0.22)),
        "star": (star, (0.70, 0.40, 0.06)),
        "anemone": (anemone, (0.42, 0.20, 0.48)),
        "bubbles": (bubbles, (0.62, 0.74, 0.78)),
    }
    surface = union(swimmer, eyes, pupils, union(sand, rock, smooth=0.1), coral, star, anemone, bubbles)
    return described("sdf_fish", parts, (-1.65, -0.22, -1.65), (1.65, 2.3, 1.65), joined=surface)


def _fish(shape: Shape) -> Shape:
    """From the fish's own axes into the scene: it swims to the front and a little upwards."""
    return moved(turned(turned(shape, "z", 8), "y", -25), *FISH)


def _body() -> Shape:
    return union(
        ellipsoid(0.72, 0.44, 0.27),
        capsule((-0.5, 0.02, 0), (-0.92, 0.04, 0), 0.2, 0.1),
        moved(ellipsoid(0.3, 0.28, 0.2), 0.46, -0.02, 0),
        moved(turned(torus(0.13, 0.05), "z", 78), 0.73, -0.06, 0),
        smooth=0.12,
    )


def _mouth() -> Shape:
    return moved(ellipsoid(0.3, 0.12, 0.12), 0.74, -0.07, 0)


def _gills() -> Shape:
    slit = intersection(shell(moved(sphere(0.3), 0.36, -0.04, 0.2), 0.012), moved(box(0.2, 0.2, 0.5), 0.12, -0.06, 0.3))
    return mirrored(slit, "z")


def _fins() -> Shape:
    """Flat ellipsoids with spines that stand out of them."""
    back = union(
        intersection(moved(ellipsoid(0.56, 0.36, 0.035), -0.06, 0.34, 0), moved(box(0.7, 0.4, 0.1), -0.05, 0.6, 0)),
        moved(repeated(turned(capsule((0, -0.1, 0), (0, 0.26, 0), 0.03, 0.012), "z", 25), "x", 0.15, 6), -0.4, 0.42, 0),
        smooth=0.03,
    )
    lobe = moved(turned(ellipsoid(0.34, 0.15, 0.03), "z", -42), -1.14, 0.2, 0)
    belly = moved(turned(ellipsoid(0.24, 0.13, 0.03), "z", 50), -0.32, -0.46, 0)
    side = union(
        moved(turned(turned(ellipsoid(0.26, 0.13, 0.025), "z", 20), "y", 40), 0.02, -0.12, 0.4),
        moved(turned(turned(ellipsoid(0.2, 0.09, 0.025), "z", 60), "x", 25), 0.14, -0.46, 0.14),
    )
    tail = union(lobe, moved(turned(ellipsoid(0.34, 0.15, 0.03), "z", 42), -1.14, -0.12, 0), smooth=0.06)
    return union(back, tail, belly, mirrored(side, "z"), smooth=0.03)


def _bands() -> Shape:
    """White: behind the head, at the middle, before the tail."""
    head = difference(moved(sphere(0.46), 0.52, 0, 0), moved(sphere(0.36), 0.6, -0.02, 0))
    middle = moved(box(0.1, 0.9, 0.5, round=0.09), -0.22, 0.0, 0)
    return union(
        intersection(head, moved(box(0.14, 0.6, 0.5), 0.2, 0, 0)), middle, moved(box(0.06, 0.5, 0.4), -0.84, 0, 0)
    )


def _eyes() -> Shape:
    return mirrored(moved(sphere(0.1), 0.5, 0.12, 0.19), "z")


def _pupils() -> Shape:
    return mirrored(moved(sphere(0.06), 0.53, 0.13, 0.25), "z")


def _ripples() -> Shape:
    ridge = capsule((0, 0, -0.9), (0, 0, 0.9), 0.06)
    return turned(moved(repeated(ridge, "x", 0.3, 6), -0.75, -0.025, 0), "y", 35)


def _rock() -> Shape:
    arch = moved(turned(torus(0.5, 0.17), "x", 90), -0.75, 0.1, -0.75)
    stones = union(
        arch,
        moved(ellipsoid(0.3, 0.24, 0.26), -1.22, 0.1, -0.62),
        moved(ellipsoid(0.34, 0.28, 0.3), -0.25, 0.1, -0.9),
        moved(ellipsoid(0.2, 0.14, 0.18), -1.15, 0.06, 0.5),
        smooth=0.15,
    )
    return intersection(stones, plane((0, -1, 0), 0.06))


def _coral() -> Shape:
    trunk = chain(
        [(0.85, -0.05, -0.75), (0.9, 0.35, -0.8), (0.8, 0.75, -0.85), (0.9, 1.05, -0.9)], [0.12, 0.09, 0.07, 0.06]
    )
    right = chain([(0.9, 0.35, -0.8), (1.15, 0.6, -0.7), (1.15, 0.95, -0.75)], [0.08, 0.065, 0.05])
    left = chain([(0.82, 0.62, -0.84), (0.55, 0.85, -0.7), (0.52, 1.1, -0.72)], [0.07, 0.06, 0.05])
    front = chain([(0.88, 0.3, -0.78), (0.95, 0.55, -0.5), (0.9, 0.8, -0.42)], [0.07, 0.055, 0.045])
    return union(trunk, right, left, front, smooth=0.05)


def _star() -> Shape:
    arm = capsule((0, 0, 0), (0.3, -0.02, 0), 0.085, 0.03)
    return moved(union(around(arm, "y", 5), moved(sphere(0.09), 0, 0.01, 0), smooth=0.05), 0.25, 0.05, 1.05)


def _anemone() -> Shape:
    arm = chain([(0.08, 0.1, 0), (0.17, 0.34, 0), (0.14, 0.5, 0)], [0.045, 0.04, 0.05])
    foot = capsule((0, 0, 0), (0, 0.14, 0), 0.16, 0.13)
    return moved(union(foot, around(arm, "y", 7), smooth=0.03), 1.1, 0, 0.45)


def _bubbles() -> Shape:
    at = ((1.08, 1.62, 0.66, 0.06), (1.16, 1.85, 0.7, 0.08), (1.05, 2.1, 0.62, 0.1))
    return union(*(moved(sphere(radius), x, y, z) for x, y, z, radius in at))
