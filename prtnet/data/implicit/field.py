"""What an implicit surface offers, whatever it is made of; and the kind that is made of shapes.

A field is a distance in unit coordinates, below 0 inside, of which a ray may walk |distance| / lipschitz without
stepping through the surface {distance = 0}.
"""

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from prtnet.data.implicit.derivative import with_gradient
from prtnet.data.implicit.expression import CALLS, INFIX, POINT, Program
from prtnet.data.implicit.operators import moved, scaled, union
from prtnet.data.implicit.shapes import Shape
from prtnet.data.scene import Frame

Array = np.ndarray

LEAST_SLOPE, STEP = 1e-3, 1e-5  # below that slope, differences over twice that step
CHUNK = 1 << 14  # points whose steps stay in the cache

_PYTHON = {
    **INFIX,
    **CALLS,
    # as the processor's own instructions
    "min": "{0} if {0} < {1} else {1}",
    "max": "{0} if {0} > {1} else {1}",
    "select": "{2} if {0} < {1} else {3}",
}


@runtime_checkable
class Field(Protocol):
    """A distance that sphere tracing can walk by. `Analytic` is of shapes, `Neural` a network."""

    @property
    def lipschitz(self) -> float:
        """The greatest slope of the distance where rays go."""
        ...

    def distance(self, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
        """Float64: the plain twin of all compiled forms."""
        ...

    def gradient(self, points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Of the distance, not normalised, float64."""
        ...

    def part(self, points: Float[Array, "n 3"]) -> Int[Array, " n"]:
        """Index of the material at points of the surface."""
        ...

    def source(self) -> str:
        """Python text of `distance(x, y, z)` in float32 scalars, for numba: it may use sqrt, floor, sin, cos, abs and
        F, which makes a float32 of a literal."""
        ...

    def digest(self) -> str:
        """sha256 of all that the surface depends on."""
        ...


@dataclass(frozen=True, eq=False)
class Analytic:
    """Shapes, one for each material, joined within the distance `smooth`.

    Where some are to be joined otherwise than the rest, `joined` is the surface and the shapes only tell its materials.
    """

    shapes: tuple[Shape, ...]
    smooth: float = 0.0
    lipschitz: float = 1.0
    joined: Shape | None = None

    def in_frame(self, frame: Frame) -> "Analytic":
        """The same surface in the coordinates of a frame, with its distances in these units."""
        x, y, z = (float(value) for value in frame.centre)

        def brought(shape: Shape) -> Shape:
            return scaled(moved(shape, -x, -y, -z), frame.scale)

        joined = None if self.joined is None else brought(self.joined)
        return Analytic(tuple(map(brought, self.shapes)), self.smooth * frame.scale, self.lipschitz, joined)

    @cached_property
    def whole(self) -> Shape:
        return self.joined or union(*self.shapes, smooth=self.smooth)

    @cached_property
    def program(self) -> Program:
        """The distance alone."""
        return Program([self.whole(POINT)])

    @cached_property
    def slopes(self) -> Program:
        """The distance and its gradient."""
        return with_gradient(self.whole(POINT))

    @cached_property
    def parts(self) -> Program:
        """The distances of all parts."""
        return Program([shape(POINT) for shape in self.shapes])

    def distance(self, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
        return _evaluated(self.program, points)[:, 0]

    def gradient(self, points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        return _evaluated(self.slopes, points)[:, 1:]

    def part(self, points: Float[Array, "n 3"]) -> Int[Array, " n"]:
        """The nearest shape."""
        return _evaluated(self.parts, points).argmin(axis=1)

    def source(self) -> str:
        lines, (result,) = self.program.spelled("    {name} = {value}", _PYTHON, lambda value: f"F({value!r})")
        return "\n".join(["def distance(x, y, z):", *lines, f"    return {result}", ""])

    def digest(self) -> str:
        both = self.program.digest() + self.parts.digest() + repr(self.lipschitz)
        return hashlib.sha256(both.encode()).hexdigest()


def _evaluated(program: Program, points: Float[Array, "n 3"]) -> Float[Array, "n r"]:
    points = np.asarray(points, np.float64)
    out = np.empty((len(points), len(program.results)))
    for first in range(0, len(points), CHUNK):
        part = slice(first, first + CHUNK)
        x, y, z = points[part].T.copy()
        for column, values in enumerate(program.evaluate(x, y, z)):
            out[part, column] = values
    return out


def unit_gradient(field: Field, points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Normals: gradients of unit length, upwards where there is none.

    Exactly on the face of a box the two branches of its distance meet and neither has a slope: differences have.
    """
    found = field.gradient(points)
    length = np.linalg.norm(found, axis=1, keepdims=True)
    flat = np.flatnonzero(length < LEAST_SLOPE)
    if len(flat):
        sides = [np.asarray(points, np.float64)[flat] + side * STEP * np.eye(3)[:, None] for side in (1, -1)]
        ahead, behind = (field.distance(side.reshape(-1, 3)).reshape(3, -1) for side in sides)
        found[flat] = (ahead - behind).T / (2 * STEP)
        length[flat] = np.linalg.norm(found[flat], axis=1, keepdims=True)
    return np.where(length > 1e-12, found / np.maximum(length, 1e-12), np.array([0.0, 1.0, 0.0]))
