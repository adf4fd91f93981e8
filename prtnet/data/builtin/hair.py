"""A bust under some thousand thin strips of hair: visibility at the scale of a strand."""

import numpy as np
from jaxtyping import Float

from prtnet.data.builtin.palette import part, steps
from prtnet.data.builtin.vessels import lathe
from prtnet.data.part import Part
from prtnet.data.shapes import Surface, ellipsoid, merge, revolve, smooth, tube

Array = np.ndarray
STRANDS = 3200
POINTS = 12
LENGTH = 0.95
WIDTH = 0.011
# half axes of the skull, about the origin; the face looks towards +z
SKULL = np.array([0.36, 0.47, 0.42])
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


def parts(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """Head, clothes and hair; the number of strands stays, tessellation cuts each into more pieces."""
    return [
        part("head", _head(tessellation), "skin"),
        part("eyes", _pair(ellipsoid([0.045, 0.026, 0.03], steps(20, tessellation, 8)), 0.13, 0.0, 0.372), "white"),
        part("pupils", _pair(ellipsoid([0.018, 0.018, 0.01], steps(16, tessellation, 8)), 0.13, 0.0, 0.397), "navy"),
        part("shirt", _shirt(tessellation), "cloth"),
        part("hair", _strips(strands(steps(POINTS, tessellation, 5), rng)), "hair", sheets=True),
    ]


def _pair(shape: Surface, x: float, y: float, z: float) -> list[Surface]:
    return [shape.moved(side * x, y, z) for side in (-1, 1)]


def _head(tessellation: float) -> list[Surface]:
    """Skull with jaw, nose, ears and neck: closed pieces that reach into each other."""
    nose = ellipsoid([0.045, 0.10, 0.075], steps(24, tessellation, 8)).moved(0, -0.08, 0.405)
    ears = _pair(ellipsoid([0.03, 0.085, 0.055], steps(20, tessellation, 8)), 0.355, -0.04, -0.02)
    lips = _pair(ellipsoid([0.06, 0.02, 0.03], steps(16, tessellation, 8)), 0.03, -0.245, 0.345)
    neck = tube(smooth([(0, -0.8, -0.06), (0, -0.55, -0.06), (0, -0.2, -0.02)], 8), 0.17, steps(32, tessellation, 8))
    return [skull(tessellation), nose, *ears, *lips, neck]


def skull(tessellation: float = 1.0) -> Surface:
    """Narrower towards the jaw."""
    round_ = ellipsoid([1, 1, 1], steps(64, tessellation, 12))
    below = np.clip(-round_.vertices[:, 1], 0, 1)
    narrow = np.stack([1 - 0.28 * below**1.5, 1 + 0.12 * below, 1 - 0.10 * below**2], axis=1)
    return Surface(round_.vertices * narrow * SKULL, round_.faces)


def _shirt(tessellation: float) -> Surface:
    """Shoulders on a round foot."""
    controls = [(0, -1.28), (0.50, -1.28), (0.56, -1.2), (0.58, -0.98), (0.46, -0.80), (0.25, -0.70), (0, -0.69)]
    shoulders = lathe(controls, tessellation, rows=28, segments=64)
    foot = revolve(
        [(0, -1.42), (0.3, -1.42), (0.3, -1.39), (0.14, -1.34), (0.12, -1.2), (0, -1.2)], steps(48, tessellation, 8)
    )
    return merge([shoulders.transformed(np.diag([1.3, 1, 0.72])), foot])


def _roots(rng: np.random.Generator) -> Float[Array, "n 3"]:
    """Directions of even density over the scalp: above the ears, and lower behind."""
    index = np.arange(2 * STRANDS)
    y = 1 - (index + 0.5) / STRANDS
    azimuth = index * GOLDEN_ANGLE
    radius = np.sqrt(1 - y**2)
    points = np.stack([radius * np.sin(azimuth), y, radius * np.cos(azimuth)], axis=1)
    hairline = 0.42 * np.maximum(points[:, 2], -0.9) + 0.12 + rng.normal(0, 0.02, len(points))
    return points[points[:, 1] > hairline]


def strands(count: int, rng: np.random.Generator) -> Float[Array, "n p 3"]:
    """Paths: out of the scalp, combed away from a parting, then down under gravity, kept off the skull."""
    normal = _roots(rng)
    place = normal * SKULL * 0.99
    layer = rng.uniform(1.02, 1.12, len(place))[:, None]
    # the parting runs from the forehead to the crown only
    aside = np.tanh((normal[:, 0] - 0.12) / np.where(normal[:, 2] > -0.2, 0.01, 0.6))
    comb = np.stack([0.6 * aside, np.zeros(len(place)), -0.5 - 0.3 * normal[:, 2]], axis=1)
    heading = normal * 0.45 + comb * 0.8 + rng.normal(0, 0.05, place.shape)
    pace = LENGTH * rng.uniform(0.75, 1.05, len(place))[:, None] / (count - 1)
    wave, path = rng.uniform(0, 2 * np.pi, len(place)), [place]
    for i in range(1, count):
        heading = heading + np.array([0, -5.0, 0]) / count * (1 + 3 * i / count)
        curl = 0.10 * np.sin(wave + 9 * i / count)[:, None] * np.cross(normal, [0.0, 1.0, 0.0])
        heading = heading / np.linalg.norm(heading, axis=1, keepdims=True)
        place = _outside(path[-1] + pace * (heading + curl), layer)
        path.append(place)
    return np.stack(path, axis=1)


def _outside(points: Float[Array, "n 3"], layer: Float[Array, "n 1"]) -> Float[Array, "n 3"]:
    """Points pushed out of the skull (and the neck below it) to their layer."""
    axes = np.where(points[:, 1:2] > 0, SKULL, SKULL * [1.0, 1.6, 1.0])
    depth = np.linalg.norm(points / axes, axis=1, keepdims=True)
    return np.where(depth < layer, points * layer / np.maximum(depth, 1e-6), points)


def _strips(paths: Float[Array, "n p 3"]) -> Surface:
    """Ribbons along the paths, flat on the head, thinner towards the tip."""
    strands, count = paths.shape[:2]
    along = np.gradient(paths, axis=1)
    side = np.cross(along, paths / SKULL**2)
    side /= np.maximum(np.linalg.norm(side, axis=2, keepdims=True), 1e-9)
    half = WIDTH / 2 * np.linspace(1, 0.35, count)[None, :, None]
    points = np.stack([paths - half * side, paths + half * side], axis=2).reshape(-1, 3)
    first = (np.arange(strands)[:, None] * count + np.arange(count - 1)) * 2
    a, b, c, d = first, first + 1, first + 3, first + 2
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return Surface(points, faces.astype(np.int32))
