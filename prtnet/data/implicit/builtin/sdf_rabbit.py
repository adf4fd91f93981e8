"""A sitting rabbit with a carrot and two mushrooms, on a round lawn. It is 2.5 tall."""

from prtnet.data.implicit.operators import difference, mirrored, moved, shell, turned, union
from prtnet.data.implicit.shapes import Shape, capsule, chain, cylinder, ellipsoid, sphere
from prtnet.data.implicit.surface import Described, described


def make() -> Described:
    fur, pale, ears = _fur(), _pale(), _inner_ears()
    eyes, nose = _eyes(), moved(ellipsoid(0.07, 0.05, 0.05), 0, 1.33, 0.93)
    carrot, leaves, stems, caps = _carrot(), _leaves(), _stems(), _caps()
    lawn = moved(cylinder(1.6, 0.1, round=0.05), 0, -0.1, 0)
    body = difference(union(fur, pale, smooth=0.06), ears, smooth=0.03)
    parts = {
        "fur": (difference(fur, ears, smooth=0.03), (0.36, 0.24, 0.15)),
        "pale": (pale, (0.70, 0.62, 0.52)),
        "ears": (shell(ears, 0.01), (0.62, 0.33, 0.29)),
        "eyes": (eyes, (0.03, 0.02, 0.02)),
        "nose": (nose, (0.45, 0.18, 0.17)),
        "carrot": (carrot, (0.72, 0.24, 0.04)),
        "leaves": (leaves, (0.14, 0.36, 0.07)),
        "stems": (stems, (0.66, 0.60, 0.48)),
        "caps": (caps, (0.52, 0.07, 0.05)),
        "lawn": (lawn, (0.30, 0.40, 0.17)),
    }
    surface = union(body, eyes, nose, carrot, leaves, stems, caps, lawn)
    return described("sdf_rabbit", parts, (-1.65, -0.22, -1.65), (1.65, 2.6, 1.65), joined=surface)


def _fur() -> Shape:
    middle = union(
        capsule((0, 0.55, -0.32), (0, 0.86, 0.12), 0.54, 0.42),
        moved(sphere(0.4), 0, 1.42, 0.42),
        capsule((0, 0.9, 0.15), (0, 1.3, 0.35), 0.38, 0.26),
        smooth=0.22,
    )
    sides = union(
        moved(turned(ellipsoid(0.26, 0.4, 0.46), "x", 20), 0.4, 0.42, -0.3),
        chain([(0.24, 0.72, 0.32), (0.26, 0.36, 0.5), (0.25, 0.12, 0.52)], [0.17, 0.12, 0.11]),
        _ear(),
        smooth=0.1,
    )
    return union(middle, mirrored(sides), smooth=0.12)


def _ear() -> Shape:
    return moved(turned(turned(ellipsoid(0.17, 0.5, 0.1), "y", 20), "z", -14), 0.26, 2.08, 0.26)


def _inner_ears() -> Shape:
    return mirrored(moved(turned(turned(ellipsoid(0.1, 0.4, 0.09), "y", 20), "z", -14), 0.28, 2.08, 0.345))


def _pale() -> Shape:
    """Belly, tail, paws, cheeks, chin."""
    sides = union(
        capsule((0.46, 0.1, -0.2), (0.5, 0.1, 0.32), 0.12, 0.1),
        capsule((0.25, 0.09, 0.5), (0.26, 0.08, 0.66), 0.11, 0.1),
        moved(sphere(0.15), 0.12, 1.25, 0.74),
        smooth=0.05,
    )
    tail = moved(sphere(0.21), 0, 0.42, -0.92)
    belly = moved(ellipsoid(0.34, 0.42, 0.3), 0, 0.72, 0.3)
    chin = moved(sphere(0.11), 0, 1.14, 0.7)
    return union(mirrored(sides), tail, belly, chin, smooth=0.06)


def _eyes() -> Shape:
    return mirrored(moved(sphere(0.095), 0.25, 1.49, 0.65))


def _carrot() -> Shape:
    return chain([(0.55, 0.12, 1.0), (0.95, 0.12, 0.55)], [0.035, 0.12])


def _leaves() -> Shape:
    root = (0.98, 0.13, 0.5)
    return union(*(capsule(root, end, 0.02, 0.05) for end in ((1.25, 0.3, 0.4), (1.2, 0.22, 0.18), (1.05, 0.3, 0.2))))


def _stems() -> Shape:
    return union(
        capsule((-0.95, 0, 0.45), (-0.98, 0.36, 0.42), 0.09, 0.07),
        capsule((-0.7, 0, 0.85), (-0.68, 0.2, 0.86), 0.06, 0.05),
    )


def _caps() -> Shape:
    """Half balls, hollow below."""
    large = difference(sphere(0.27), moved(sphere(0.5), 0, -0.46, 0), smooth=0.04)
    small = difference(sphere(0.17), moved(sphere(0.32), 0, -0.3, 0), smooth=0.03)
    return union(moved(turned(large, "z", 8), -0.98, 0.3, 0.42), moved(turned(small, "z", -6), -0.68, 0.16, 0.86))
