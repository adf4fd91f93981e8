"""An implicit surface as a scene: its field in unit coordinates, its materials, and the way to its own coordinates."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from prtnet.data.implicit.field import Analytic, Field
from prtnet.data.implicit.shapes import Shape
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


def described(
    name: str,
    parts: Mapping[str, tuple[Shape, tuple[float, float, float]]],
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    *,
    smooth: float = 0.0,
    joined: Shape | None = None,
    lipschitz: float = 1.0,
    camera: str = "orbit",
) -> Described:
    """From parts by name: a shape and its albedo, linear RGB. `smooth`, `joined` and `lipschitz` as in `Analytic`."""
    shapes = tuple(shape for shape, _ in parts.values())
    materials = tuple(Material(part, np.asarray(albedo, np.float32)) for part, (_, albedo) in parts.items())
    return Described(name, Analytic(shapes, smooth, lipschitz, joined), materials, low, high, camera)


@dataclass(frozen=True, eq=False)
class Implicit:
    """A surface whose longest extent fills [-1, 1]. `field` is in unit coordinates, `frame` leads there."""

    name: str
    field: Field
    materials: tuple[Material, ...]
    frame: Frame
    camera: str = "orbit"
