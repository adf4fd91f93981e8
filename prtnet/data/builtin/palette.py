"""Small helpers that all procedural scenes share: materials by name, and subdivision counts."""

from collections.abc import Iterable

import numpy as np

from prtnet.data.part import Part
from prtnet.data.shapes import Surface, merge

# linear RGB
ALBEDO = {
    "white": (0.78, 0.76, 0.72),
    "red": (0.63, 0.07, 0.05),
    "green": (0.14, 0.45, 0.09),
    "ground": (0.56, 0.52, 0.46),
    "terracotta": (0.50, 0.18, 0.09),
    "glazed_blue": (0.10, 0.21, 0.36),
    "cream": (0.72, 0.65, 0.50),
    "slate": (0.13, 0.14, 0.15),
    "soil": (0.075, 0.05, 0.035),
    "stem": (0.20, 0.22, 0.08),
    "leaf_dark": (0.06, 0.19, 0.05),
    "leaf_bright": (0.22, 0.42, 0.08),
    "leaf_blue": (0.12, 0.27, 0.19),
    "leaf_yellow": (0.40, 0.44, 0.10),
    "porcelain": (0.80, 0.79, 0.75),
    "celadon": (0.35, 0.52, 0.42),
    "tea": (0.20, 0.075, 0.02),
    "silver": (0.55, 0.56, 0.58),
    "brass": (0.52, 0.36, 0.12),
    "oak": (0.42, 0.26, 0.13),
    "walnut": (0.17, 0.09, 0.05),
    "parquet": (0.36, 0.22, 0.11),
    "plaster": (0.74, 0.71, 0.65),
    "linen": (0.66, 0.60, 0.48),
    "sofa": (0.17, 0.27, 0.34),
    "mustard": (0.60, 0.36, 0.05),
    "rust": (0.45, 0.13, 0.05),
    "rug": (0.42, 0.16, 0.13),
    "navy": (0.05, 0.08, 0.18),
    "glass": (0.62, 0.70, 0.70),
    "wax": (0.80, 0.75, 0.60),
    "apple": (0.55, 0.06, 0.04),
    "orange": (0.75, 0.27, 0.03),
    "pear": (0.50, 0.52, 0.10),
    "skin": (0.60, 0.37, 0.27),
    "hair": (0.22, 0.10, 0.045),
    "cloth": (0.13, 0.20, 0.22),
    "marble": (0.72, 0.70, 0.65),
    "sandstone": (0.60, 0.50, 0.36),
    "limestone": (0.58, 0.54, 0.46),
    "basalt": (0.24, 0.23, 0.22),
    "ochre": (0.62, 0.42, 0.22),
    "bronze": (0.26, 0.19, 0.10),
    "water": (0.08, 0.16, 0.18),
    "crimson": (0.48, 0.04, 0.05),
    "curtain": (0.62, 0.55, 0.45),
    "brick": (0.36, 0.16, 0.10),
    "ultramarine": (0.06, 0.11, 0.38),
}


def part(
    name: str, surfaces: Surface | Iterable[Surface], albedo: str | tuple[float, float, float], *, sheets: bool = False
) -> Part:
    """A part of a scene; `albedo` is a name in ALBEDO or linear RGB, `sheets` makes it two-sided."""
    surface = surfaces if isinstance(surfaces, Surface) else merge(surfaces)
    colour = np.asarray(ALBEDO[albedo] if isinstance(albedo, str) else albedo, np.float64)
    return Part(name, surface.vertices, surface.faces, albedo=colour, two_sided=sheets)


def steps(count: int, tessellation: float, least: int = 3) -> int:
    """`count` subdivisions at tessellation 1."""
    return max(least, round(count * tessellation))
