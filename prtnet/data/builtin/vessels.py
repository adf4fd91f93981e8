"""Things from the potter's wheel that several scenes set on their tables. All are closed and stand on y = 0."""

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from prtnet.data.builtin.palette import steps
from prtnet.data.shapes import Surface, box, ellipsoid, merge, revolve, smooth, tube

Array = np.ndarray


def lathe(controls: ArrayLike, tessellation: float, *, rows: int = 24, segments: int = 48) -> Surface:
    """A smooth solid of revolution; the control points go from the axis below, by the outer side, to the axis above."""
    curve = smooth(controls, steps(rows, tessellation, len(np.asarray(controls))))
    curve[:, 0] = np.maximum(curve[:, 0], 1e-3)
    curve[[0, -1], 0] = 0
    return revolve(curve, steps(segments, tessellation, 8))


def vessel(
    outer: ArrayLike, thickness: float, floor: float, tessellation: float, *, rows: int = 12, segments: int = 48
) -> Surface:
    """A hollow vessel: `outer` goes from the foot to the rim, the inner wall follows at `thickness` down to `floor`."""
    curve = smooth(outer, steps(rows, tessellation, 4))
    inside = curve[curve[:, 1] > floor + thickness][::-1] - [thickness, 0]
    inside = inside[inside[:, 0] > thickness]
    bottom = [[0.6 * inside[-1, 0], floor], [0, floor]]
    rim = curve[-1] + [-thickness / 2, thickness / 3]
    profile = np.concatenate([[[0, curve[0, 1]]], curve, [rim], inside, bottom])
    return revolve(profile, steps(segments, tessellation, 8))


def inner_radius(outer: ArrayLike, thickness: float, height: float) -> float:
    """Radius in the middle of a vessel's wall at a height: where the border of its content is hidden."""
    curve = smooth(outer, 200)
    return float(np.interp(height, curve[:, 1], curve[:, 0]) - thickness / 2)


def disc(radius: float, y: float, tessellation: float, *, segments: int = 40) -> Surface:
    """A flat surface that faces up: the content of a vessel."""
    return revolve([(radius, y), (radius / 2, y), (0, y)], steps(segments, tessellation, 8))


def plate(radius: float, tessellation: float, *, depth: float = 0.025) -> Surface:
    """A plate with a foot and a flat rim."""
    below = [(0, 0), (0.52, 0), (0.56, 0.1), (0.72, 0.45), (0.98, 0.9), (1.0, 1.0)]
    above = [(0.97, 1.08), (0.74, 0.72), (0.60, 0.42), (0.5, 0.36), (0, 0.34)]
    return revolve(np.array(below + above) * [radius, depth], steps(56, tessellation, 8))


def handle(controls: ArrayLike, radius: float, tessellation: float, *, rows: int = 20) -> Surface:
    """A bent tube."""
    path = smooth(controls, steps(rows, tessellation, 6))
    return tube(path, radius, steps(12, tessellation, 5))


CUP = [(0.045, 0.0), (0.055, 0.012), (0.095, 0.04), (0.122, 0.10), (0.132, 0.155)]


def cup(tessellation: float) -> Surface:
    """A tea cup of 0.26 across, with a handle towards +x; its content belongs at y = 0.125."""
    grip = handle([(0.118, 0.115, 0), (0.175, 0.125, 0), (0.185, 0.075, 0), (0.105, 0.05, 0)], 0.011, tessellation)
    return merge([vessel(CUP, 0.008, 0.015, tessellation, rows=14), grip])


def spoon(length: float, tessellation: float) -> Surface:
    """A spoon along z whose bowl is at +z; it lies on y = 0."""
    bowl = ellipsoid([0.14 * length, 0.03 * length, 0.2 * length], steps(20, tessellation, 8))
    path = smooth([(0, 0.03, 0.15), (0, 0.06, -0.2), (0, 0.03, -0.75)], steps(10, tessellation, 4)) * length
    return merge([bowl.moved(0, 0.03 * length, 0.3 * length), tube(path, 0.022 * length, steps(8, tessellation, 4))])


def knife(length: float) -> Surface:
    """A knife along z: two slim boxes that overlap a little."""
    blade = box([-0.04 * length, 0.004, -0.05 * length], [0.04 * length, 0.010, 0.5 * length])
    return merge([blade, box([-0.035 * length, 0.002, -0.5 * length], [0.035 * length, 0.018, 0])])


def fruit(radius: float, tessellation: float, *, tall: float = 1.0) -> Surface:
    """A round fruit with a dent at its stem, about its own centre."""
    controls = [(0, -0.88), (0.45, -0.9), (0.9, -0.4), (1.0, 0.1), (0.75, 0.68), (0.3, 0.88), (0, 0.72)]
    return lathe(np.array(controls) * [radius, radius * tall], tessellation, rows=18, segments=28)


def pile(count: int, spread: float, rng: np.random.Generator) -> Float[Array, "n 3"]:
    """Places of equal round things that lie close in a bowl: a ring and one on top, in units of their radius."""
    ring = np.arange(count - 1) * 2 * np.pi / (count - 1) + rng.uniform(0, 1)
    around = np.stack([np.sin(ring) * spread, np.zeros(count - 1), np.cos(ring) * spread], axis=1)
    return np.concatenate([around, [[0, 1.15, 0]]])
