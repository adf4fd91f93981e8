"""An implicit surface as a scene: its field in unit coordinates, its materials, and the way to its own coordinates."""

from dataclasses import dataclass

import numpy as np

from prtnet.data.implicit.field import Analytic, Field
from prtnet.data.scene import Frame, Material

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Described:
    """Shapes as somebody wrote them down: in units of their own, inside the box from `low` to `high`."""

    name: str
    field: Analytic
    materials: tuple[Material, ...]  # one for each shape of the field
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    camera: str = "orbit"


@dataclass(frozen=True, eq=False)
class Implicit:
    """A surface whose longest extent fills [-1, 1]. `field` is in unit coordinates, `frame` leads there."""

    name: str
    field: Field
    materials: tuple[Material, ...]
    frame: Frame
    camera: str = "orbit"
