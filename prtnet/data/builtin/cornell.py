"""The Cornell box (Goral et al. 1984), open in front and with an opening in the ceiling, so that distant light gets in."""

import numpy as np

from prtnet.data.builtin.palette import part
from prtnet.data.part import Part
from prtnet.data.shapes import Surface, box, quad

GAP = 0.002
WALL = 0.05


def parts(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """Two boxes in an open box, a sphere-free classic: 12 triangles for each solid whatever the tessellation."""
    tall = box([-0.3, 0, -0.3], [0.3, 1.2, 0.3]).turned(0.3 + rng.uniform(-0.05, 0.05)).moved(-0.36, GAP, -0.3)
    small = box([-0.29, 0, -0.29], [0.29, 0.58, 0.29]).turned(-0.31 + rng.uniform(-0.05, 0.05)).moved(0.37, GAP, 0.32)
    return [
        part("floor", quad([-1, 0, 1], [2, 0, 0], [0, 0, -2]), "white"),
        part("ceiling", _ceiling(), "white"),
        part("back_wall", box([-1, GAP, -1 - WALL], [1, 2 - GAP, -1 - GAP]), "white"),
        part("left_wall", box([-1 - WALL, GAP, -1], [-1 - GAP, 2 - GAP, 1]), "red"),
        part("right_wall", box([1 + GAP, GAP, -1], [1 + WALL, 2 - GAP, 1]), "green"),
        part("tall_box", tall, "white"),
        part("small_box", small, "white"),
    ]


def _ceiling() -> list[Surface]:
    """Four beams around a square opening."""
    low, high = 2.0, 2.0 + WALL
    return [
        box([-1, low, -1], [1, high, -0.55]),
        box([-1, low, 0.55], [1, high, 1]),
        box([-1, low, -0.55 + GAP], [-0.55, high, 0.55 - GAP]),
        box([0.55, low, -0.55 + GAP], [1, high, 0.55 - GAP]),
    ]
