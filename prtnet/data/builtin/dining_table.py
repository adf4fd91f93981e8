"""A laid dining table with six chairs: thin slats and legs over a coarse floor."""

import numpy as np

from prtnet.data.builtin.palette import part, steps
from prtnet.data.builtin.vessels import fruit, knife, lathe, pile, plate, spoon, vessel
from prtnet.data.part import Part
from prtnet.data.shapes import Surface, box, ground, merge, revolve, rounded_box, tilt_x, tube

GAP = 0.002
TOP = 0.76
GLASS = [(0.030, 0.0), (0.033, 0.01), (0.036, 0.06), (0.040, 0.13)]
FRUIT_BOWL = [(0.07, 0.0), (0.075, 0.012), (0.12, 0.03), (0.165, 0.07), (0.185, 0.115)]
# centre of each seat, and the way it looks
SEATS = [
    (-0.5, 0.62, np.pi),
    (0.5, 0.62, np.pi),
    (-0.5, -0.62, 0.0),
    (0.5, -0.62, 0.0),
    (1.13, 0, -np.pi / 2),
    (-1.13, 0, np.pi / 2),
]


def parts(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """Table, chairs, and what stands on the table; the seed moves chairs, glasses and fruit a little."""
    chairs, cushions, plates, glasses, silver = [], [], [], [], []
    for x, z, look in SEATS:
        turn = look + float(rng.uniform(-0.12, 0.12))
        away = float(rng.uniform(0.0, 0.1))
        spot = (x - away * np.sin(look), 0.0, z - away * np.cos(look))
        chairs.append(_chair(tessellation).turned(turn).moved(*spot))
        cushions.append(rounded_box([-0.19, 0.462, -0.19], [0.19, 0.5, 0.19], 0.018, steps(3, tessellation, 1)))
        cushions[-1] = cushions[-1].turned(turn).moved(*spot)
        for collection, piece in zip((plates, glasses, silver), _cover(tessellation, rng), strict=True):
            collection.append(piece.turned(look).moved(x * 0.66 if z else x * 0.72, TOP + GAP, z * 0.5))
    bowl, content = _fruit_bowl(tessellation, rng)
    return [
        part("floor", ground(1.95, 1.5), "parquet"),
        part("table", _table(), "walnut"),
        part("runner", box([-0.6, TOP + GAP, -0.13], [0.6, TOP + 2 * GAP, 0.13]), "linen"),
        part("chairs", chairs, "oak"),
        part("cushions", cushions, "rust"),
        part("plates", plates, "porcelain"),
        part("glasses", glasses, "glass"),
        part("cutlery", silver, "silver"),
        part("fruit_bowl", bowl, "glazed_blue"),
        *(part(name, surfaces, name) for name, surfaces in content.items()),
        part("candlesticks", [_candlestick(tessellation).moved(x, TOP + 3 * GAP, 0) for x in (-0.45, 0.45)], "brass"),
        part("candles", [_candle(tessellation).moved(x, TOP + 3 * GAP, 0) for x in (-0.45, 0.45)], "wax"),
    ]


def _table() -> Surface:
    """A plank top, an apron and four tapered legs; the pieces reach into each other."""
    top = rounded_box([-1.0, TOP - 0.035, -0.45], [1.0, TOP, 0.45], 0.008, 1)
    apron = [box([-0.88, TOP - 0.11, s * 0.35 - 0.01], [0.88, TOP - 0.02, s * 0.35 + 0.01]) for s in (-1, 1)]
    apron += [box([s * 0.88 - 0.01, TOP - 0.108, -0.35], [s * 0.88 + 0.01, TOP - 0.02, 0.35]) for s in (-1, 1)]
    legs = [_leg(TOP - 0.02, 0.038).moved(x, GAP, z) for x in (-0.89, 0.89) for z in (-0.36, 0.36)]
    return merge([top, *apron, *legs])


def _leg(height: float, half: float) -> Surface:
    """A square leg that is slimmer at the floor."""
    leg = box([-half, 0, -half], [half, height, half])
    slim = np.where(leg.vertices[:, 1:2] > 0, 1.0, 0.6) * [1, 0, 1] + [0, 1, 0]
    return Surface(leg.vertices * slim, leg.faces)


def _chair(tessellation: float) -> Surface:
    """A chair that looks towards +z: seat, four legs, and a back of posts and slats that leans."""
    seat = rounded_box([-0.21, 0.43, -0.21], [0.21, 0.46, 0.21], 0.008, 1)
    legs = [_leg(0.44, 0.018).moved(x, GAP, z) for x in (-0.185, 0.185) for z in (-0.185, 0.185)]
    rungs = [box([-0.18, 0.20, z - 0.008], [0.18, 0.224, z + 0.008]) for z in (-0.185, 0.185)]
    posts = [box([x - 0.016, 0.0, -0.016], [x + 0.016, 0.52, 0.016]) for x in (-0.19, 0.19)]
    rails = [box([-0.18, y, -0.012], [0.18, y + h, 0.012]) for y, h in ((0.42, 0.08), (0.08, 0.04))]
    slats = [box([x - 0.014, 0.10, -0.006], [x + 0.014, 0.44, 0.006]) for x in (-0.12, -0.06, 0.0, 0.06, 0.12)]
    back = merge([*posts, *rails, *slats]).transformed(tilt_x(-0.13)).moved(0, 0.44, -0.19)
    dowel = tube(np.array([[-0.18, 0.14, 0.0], [0.18, 0.14, 0.0]]), 0.009, steps(10, tessellation, 5))
    return merge([seat, *legs, *rungs, back, dowel.moved(z=0.0)])


def _cover(tessellation: float, rng: np.random.Generator) -> tuple[Surface, Surface, Surface]:
    """Plates, glass and cutlery for one guest who looks towards +z; the middle of the plate is the origin."""
    small = plate(0.085, tessellation, depth=0.016).moved(y=0.022 * 0.34 + GAP)
    glass = vessel(GLASS, 0.003, 0.012, tessellation, rows=10, segments=32)
    glass = glass.moved(-0.15 + rng.uniform(-0.01, 0.01), 0, 0.12 + rng.uniform(-0.01, 0.01))
    silver = merge([knife(0.2).moved(-0.165), spoon(0.17, tessellation).moved(0.165)])
    return merge([plate(0.135, tessellation, depth=0.022), small]), glass, silver


def _fruit_bowl(tessellation: float, rng: np.random.Generator) -> tuple[Surface, dict[str, list[Surface]]]:
    """A bowl, and what is in it by material."""
    lift = TOP + 3 * GAP
    content: dict[str, list[Surface]] = {"apple": [], "orange": [], "pear": []}
    radius = 0.052
    for i, place in enumerate(pile(6, 1.72, rng) * radius):
        name = ("apple", "orange", "pear")[i % 3]
        shape = fruit(radius * 0.98, tessellation, tall=1.0 if name != "pear" else 1.2)
        content[name].append(shape.turned(i).moved(*place).moved(0, lift + 0.085, 0))
    return vessel(FRUIT_BOWL, 0.008, 0.018, tessellation, rows=16).moved(y=lift), content


def _candlestick(tessellation: float) -> Surface:
    controls = [
        (0, 0),
        (0.055, 0),
        (0.06, 0.008),
        (0.02, 0.03),
        (0.012, 0.06),
        (0.02, 0.09),
        (0.01, 0.12),
        (0.012, 0.2),
        (0.028, 0.22),
        (0, 0.224),
    ]
    return lathe(controls, tessellation, rows=40, segments=28)


def _candle(tessellation: float) -> Surface:
    return revolve([(0, 0.21), (0.012, 0.21), (0.0115, 0.40), (0.008, 0.41), (0, 0.408)], steps(20, tessellation, 6))
