"""What stands and hangs in the court of `colonnade`: cloths, sails, urns, benches, lanterns, a basin."""

import numpy as np

from prtnet.data.builtin import arcade
from prtnet.data.builtin.palette import part, steps
from prtnet.data.builtin.vessels import disc, inner_radius, vessel
from prtnet.data.part import Part
from prtnet.data.shapes import Surface, box, merge, smooth, tube

GAP = 0.003
CLOTHS = {"cloth_red": "crimson", "cloth_blue": "ultramarine", "cloth_gold": "mustard"}
URN = [(0.16, 0.0), (0.17, 0.03), (0.07, 0.09), (0.08, 0.13), (0.24, 0.32), (0.27, 0.50), (0.17, 0.66), (0.23, 0.74)]
BASIN = [(1.2, 0.0), (1.22, 0.05), (1.16, 0.1), (1.2, 0.4), (1.3, 0.46), (1.3, 0.52)]
BOWL = [(0.2, 0.0), (0.16, 0.06), (0.13, 0.5), (0.16, 0.6), (0.55, 0.74), (0.6, 0.8)]


def furniture(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """All of it; the court is 18 by 8 with columns round it, its floor at 0, that of the walks at 0.3."""
    urns, plinths = _urns(tessellation, rng)
    return [
        *_cloths(tessellation, rng),
        part("sails", _sails(tessellation, rng), "linen", sheets=True),
        part("urns", urns, "bronze"),
        part("plinths", plinths, "sandstone"),
        part("benches", _benches(rng), "limestone"),
        *_basin(tessellation),
        part("lanterns", _lanterns(tessellation), "bronze"),
    ]


def _cloths(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """Cloths over the balustrade of the long sides: from the walk over the rail down in front of the arches."""
    found: dict[str, list[Surface]] = {name: [] for name in CLOTHS}
    rows, columns = steps(18, tessellation, 6), steps(26, tessellation, 8)
    names = list(CLOTHS)
    for side in (-1, 1):
        first = int(rng.integers(len(names)))
        for i, bay in enumerate((-3, -1, 1, 3)):
            drop = float(rng.uniform(1.9, 2.3))
            over = [(0, 4.85, -0.17), (0, 5.12, -0.16), (0, 5.25, -0.12), (0, 5.265, 0.0), (0, 5.25, 0.15)]
            path = smooth([*over, (0, 5.0, 0.30), (0, 4.4, 0.46), (0, 5.2 - drop, 0.47)], rows)
            made = arcade.cloth(path, 1.25, 0.07, float(rng.uniform(3, 4)), float(rng.uniform(0, 6)), columns)
            placed = made.turned(np.pi * (side > 0)).moved(2.0 * bay, 0, 4.0 * side)
            found[names[(first + i) % len(names)]].append(placed)
    return [part(name, made, CLOTHS[name], sheets=True) for name, made in found.items()]


def _sails(tessellation: float, rng: np.random.Generator) -> list[Surface]:
    """Three sails across the court, from cornice to cornice, that sag."""
    rows, columns = steps(24, tessellation, 8), steps(10, tessellation, 4)
    made = []
    for x in (-5.5, 0.0, 5.5):
        t = np.linspace(-1, 1, rows)
        sag = float(rng.uniform(0.9, 1.2))
        path = np.stack([np.zeros(rows), 7.9 - sag * (1 - t**2), 3.8 * t], axis=1)
        sail = arcade.cloth(path, 2.4, 0.05, 1.5, float(rng.uniform(0, 6)), columns)
        made.append(sail.moved(x + rng.uniform(-0.2, 0.2)))
    return made


def _urns(tessellation: float, rng: np.random.Generator) -> tuple[list[Surface], list[Surface]]:
    """(urns, what they stand on), on the floor of the court by the steps."""
    urn = vessel(URN, 0.02, 0.14, tessellation, rows=14, segments=20)
    plinth = merge([box([-0.24, GAP, -0.24], [0.24, 0.12, 0.24]), box([-0.2, 0.1, -0.2], [0.2, 0.55, 0.2])])
    plinth = merge([plinth, box([-0.23, 0.54, -0.23], [0.23, 0.62, 0.23])])
    urns, plinths = [], []
    for x in (-7.0, -3.0, 3.0, 7.0):
        for side in (-1, 1):
            at = x + float(rng.uniform(-0.15, 0.15)), 0.0, 2.85 * side
            urns.append(urn.turned(float(rng.uniform(0, 6))).moved(*at).moved(y=0.62 + GAP))
            plinths.append(plinth.turned(float(rng.uniform(-0.1, 0.1))).moved(*at))
    return urns, plinths


def _benches(rng: np.random.Generator) -> list[Surface]:
    """Stone benches in the court, and along the walks by the outer wall."""
    bench = merge(
        [
            box([-0.8, 0.40, -0.22], [0.8, 0.48, 0.22]),
            *(box([x - 0.09, GAP, -0.17], [x + 0.09, 0.41, 0.17]) for x in (-0.55, 0.55)),
        ]
    )
    made = []
    for side in (-1, 1):
        for x in (-5.0, 5.0):
            made.append(bench.turned(float(rng.uniform(-0.05, 0.05))).moved(x, 0, 2.8 * side))
        for bay in sorted(rng.choice(4, 2, replace=False).tolist()):
            made.append(bench.moved(4.0 * bay - 6.0, 0.3, 6.15 * side))
    return made


def _basin(tessellation: float) -> list[Part]:
    """A basin with a bowl on a stem in the middle of the court, both with water."""
    basin = vessel(BASIN, 0.16, 0.06, tessellation, rows=14, segments=36).moved(y=GAP)
    bowl = vessel(BOWL, 0.03, 0.62, tessellation, rows=16, segments=28).moved(y=0.06)
    water = [
        disc(inner_radius(BASIN, 0.16, 0.36), 0.36 + GAP, tessellation),
        disc(inner_radius(BOWL, 0.03, 0.76), 0.82, tessellation),
    ]
    return [part("basin", [basin, bowl], "marble"), part("water", water, "water")]


def _lanterns(tessellation: float) -> list[Surface]:
    """Lanterns on rods from the crowns of some vaults."""
    made = []
    for x in (-8.0, -4.0, 0.0, 4.0, 8.0):
        for z in (-5.42, 5.42):
            rod = tube(np.array([[x, 3.35, z], [x, 4.1, z]]), 0.012, steps(6, tessellation, 4))
            cage = [box([x - w, y, z - w], [x + w, y + h, z + w]) for w, y, h in ((0.1, 2.98, 0.03), (0.11, 3.3, 0.05))]
            panes = box([x - 0.08, 3.0, z - 0.08], [x + 0.08, 3.31, z + 0.08])
            made += [rod, *cage, panes]
    return made
