"""A living room of about 20k triangles, seen from inside: coarse floor, rug and tables under windows and a skylight."""

import numpy as np

from prtnet.data.builtin.furniture import GAP, SHADE, books, canvas, frame, low_table, openings, shelf, sofa
from prtnet.data.builtin.palette import part, steps
from prtnet.data.builtin.plants import potted_tree
from prtnet.data.builtin.vessels import fruit, lathe, pile, vessel
from prtnet.data.part import Part
from prtnet.data.shapes import Surface, box, ground, panel, revolve, rounded_box, tilt_x, tube

WALL = 0.12
# half width (x), height, half depth (z)
SIZE = (2.6, 2.7, 2.2)


def parts(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """Walls with openings, sofa, armchair, tables, shelf with books, lamps, a plant, pictures."""
    half_x, _, half_z = SIZE
    rug = box([-1.35, GAP / 2, -0.75], [1.05, 0.015, 0.85])
    return [
        part("floor", ground(half_x + 0.05, half_z + 0.05), "parquet"),
        part("walls", _walls(), "plaster"),
        part("ceiling", _ceiling(), "white"),
        part("rug", rug, "rug"),
        *_seats(tessellation),
        part("tables", [low_table().moved(-0.1, 0.015 + GAP, 0.05), _side_table(tessellation)], "walnut"),
        *_on_tables(tessellation, rng),
        part("shelf", shelf().moved(half_x - 0.20, GAP, -0.75), "oak"),
        *_books(rng),
        *_lamps(tessellation),
        *potted_tree(0.8 * tessellation, rng, (-2.05, GAP, -1.65)),
        part("frames", [frame(w, h).moved(x, y, -half_z + GAP) for x, y, w, h in _pictures()], "walnut"),
        part("pictures", [canvas(w, h).moved(x, y, -half_z + GAP) for x, y, w, h in _pictures()], "linen"),
    ]


def _walls() -> list[Surface]:
    """Back wall, a left wall with two windows, a right wall, and a front wall that is mostly a terrace door.

    Walls run below the floor and through each other's ends, with different outer planes: no light leaks in.
    """
    x, y, z = SIZE
    low, high = -0.05, y + 0.05
    back = panel([-x - 0.1, x + 0.1], [low, high], [[1]], WALL).moved(z=-z)
    windows = panel(
        [-z - 0.06, -1.6, -0.35, 0.35, 1.6, z + 0.06],
        [low - 0.01, 0.85, 2.2, high + 0.01],
        openings(5, 3, [(1, 1), (3, 1)]),
        WALL,
    )
    right = panel([-z - 0.06, z + 0.06], [low - 0.01, high + 0.01], [[1]], WALL).turned(-np.pi / 2).moved(x)
    door = panel(
        [-x - 0.09, -1.3, 1.5, x + 0.09], [low - 0.02, 0.06, 2.25, high + 0.02], openings(3, 3, [(1, 1)]), WALL
    )
    return [back, windows.turned(np.pi / 2).moved(-x), right, door.turned(np.pi).moved(z=z)]


def _ceiling() -> Surface:
    """A plate with a skylight; it lies across the walls."""
    x, y, z = SIZE
    plate = panel([-x - 0.03, -0.9, 0.9, x + 0.03], [-z - 0.03, -0.9, 0.5, z + 0.03], openings(3, 3, [(1, 1)]), WALL)
    return plate.transformed(tilt_x(np.pi / 2)).moved(y=y)


def _seats(tessellation: float) -> list[Part]:
    body, cushions = sofa(2.0, tessellation)
    chair, chair_cushions = sofa(0.8, tessellation)
    arc = steps(2, tessellation, 1)
    throw = rounded_box([-0.2, -0.2, -0.06], [0.2, 0.2, 0.06], 0.055, arc)
    throws = [throw.transformed(tilt_x(-0.45)).turned(0.2).moved(x, 0.66, -1.40) for x in (-0.75, 0.62)]
    place = [s.moved(-0.1, 0, -1.45) for s in body + cushions]
    seat = [s.turned(-1.1).moved(1.35, 0, 0.75) for s in chair + chair_cushions]
    return [
        part("sofa", place[: len(body)] + seat[: len(chair)], "sofa"),
        part("sofa_cushions", place[len(body) :] + seat[len(chair) :], (0.21, 0.33, 0.41)),
        part("throws", [t.moved(-0.1) for t in throws], "mustard"),
    ]


def _side_table(tessellation: float) -> Surface:
    profile = [(0, 0), (0.17, 0), (0.17, 0.015), (0.025, 0.03), (0.02, 0.48), (0.22, 0.485), (0.22, 0.505), (0, 0.505)]
    return revolve(profile, steps(32, tessellation, 8)).moved(1.32, GAP, -1.55)


def _on_tables(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """A fruit bowl, a vase and some books on the coffee table."""
    top = 0.015 + GAP + 0.385 + GAP
    bowl = [(0.06, 0.0), (0.065, 0.01), (0.11, 0.03), (0.15, 0.065), (0.165, 0.10)]
    vase = [(0.05, 0), (0.06, 0.01), (0.095, 0.10), (0.07, 0.2), (0.035, 0.27), (0.05, 0.31)]
    places = pile(5, 1.45, rng) * 0.048 + [0.22, top + 0.075, 0.05]
    oranges = [fruit(0.047, 0.7 * tessellation).moved(*p) for p in places]
    stack = [
        box([-0.11, 0, -0.08], [0.11, 0.028, 0.08]).turned(a).moved(-0.45, top + i * 0.030, 0.02)
        for i, a in enumerate((0.3, 0.1, 0.5))
    ]
    return [
        part("bowl", vessel(bowl, 0.007, 0.015, tessellation, segments=36).moved(0.22, top, 0.05), "glazed_blue"),
        part("oranges", oranges, "orange"),
        part(
            "vase", vessel(vase, 0.006, 0.015, tessellation, rows=14, segments=28).moved(-0.12, top, -0.08), "celadon"
        ),
        part("stacked_books", stack, "navy"),
    ]


def _books(rng: np.random.Generator) -> list[Part]:
    place = (SIZE[0] - 0.20, GAP, -0.75)
    return [
        part(f"books_{colour}", [book.moved(*place) for book in found], colour)
        for colour, found in books(rng).items()
        if found
    ]


def _lamps(tessellation: float) -> list[Part]:
    """A standing lamp, a lamp on the side table, and one that hangs; shades are open two-sided sheets."""
    stand = [(0, 0), (0.15, 0), (0.15, 0.02), (0.015, 0.035), (0.012, 1.5), (0, 1.5)]
    profile = [(0, 0), (0.07, 0), (0.09, 0.06), (0.05, 0.16), (0.012, 0.22), (0.012, 0.32), (0, 0.325)]
    base = lathe(profile, tessellation, rows=18, segments=24)
    cord = tube(np.array([[1.45, 2.02, 1.3], [1.45, 2.71, 1.3]]), 0.006, steps(8, tessellation, 4))
    shade = revolve(SHADE, steps(40, tessellation, 8))
    globe = lathe([(0, 0), (0.09, 0.01), (0.16, 0.12), (0.10, 0.23), (0, 0.25)], tessellation, rows=14, segments=28)
    floor_lamp, table_lamp = (-1.75, GAP, 1.15), (1.32, 0.51 + GAP, -1.55)
    return [
        part(
            "lamp_stands",
            [revolve(stand, steps(32, tessellation, 8)).moved(*floor_lamp), base.moved(*table_lamp), cord],
            "brass",
        ),
        part(
            "lamp_shades",
            [shade.moved(*floor_lamp).moved(y=1.36), shade.moved(*table_lamp).moved(y=0.2)],
            "linen",
            sheets=True,
        ),
        part("globe", globe.moved(1.45, 1.79, 1.3), "porcelain"),
    ]


def _pictures() -> list[tuple[float, float, float, float]]:
    """x, y, half width, half height."""
    return [(-0.85, 1.62, 0.34, 0.25), (0.0, 1.66, 0.24, 0.31), (0.72, 1.60, 0.28, 0.21)]
