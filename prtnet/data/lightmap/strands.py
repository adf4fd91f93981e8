"""Strands of hair as curves, and their texels: ten to a strand, along its length.

A strand is a uniform cubic B-spline, which is what Mitsuba and Embree intersect. Its ends are repeated by reflection,
so that it starts and ends at its first and last point; in between it smooths the corners of their polygon.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Float64, Int

from prtnet import PrtnetError
from prtnet.data.builtin import hair
from prtnet.data.part import Part

Array = np.ndarray

TEXELS = 10  # along a strand
STEPS = 16  # of the table of arc length, in each segment
# weights of the four control points of a segment, by powers of its parameter
BASIS = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6


@dataclass(frozen=True, eq=False)
class Strands:
    """s strands through about p points each, in unit coordinates, root first, all of one radius."""

    points: Float64[Array, "s p 3"]
    radius: float

    def __post_init__(self) -> None:
        if self.points.shape[0] < 1 or self.points.shape[1] < 2 or not self.radius > 0:
            raise PrtnetError(
                f"strands: found {self.points.shape[0]} of {self.points.shape[1]} points and a radius of"
                f" {self.radius:g}, expected at least one strand of two points, and a radius above 0"
            )
        if not np.all(self.arc[:, -1] > 0):
            raise PrtnetError("strands: found one without length, expected points that are apart")

    @property
    def count(self) -> int:
        return len(self.points)

    @property
    def segments(self) -> int:
        """Of one strand."""
        return self.points.shape[1] - 1

    @cached_property
    def controls(self) -> Float64[Array, "s c 3"]:
        """Control points of the splines."""
        first, last = (2 * self.points[:, end] - self.points[:, next_] for end, next_ in ((0, 1), (-1, -2)))
        return np.concatenate([first[:, None], self.points, last[:, None]], axis=1)

    @cached_property
    def arc(self) -> Float64[Array, "s a"]:
        """Length from the root at even steps of the parameter, STEPS to a segment."""
        along = np.linspace(0, self.segments, self.segments * STEPS + 1)
        place, _ = self.at(np.arange(self.count)[:, None], along[None])
        step = np.linalg.norm(np.diff(place, axis=1), axis=2)
        return np.pad(np.cumsum(step, axis=1), ((0, 0), (1, 0)))

    def at(
        self, strand: Int[Array, "*n"], parameter: Float[Array, "*m"]
    ) -> tuple[Float64[Array, "*k 3"], Float64[Array, "*k 3"]]:
        """Places and unit tangents, towards the tip, at parameters from 0 to `segments`."""
        segment = np.clip(np.floor(parameter).astype(int), 0, self.segments - 1)
        t = parameter - segment
        corners = self.controls[strand[..., None], segment[..., None] + np.arange(4)]
        powers = np.stack([np.ones_like(t), t, t * t, t**3], axis=-1)
        slopes = np.stack([np.zeros_like(t), np.ones_like(t), 2 * t, 3 * t * t], axis=-1)
        place, along = (np.einsum("...k,...kx->...x", each @ BASIS, corners) for each in (powers, slopes))
        return place, along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-12)

    def share(self, strand: Int[Array, " n"], parameter: Float[Array, " n"]) -> Float64[Array, " n"]:
        """The share of a strand's length from the root to a parameter. Inverse: `parameter`."""
        table = self.arc / self.arc[:, -1:]
        step = np.clip(parameter, 0, self.segments) * STEPS
        below = np.minimum(step.astype(int), table.shape[1] - 2)
        low, high = table[strand, below], table[strand, below + 1]
        return low + (step - below) * (high - low)

    def parameter(self, strand: Int[Array, " n"], share: Float[Array, " n"]) -> Float64[Array, " n"]:
        """Inverse of `share`."""
        table = self.arc / self.arc[:, -1:]
        # every strand's table between two whole numbers, so that one search serves all
        flat = (table + 2 * np.arange(self.count)[:, None]).ravel()
        found = np.searchsorted(flat, np.clip(share, 0, 1) + 2 * strand, side="right") - 1 - strand * table.shape[1]
        below = np.clip(found, 0, table.shape[1] - 2)
        low, high = table[strand, below], table[strand, below + 1]
        return (below + (share - low) / np.maximum(high - low, 1e-12)) / STEPS


