"""A wide living room of about 45k triangles, seen from inside: tall windows with curtains, seats about a fireplace."""

import numpy as np

from prtnet.data.builtin.arcade import cloth
from prtnet.data.builtin.furniture import GAP, SHADE, books, canvas, frame, low_table, openings, shelf, sofa
from prtnet.data.builtin.palette import part, steps
from prtnet.data.builtin.plants import potted_tree
from prtnet.data.builtin.vessels import cup, fruit, lathe, pile, plate, vessel
from prtnet.data.part import Part
from prtnet.data.shapes import Surface, box, ground, merge, panel, revolve, rounded_box, tilt_x, tube

WALL = 0.2
# half width (x), height, half depth (z)
SIZE = (3.6, 3.1, 2.7)
# x of the middles of the windows in the front wall (+z), their half width, sill and head
WINDOWS, HALF_WINDOW, SILL, HEAD = (-2.2, 0.0, 2.2), 0.62, 0.12, 2.55
VASE = [(0.06, 0), (0.075, 0.012), (0.12, 0.13), (0.09, 0.26), (0.045, 0.35), (0.065, 0.41)]
BOWL = [(0.07, 0.0), (0.075, 0.012), (0.13, 0.035), (0.175, 0.075), (0.19, 0.115)]
RUG = 0.016


