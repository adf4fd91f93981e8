"""A horned monster with three eyes that waves with its mouth open, on a disc of stone. It is 2.6 tall."""

from prtnet.data.implicit.operators import difference, mirrored, moved, repeated, rounded, shell, turned, union
from prtnet.data.implicit.shapes import Shape, capsule, chain, cone, cylinder, ellipsoid, sphere
from prtnet.data.implicit.surface import Described, described

MOUTH = (0.0, 1.02, 0.52)


def make() -> Described:
    skin, horns = difference(_skin(), _cavity(), smooth=0.05), _horns_and_claws()
    teeth, tongue, eyes, pupils = _teeth(), _tongue(), _eyes(), _pupils()
    stone = moved(cylinder(1.9, 0.12, round=0.05), 0, -0.12, 0)
    surface = union(skin, horns, teeth, tongue, eyes, pupils, stone)
    parts = {
        "skin": (skin, (0.13, 0.30, 0.42)),
        "mouth": (difference(shell(_cavity(), 0.02), rounded(tongue, 0.01)), (0.30, 0.03, 0.04)),
        "horns": (horns, (0.68, 0.58, 0.40)),
        "teeth": (teeth, (0.80, 0.76, 0.66)),
        "tongue": (tongue, (0.62, 0.16, 0.18)),
        "eyes": (eyes, (0.82, 0.80, 0.74)),
        "pupils": (pupils, (0.03, 0.03, 0.04)),
        "stone": (stone, (0.50, 0.47, 0.42)),
    }
    return described("sdf_monster", parts, (-1.95, -0.26, -1.95), (1.95, 2.75, 1.95), joined=surface)


def _skin() -> Shape:
    body = union(
        capsule((0, 0.72, 0), (0, 1.5, -0.02), 0.68, 0.56),
        moved(ellipsoid(0.58, 0.5, 0.42), 0, 0.68, 0.32),
        smooth=0.25,
    )
    legs = union(
        capsule((0.36, 0.5, 0), (0.46, 0.16, 0.02), 0.26, 0.2),
        moved(ellipsoid(0.24, 0.13, 0.34), 0.48, 0.12, 0.16),
        *(moved(sphere(0.11), x, 0.1, z) for x, z in ((0.31, 0.42), (0.48, 0.49), (0.65, 0.42))),
        smooth=0.08,
    )
    raised = union(
        chain([(0.5, 1.35, 0), (0.98, 1.42, 0.12), (1.2, 1.86, 0.28)], [0.2, 0.15, 0.13]),
        *_fingers((1.2, 1.92, 0.28), ((0.02, 0.3, 0.1), (0.2, 0.22, 0.1), (-0.2, 0.2, 0.12))),
        smooth=0.08,
    )
    lowered = union(
        chain([(-0.5, 1.35, 0), (-0.94, 1.04, 0.06), (-0.98, 0.62, 0.4)], [0.2, 0.15, 0.13]),
        *_fingers((-0.98, 0.58, 0.43), ((0.02, -0.22, 0.16), (-0.18, -0.2, 0.1), (0.16, -0.14, 0.14))),
        smooth=0.08,
    )
    tail = chain([(0, 0.45, -0.5), (0.3, 0.2, -1.05), (0.8, 0.2, -1.2), (1.1, 0.5, -1.0)], [0.3, 0.19, 0.13, 0.06])
    brow = moved(turned(ellipsoid(0.34, 0.1, 0.16), "x", 25), 0, 1.84, 0.42)
    stalks = mirrored(capsule((0.2, 1.8, 0.1), (0.52, 2.12, 0.26), 0.12, 0.09))
    lips = moved(ellipsoid(0.47, 0.3, 0.2), *MOUTH)
    return union(body, mirrored(legs), raised, lowered, tail, lips, brow, stalks, smooth=0.12)


def _fingers(hand: tuple[float, float, float], ways: tuple[tuple[float, float, float], ...]) -> list[Shape]:
    x, y, z = hand
    return [moved(sphere(0.17), x, y, z)] + [
        capsule(hand, (x + along[0], y + along[1], z + along[2]), 0.09, 0.06) for along in ways
    ]


def _cavity() -> Shape:
    return moved(ellipsoid(0.4, 0.22, 0.5), MOUTH[0], MOUTH[1], MOUTH[2] + 0.06)


def _teeth() -> Shape:
    """Five above and four below, and two long ones."""
    above = moved(repeated(turned(cone(0.055, 0.0, 0.085), "x", 180), "x", 0.115, 5), -0.23, 1.16, 0.64)
    below = moved(repeated(cone(0.05, 0.0, 0.07), "x", 0.115, 4), -0.1725, 0.88, 0.66)
    long = mirrored(capsule((0.28, 0.86, 0.62), (0.31, 1.12, 0.68), 0.06, 0.015))
    return union(above, below, long)


def _tongue() -> Shape:
    return chain([(0, 0.86, 0.3), (0.02, 0.9, 0.62), (0.05, 0.8, 0.86)], [0.16, 0.13, 0.1])


def _eyes() -> Shape:
    return union(moved(sphere(0.27), 0, 1.6, 0.42), mirrored(moved(sphere(0.16), 0.55, 2.16, 0.3)))


def _pupils() -> Shape:
    """Of three eyes that look at the camera's side."""
    return union(moved(sphere(0.13), 0.03, 1.59, 0.585), mirrored(moved(sphere(0.08), 0.555, 2.165, 0.4)))


def _horns_and_claws() -> Shape:
    horns = chain(
        [(0.3, 1.8, -0.1), (0.58, 2.05, -0.2), (0.62, 2.4, -0.16), (0.46, 2.62, -0.06)], [0.15, 0.11, 0.07, 0.02]
    )
    toes = [
        capsule((x, 0.1, z), (x * 1.02, 0.05, z + 0.13), 0.06, 0.015)
        for x, z in ((0.31, 0.49), (0.48, 0.56), (0.65, 0.49))
    ]
    spikes = [
        moved(turned(cone(0.13 * size, 0.0, 0.17 * size), "x", tilt), 0, y, z)
        for y, z, tilt, size in (
            (1.95, -0.42, -35, 0.9),
            (1.6, -0.66, -60, 1.15),
            (1.2, -0.75, -80, 1.15),
            (0.82, -0.8, -95, 1.0),
        )
    ]
    tip = moved(sphere(0.13), 1.14, 0.58, -0.97)
    return union(mirrored(union(horns, *toes)), *spikes, tip)
