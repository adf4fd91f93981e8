"""Small implicit surfaces to draw."""

import numpy as np

from prtnet.data.implicit.field import Analytic
from prtnet.data.implicit.operators import difference, moved
from prtnet.data.implicit.shapes import Shape, box, sphere, torus
from prtnet.data.implicit.surface import Implicit
from prtnet.data.scene import IDENTITY, Material

COLOURS = ((0.8, 0.2, 0.1), (0.2, 0.7, 0.3), (0.5, 0.5, 0.6))


def surface(*shapes: Shape, lipschitz: float = 1.0) -> Implicit:
    """Shapes in unit coordinates, one material each."""
    colours = [np.array(colour, np.float32) for colour in COLOURS]
    materials = tuple(Material(f"part {i}", colours[i]) for i in range(len(shapes)))
    return Implicit("test", Analytic(shapes, lipschitz=lipschitz), materials, IDENTITY)


def still_life(lipschitz: float = 1.0) -> Implicit:
    """A bitten ball in a ring over a plate."""
    ball = difference(sphere(0.5), moved(sphere(0.3), 0.3, 0.3, 0.3))
    ring, plate = moved(torus(0.6, 0.12), 0, -0.3, 0), moved(box(1.0, 0.05, 1.0, round=0.02), 0, -0.6, 0)
    return surface(ball, ring, plate, lipschitz=lipschitz)
