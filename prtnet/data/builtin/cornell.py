"""The Cornell box (Goral et al. 1984), open in front and with an opening in the ceiling to let distant light in."""

import numpy as np

from prtnet.data.builtin.palette import part
from prtnet.data.part import Part
from prtnet.data.shapes import Surface, box

GAP = 0.002


def parts(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """Two boxes in an open box, 12 triangles for each solid whatever the tessellation.

    Walls run into each other (with different outer planes), so that no light leaks in at the corners.
    """
    tall = box([-0.3, 0, -0.3], [0.3, 1.2, 0.3]).turned(0.3 + rng.uniform(-0.05, 0.05)).moved(-0.36, GAP, -0.3)
    small = box([-0.29, 0, -0.29], [0.29, 0.58, 0.29]).turned(-0.31 + rng.uniform(-0.05, 0.05)).moved(0.37, GAP, 0.32)
    return [
        part("floor", box([-1.04, -0.05, -1.04], [1.04, 0, 1.01]), "white"),
        part("ceiling", _ceiling(), "white"),
        part("back_wall", box([-1.02, -0.02, -1.05], [1.02, 2.02, -1]), "white"),
        part("left_wall", box([-1.05, -0.03, -1.03], [-1, 2.03, 1]), "red"),
        part("right_wall", box([1, -0.03, -1.03], [1.05, 2.03, 1]), "green"),
        part("tall_box", tall, "white"),
        part("small_box", small, "white"),
    ]


def _ceiling() -> list[Surface]:
    """Four beams around a square opening."""
    return [
        box([-1.04, 2, -1.04], [1.04, 2.05, -0.55]),
        box([-1.04, 2, 0.55], [1.04, 2.05, 1.01]),
        box([-1.03, 2.001, -0.57], [-0.55, 2.049, 0.57]),
        box([0.55, 2.001, -0.57], [1.03, 2.049, 0.57]),
    ]