def parts(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """Walls with windows and a skylight, seats, tables, two shelves, fireplace, lamps, a plant, pictures."""
    x, _, z = SIZE
    rug = box([-1.65, GAP / 2, -1.35], [1.65, RUG, 1.05])
    return [
        part("floor", ground(x + 0.05, z + 0.05), "parquet"),
        part("walls", _walls(), "plaster"),
        part("ceiling", [_ceiling(), *_beams()], "white"),
        part("window_frames", _window_frames(), "white"),
        *_curtains(tessellation, rng),
        part("rug", rug, "rug"),
        *_seats(tessellation, rng),
        part("tables", [low_table().moved(0, RUG + GAP, -0.2), _sideboard().moved(0.0, GAP, -z + 0.02)], "walnut"),
        *_on_tables(tessellation, rng),
        part("shelves", [shelf().moved(x - 0.19, GAP, side * 1.15) for side in (-1, 1)], "oak"),
        *_books(rng),
        *_fireplace(tessellation),
        *_lamps(tessellation),
        *potted_tree(tessellation, rng, (-x + 0.55, GAP, z - 0.85)),
        part("frames", [frame(w, h).moved(at, y, -z + GAP) for at, y, w, h in _pictures()], "walnut"),
        part("pictures", [canvas(w, h).moved(at, y, -z + GAP) for at, y, w, h in _pictures()], "linen"),
    ]


def _walls() -> list[Surface]:
    """A front wall with three tall windows, three plain walls; they run into each other, with other outer planes."""
    x, y, z = SIZE
    low, high = -0.05, y + 0.05
    across = [-x - 0.09, *(at + side * HALF_WINDOW for at in WINDOWS for side in (-1, 1)), x + 0.09]
    free = [(column, 1) for column in (1, 3, 5)]
    front = panel(across, [low - 0.02, SILL, HEAD, high + 0.02], openings(7, 3, free), WALL)
    back = panel([-x - 0.1, x + 0.1], [low, high], [[1]], WALL)
    side = panel([-z - 0.06, z + 0.06], [low - 0.01, high + 0.01], [[1]], WALL)
    return [
        front.turned(np.pi).moved(z=z),
        back.moved(z=-z),
        side.turned(np.pi / 2).moved(-x),
        side.turned(-np.pi / 2).moved(x),
    ]


def _ceiling() -> Surface:
    """A plate with a skylight; it lies across the walls."""
    x, y, z = SIZE
    across, along = [-x - 0.03, -1.3, 1.3, x + 0.03], [-z - 0.03, -1.1, 0.5, z + 0.03]
    return panel(across, along, openings(3, 3, [(1, 1)]), WALL).transformed(tilt_x(np.pi / 2)).moved(y=y)


def _beams() -> list[Surface]:
    """Beams below the ceiling along z, beside the skylight."""
    _, y, z = SIZE
    return [box([at - 0.07, y - 0.14, -z - 0.01], [at + 0.07, y + 0.01, z + 0.01]) for at in (-2.6, -1.6, 1.6, 2.6)]


def _window_frames() -> list[Surface]:
    """A frame with one post and two bars in each window."""
    w, z = HALF_WINDOW + 0.02, SIZE[2] + 0.09
    across, up = [-w, -w + 0.07, -0.02, 0.02, w - 0.07, w], [SILL - 0.02, SILL + 0.07, 1, 1.03, 1.8, 1.83, HEAD - 0.06]
    free = [(column, row) for column in (1, 3) for row in (1, 3, 5)]
    made = panel(across, [*up, HEAD + 0.02], openings(5, 7, free), 0.05)
    return [made.moved(at, 0, z) for at in WINDOWS]


def _curtains(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """Two pleated curtains at each window, from a rod to a hand above the floor."""
    z, top = SIZE[2] - 0.14, HEAD + 0.2
    rows, columns = steps(14, tessellation, 5), steps(52, tessellation, 14)
    path = np.linspace([0, top, 0], [0, 0.04, 0], rows)
    hung, rods = [], []
    for at in WINDOWS:
        for side in (-1, 1):
            made = cloth(path, 0.42, 0.045, 6, float(rng.uniform(0, 6)), columns)
            hung.append(made.moved(at + side * (HALF_WINDOW + 0.12), 0, z + 0.01))
        rod = np.array([[at - HALF_WINDOW - 0.42, top + 0.025, z], [at + HALF_WINDOW + 0.42, top + 0.025, z]])
        rods.append(tube(rod, 0.015, steps(10, tessellation, 5)))
        for side in (-1, 1):
            hook = at + side * (HALF_WINDOW + 0.38)
            rods.append(box([hook - 0.012, top + 0.015, z], [hook + 0.012, top + 0.035, SIZE[2] + 0.02]))
    return [part("curtains", hung, "curtain", sheets=True), part("curtain_rods", rods, "brass")]


def _seats(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """A sofa with its back to the windows, two armchairs opposite, cushions."""
    arc = steps(2, tessellation, 1)
    pieces = [(sofa(2.2, tessellation), np.pi, (0.0, 0.85))]
    for side in (-1, 1):
        turn = side * -0.55 + float(rng.uniform(-0.08, 0.08))
        pieces.append((sofa(0.85, tessellation), turn, (side * 1.15, -1.25)))
    body, cushions = [], []
    for (frames, loose), turn, (x, z) in pieces:
        body += [surface.turned(turn).moved(x, RUG, z) for surface in frames]
        cushions += [surface.turned(turn).moved(x, RUG, z) for surface in loose]
    throw = rounded_box([-0.21, -0.21, -0.06], [0.21, 0.21, 0.06], 0.055, arc).transformed(tilt_x(-0.5))
    throws = [throw.turned(np.pi + float(rng.uniform(-0.3, 0.3))).moved(x, 0.68, 0.74) for x in (-0.8, 0.82)]
    return [
        part("seats", body, "sofa"),
        part("seat_cushions", cushions, (0.24, 0.35, 0.40)),
        part("throws", throws, "mustard"),
    ]


def _sideboard() -> Surface:
    """A low cupboard against the back wall: doors, knobs and feet; its back is at z = 0."""
    body = box([-1.0, 0.16, 0.0], [1.0, 0.72, 0.42])
    top = rounded_box([-1.03, 0.71, -0.01], [1.03, 0.75, 0.45], 0.008, 1)
    doors = [box([x - 0.23, 0.20, 0.40], [x + 0.23, 0.68, 0.435]) for x in (-0.735, -0.245, 0.245, 0.735)]
    knobs = [box([x - 0.012, 0.44, 0.43], [x + 0.012, 0.464, 0.455]) for x in (-0.55, -0.06, 0.06, 0.55)]
    feet = [box([x - 0.03, 0, z - 0.03], [x + 0.03, 0.17, z + 0.03]) for x in (-0.92, 0.92) for z in (0.06, 0.36)]
    return merge([body, top, *doors, *knobs, *feet])


def _on_tables(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """Fruit, cups and books on the low table; vases, a bowl and a lamp's foot on the sideboard."""
    low, high = RUG + GAP + 0.385 + GAP, 0.75 + 2 * GAP
    back = -SIZE[2] + 0.24
    bowl = vessel(BOWL, 0.008, 0.017, tessellation, rows=14, segments=40)
    fruits = [
        fruit(0.052, 0.8 * tessellation).moved(*place)
        for place in pile(6, 1.72, rng) * 0.053 + [0.24, low + 0.085, -0.16]
    ]
    stack = [
        rounded_box([-0.12, 0, -0.085], [0.12, 0.028, 0.085], 0.004, 1).turned(a).moved(-0.38, low + i * 0.03, -0.26)
        for i, a in enumerate((0.3, 0.12, 0.5, 0.35))
    ]
    cups = [
        merge([plate(0.085, 0.6 * tessellation), cup(0.6 * tessellation).transformed(np.eye(3) * 0.42).moved(y=0.012)])
        .turned(float(rng.uniform(0, 6)))
        .moved(x, low, z)
        for x, z in ((-0.08, -0.38), (-0.02, -0.03))
    ]
    vases = [
        vessel(VASE, 0.007, 0.02, tessellation, rows=16, segments=32)
        .transformed(np.diag([wide, tall, wide]))
        .moved(x, high, back)
        for x, wide, tall in ((-0.78, 1.0, 1.0), (-0.52, 0.8, 0.62))
    ]
    return [
        part("bowl", bowl.moved(0.24, low, -0.16), "glazed_blue"),
        part("oranges", fruits, "orange"),
        part("stacked_books", stack, "navy"),
        part("cups", cups, "porcelain"),
        part("vases", vases, "celadon"),
    ]


def _books(rng: np.random.Generator) -> list[Part]:
    """Both shelves filled."""
    found: dict[str, list[Surface]] = {}
    for side in (-1, 1):
        for colour, row in books(rng).items():
            found.setdefault(colour, []).extend(book.moved(SIZE[0] - 0.19, GAP, side * 1.15) for book in row)
    return [part(f"books_{colour}", row, colour) for colour, row in found.items()]


def _fireplace(tessellation: float) -> list[Part]:
    """A chimney breast on the left wall with an open hearth, a mantelpiece, and logs."""
    x = -SIZE[0]
    across, up = [-0.85, -0.5, 0.5, 0.85], [-0.04, 0.02, 0.8, SIZE[1] + 0.02]
    breast = panel(across, up, openings(3, 3, [(1, 1)]), 0.52).turned(np.pi / 2).moved(x + 0.5, 0, -0.1)
    mantel = [
        box([x + 0.49, 1.06, -1.05], [x + 0.68, 1.12, 0.85]),
        *(box([x + 0.49, GAP, at - 0.1], [x + 0.60, 1.07, at + 0.1]) for at in (-0.75, 0.55)),
        box([x + 0.49, 0.86, -0.84], [x + 0.58, 1.07, 0.64]),
        box([x + 0.48, GAP, -0.95], [x + 0.95, 0.03, 0.75]),
    ]
    back = box([x - 0.01, 0.01, -0.61], [x + 0.03, 0.81, 0.41])
    log = tube(np.array([[x + 0.22, 0.08, -0.38], [x + 0.25, 0.08, 0.2]]), 0.055, steps(12, tessellation, 6))
    logs = [log.moved(d, h) for d, h in ((0.0, 0.0), (0.13, 0.0), (0.065, 0.095))]
    return [
        part("chimney", breast, "brick"),
        part("hearth", back, "slate"),
        part("mantel", mantel, "marble"),
        part("logs", logs, "walnut"),
    ]


def _lamps(tessellation: float) -> list[Part]:
    """A standing lamp by the sofa, a lamp on the sideboard, three globes that hang."""
    stand = [(0, 0), (0.15, 0), (0.15, 0.02), (0.015, 0.035), (0.012, 1.5), (0, 1.5)]
    foot = [(0, 0), (0.07, 0), (0.09, 0.06), (0.05, 0.16), (0.012, 0.22), (0.012, 0.32), (0, 0.325)]
    globe = lathe([(0, 0), (0.08, 0.01), (0.14, 0.11), (0.09, 0.2), (0, 0.22)], tessellation, rows=14, segments=28)
    shade = revolve(SHADE, steps(40, tessellation, 8))
    floor_lamp, table_lamp = (1.75, GAP, 1.25), (0.72, 0.75 + 2 * GAP, -SIZE[2] + 0.24)
    cords, globes = [], []
    for x, y, z in ((-2.1, 2.05, 1.0), (-2.1, 2.05, -1.6), (2.1, 2.2, 0.0)):
        cords.append(tube(np.array([[x, y + 0.2, z], [x, SIZE[1] + 0.01, z]]), 0.006, steps(8, tessellation, 4)))
        globes.append(globe.moved(x, y, z))
    stands = [revolve(stand, steps(32, tessellation, 8)).moved(*floor_lamp)]
    stands.append(lathe(foot, tessellation, rows=18, segments=24).moved(*table_lamp))
    shades = [shade.moved(*floor_lamp).moved(y=1.36), shade.moved(*table_lamp).moved(y=0.2)]
    return [
        part("lamp_stands", [*stands, *cords], "brass"),
        part("lamp_shades", shades, "linen", sheets=True),
        part("globes", globes, "porcelain"),
    ]


def _pictures() -> list[tuple[float, float, float, float]]:
    """x, y, half width, half height; all on the back wall."""
    return [(-2.35, 1.65, 0.42, 0.3), (-0.55, 1.72, 0.26, 0.34), (0.1, 1.68, 0.2, 0.26), (2.3, 1.65, 0.36, 0.44)]