def texels(strands: Strands) -> tuple[Float64[Array, "t 3"], Float64[Array, "t 3"]]:
    """Places and tangents in the middle of each texel, ten to a strand, one strand after the other."""
    strand = np.repeat(np.arange(strands.count), TEXELS)
    share = np.tile((np.arange(TEXELS) + 0.5) / TEXELS, strands.count)
    return strands.at(strand, strands.parameter(strand, share))


def blend(strand: Int[Array, " n"], share: Float[Array, " n"]) -> tuple[Int[Array, "n 2"], Float64[Array, "n 2"]]:
    """The two texels that a place on a strand lies between, and their weights; the outermost ones go on to the ends."""
    place = np.clip(np.asarray(share, np.float64) * TEXELS - 0.5, 0, TEXELS - 1)
    low = np.minimum(place.astype(int), TEXELS - 2)
    above = place - low
    return strand[:, None] * TEXELS + low[:, None] + np.arange(2), np.stack([1 - above, above], axis=1)


def layout(count: int) -> tuple[Int[Array, " t"], int]:
    """(flat texels, texels along one side) of a square texture for `count` strands: a strand is ten texels of a row."""
    size = TEXELS
    while size * (size // TEXELS) < count:
        size += 1
    row, place = np.divmod(np.arange(count), size // TEXELS)
    first = row * size + place * TEXELS
    return (first[:, None] + np.arange(TEXELS)).ravel(), size


def of_builtin(count: int, *, seed: int = 0, radius: float | None = None) -> tuple[Strands, Part]:
    """`count` strands of the built-in scene hair, even over the head, and the skull that they grow on, which is black.

    Fewer strands are thicker by the root of how many fewer, so that they cover about as much. Raises PrtnetError for
    more than there are.
    """
    paths = hair.strands(hair.POINTS, np.random.default_rng(seed))
    if not 1 <= count <= len(paths):
        raise PrtnetError(f"strands: found {count}, expected 1 to {len(paths)}")
    chosen = paths[np.linspace(0, len(paths) - 1, count).round().astype(int)]
    skull = hair.skull()
    both = np.concatenate([paths.reshape(-1, 3), skull.vertices])
    low, high = both.min(axis=0), both.max(axis=0)
    centre, scale = (low + high) / 2, 2 / (high - low).max()
    thick = hair.WIDTH / 2 * np.sqrt(len(paths) / count) * scale if radius is None else radius
    body = Part("skull", (skull.vertices - centre) * scale, skull.faces, albedo=np.zeros(3), two_sided=False)
    return Strands((chosen - centre) * scale, float(thick)), body


def ribbons(strands: Strands) -> Part:
    """Flat strips in the strands' place, for what wants triangles: hulls and shadows."""
    along = np.linspace(0, strands.segments, 2 * strands.segments + 1)
    place, tangent = strands.at(np.arange(strands.count)[:, None], along[None])
    side = np.cross(tangent, place)
    side /= np.maximum(np.linalg.norm(side, axis=2, keepdims=True), 1e-9)
    corners = np.stack([place - strands.radius * side, place + strands.radius * side], axis=2).reshape(-1, 3)
    steps = len(along)
    first = (np.arange(strands.count)[:, None] * steps + np.arange(steps - 1)) * 2
    faces = np.stack([first, first + 1, first + 3, first, first + 3, first + 2], axis=-1).reshape(-1, 3)
    return Part("strands", corners, faces.astype(np.int32), two_sided=True)


def straight(count: int, rng: np.random.Generator, *, length: float = 1.0, radius: float = 0.01) -> Strands:
    """A tuft: straight strands on a disc, about upright, for tests and first looks."""
    angle, away = 2 * np.pi * rng.random(count), 0.4 * np.sqrt(rng.random(count))
    root = np.stack([away * np.cos(angle), np.full(count, -length / 2), away * np.sin(angle)], axis=1)
    heading = np.array([0.0, 1.0, 0.0]) + 0.3 * rng.normal(size=(count, 3))
    heading *= length / np.linalg.norm(heading, axis=1, keepdims=True)
    return Strands(root[:, None] + np.linspace(0, 1, 4)[:, None] * heading[:, None], radius)


def text(strands: Strands) -> str:
    """As Mitsuba reads curves: a line for each control point, x y z and the radius, an empty line between strands."""
    rows: list[str] = []
    for controls in strands.controls.astype(np.float32):
        rows += [" ".join(repr(float(value)) for value in (*point, strands.radius)) for point in controls]
        rows.append("")
    return "\n".join(rows)
