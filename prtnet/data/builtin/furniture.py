"""Furniture that both living rooms are set with. Everything stands on y = 0 and looks towards +z; metres."""

from collections.abc import Sequence

import numpy as np

from prtnet.data.builtin.palette import steps
from prtnet.data.shapes import Surface, box, merge, panel, rounded_box, tilt_x

GAP = 0.003
# from foot to top: (radius, height), open at both ends
SHADE = [(0.20, 0.0), (0.12, 0.26)]
BOOK_COLOURS = ("rust", "navy", "mustard", "celadon")
# of a shelf: the tops of its boards
BOARDS = (0.105, 0.505, 0.905, 1.305)


def openings(columns: int, rows: int, free: Sequence[tuple[int, int]]) -> list[list[int]]:
    """The cells of a `panel` that are filled: all but `free`."""
    return [[int((i, j) not in free) for j in range(rows)] for i in range(columns)]


def sofa(width: float, tessellation: float) -> tuple[list[Surface], list[Surface]]:
    """(body, loose cushions) of a sofa, or of an armchair, with its middle at the origin."""
    arc, half = steps(2, tessellation, 1), width / 2
    body = [
        rounded_box([-half, 0.08, -0.42], [half, 0.30, 0.40], 0.03, arc),
        rounded_box([-half, 0.10, -0.44], [half, 0.78, -0.24], 0.06, arc),
        *(rounded_box([s * half - 0.09, 0.09, -0.43], [s * half + 0.09, 0.56, 0.42], 0.06, arc) for s in (-1, 1)),
        *(box([x - 0.025, GAP, z - 0.025], [x + 0.025, 0.1, z + 0.025]) for x in (-half, half) for z in (-0.36, 0.34)),
    ]
    count = round(width / 0.7)
    seat = (width - 0.2) / count
    cushions = []
    for i in range(count):
        left = -half + 0.1 + i * seat
        cushions.append(rounded_box([left + 0.005, 0.303, -0.23], [left + seat - 0.005, 0.44, 0.41], 0.05, arc))
        back = rounded_box([left + 0.01, 0.0, -0.07], [left + seat - 0.01, 0.42, 0.07], 0.06, arc)
        cushions.append(back.transformed(tilt_x(-0.16)).moved(0, 0.45, -0.10))
    return body, cushions


def low_table() -> Surface:
    """A plain top of 12 triangles on four legs."""
    legs = [box([x - 0.025, 0, z - 0.025], [x + 0.025, 0.36, z + 0.025]) for x in (-0.5, 0.5) for z in (-0.24, 0.24)]
    return merge([box([-0.56, 0.35, -0.30], [0.56, 0.385, 0.30]), *legs])


def shelf() -> Surface:
    """An open shelf of boards along z whose back is towards +x, with its middle at the origin."""
    boards = [box([-0.16, y, -0.73], [0.16, y + 0.025, 0.73]) for y in (0.08, 0.48, 0.88, 1.28, 1.68)]
    sides = [box([-0.17, 0, z - 0.0125], [0.17, 1.85, z + 0.0125]) for z in (-0.74, 0.0, 0.74)]
    return merge([*boards, *sides, box([0.165, 0.05, -0.735], [0.18, 1.8, 0.735])])


def books(rng: np.random.Generator) -> dict[str, list[Surface]]:
    """Rows of upright books of all sizes, with gaps, on the boards of `shelf`; by colour."""
    found: dict[str, list[Surface]] = {colour: [] for colour in BOOK_COLOURS}
    for y in BOARDS:
        for start in (-0.715, 0.025):
            z = start
            while z < start + rng.uniform(0.4, 0.62):
                thick, tall, deep = rng.uniform(0.018, 0.05), rng.uniform(0.2, 0.32), rng.uniform(0.14, 0.22)
                book = box([0.14 - deep, y + GAP, z], [0.14, y + tall, z + thick])
                found[BOOK_COLOURS[int(rng.integers(len(BOOK_COLOURS)))]].append(book)
                z += thick + 0.003
    return found


def frame(half_width: float, half_height: float) -> Surface:
    """The frame of a picture, about the origin, that stands 3 cm out of the wall z = 0."""
    w, h = half_width, half_height
    across, up = [-w - 0.03, -w, w, w + 0.03], [-h - 0.03, -h, h, h + 0.03]
    return panel(across, up, openings(3, 3, [(1, 1)]), 0.03).moved(z=0.03)


def canvas(half_width: float, half_height: float) -> Surface:
    """The picture in a `frame`."""
    w, h = half_width + 0.005, half_height + 0.005
    return box([-w, -h, 0.004], [w, h, 0.012])
