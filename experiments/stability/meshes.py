"""Small scenes, each with one difficulty that a number makes worse, written as OBJ files."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from prtnet import store
from prtnet.data import shapes
from prtnet.data.shapes import Surface

Array = np.ndarray
Parts = Mapping[str, Surface]

# Kd of the parts, sRGB
COLOURS = {
    "floor": (0.80, 0.78, 0.74),
    "box": (0.78, 0.44, 0.30),
    "plate": (0.45, 0.60, 0.72),
    "rug": (0.35, 0.58, 0.42),
    "ball": (0.85, 0.66, 0.30),
    "grating": (0.70, 0.70, 0.66),
}
EXTENT = 3.0  # of the small scenes: the side of their floor


def contact(gap: float) -> Parts:
    """A box that hovers above a floor, or stands on it."""
    box = shapes.box([-0.5, gap, -0.5], [0.5, gap + 0.6, 0.5])
    return {"floor": _floor(EXTENT), "box": box.turned(0.5)}


def holes(width: float) -> Parts:
    """A plate of size 2 with 3 x 3 square holes, above a floor."""
    middles = np.array([-0.6, 0.0, 0.6])
    lines = np.sort(np.concatenate([[-1.0, 1.0], middles - width / 2, middles + width / 2]))
    filled = np.ones((7, 7), bool)
    filled[1::2, 1::2] = False
    # made upright, facing +z, and laid down to face +y
    plate = shapes.panel(lines, lines, filled, 0.04).transformed(shapes.tilt_x(-np.pi / 2))
    return {"floor": _floor(EXTENT), "plate": plate.moved(y=0.4)}


def coplanar(gap: float | None) -> Parts:
    """A rug above a floor, and a box on it. Without a gap at all the rug is as large as the floor, twice the same."""
    rug = _floor(EXTENT) if gap is None else shapes.ground(0.9, 0.9, gap)
    box = shapes.box([-0.3, 0.01, -0.3], [0.3, 0.5, 0.3])
    return {"floor": _floor(EXTENT), "rug": rug, "box": box.turned(0.5)}


def plane(size: float) -> Parts:
    """A ball of size 1 on a square of so many times its size."""
    ball = shapes.ellipsoid([0.5, 0.5, 0.5], 48)
    return {"floor": _floor(size), "ball": ball.moved(y=0.5)}


def grating(period: float) -> Parts:
    """Square grooves, half a period wide and deep: the same shape at each period, but for their number."""
    starts = np.arange(round(2 / period)) * period - 1
    # up, across, down, across
    x = np.concatenate([starts[:, None] + period * np.array([0, 0, 0.5, 0.5])], axis=1).ravel()
    y = np.tile([0, period / 2, period / 2, 0], len(starts))
    x, y = np.append(x, 1.0), np.append(y, 0.0)
    rows = [np.stack([x, y, np.full_like(x, z)], axis=1) for z in (1.0, -1.0)]
    return {"grating": shapes.sheet(np.stack(rows)[:, ::-1])}


def _floor(size: float) -> Surface:
    return shapes.ground(size / 2, size / 2)


def far(parts: Parts, sizes: float, *, rounded: bool = False) -> Parts:
    """The scene so many times its size away; `rounded` to float32, as binary files keep it."""
    moved = {name: part.moved(*(sizes * EXTENT * np.array([1.0, 0.3, -0.7]))) for name, part in parts.items()}
    return {name: Surface(_rounded(part.vertices), part.faces) if rounded else part for name, part in moved.items()}


def _rounded(vertices: Float[Array, "v 3"]) -> Float[Array, "v 3"]:
    return vertices.astype(np.float32).astype(np.float64)


def write(path: Path, parts: Parts) -> Path:
    """An OBJ file with a material for each part; numbers keep all digits of float64."""
    lines, materials, start = [f"mtllib {path.stem}.mtl"], [], 1
    for name, part in parts.items():
        lines += [f"o {name}", f"usemtl {name}"]
        lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in part.vertices.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (part.faces + start).tolist()]
        start += len(part.vertices)
        materials.append(f"newmtl {name}\nKd {' '.join(map(str, COLOURS[name]))}\n")
    store.write_text(path.with_suffix(".mtl"), "".join(materials))
    store.write_text(path, "\n".join(lines) + "\n")
    return path
