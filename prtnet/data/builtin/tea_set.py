"""A tea set on a round table: surfaces of revolution, swept spout and handles, many contacts and thin gaps."""

import numpy as np

from prtnet.data.builtin.palette import part, steps
from prtnet.data.builtin.vessels import CUP, cup, disc, handle, inner_radius, lathe, plate, spoon, vessel
from prtnet.data.part import Part
from prtnet.data.shapes import Surface, box, merge, revolve, smooth, tube

GAP = 0.002
TRAY = 0.034
BOWL = [(0.06, 0.0), (0.075, 0.015), (0.125, 0.06), (0.128, 0.12), (0.105, 0.155)]
JUG = [(0.06, 0.0), (0.07, 0.012), (0.098, 0.07), (0.08, 0.16), (0.062, 0.21), (0.074, 0.25)]


def parts(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """Teapot, four cups on saucers, sugar bowl, milk jug, spoons and sugar cubes; the seed turns and shifts them."""
    cups, saucers, teas, spoons = [], [], [], []
    for i, azimuth in enumerate(np.array([0.5, 1.45, 3.6, 5.3]) + rng.uniform(-0.1, 0.1, 4)):
        place = np.array([np.sin(azimuth), 0, np.cos(azimuth)]) * (0.83, 0.88, 0.80, 0.86)[i]
        turn = float(rng.uniform(0, 2 * np.pi))
        saucers.append(plate(0.21, tessellation, depth=0.03).moved(*place).moved(y=GAP))
        lift = GAP + 0.03 * 0.34 + GAP
        cups.append(cup(tessellation).turned(turn).moved(*place).moved(y=lift))
        teas.append(disc(inner_radius(CUP, 0.008, 0.125), 0.125, tessellation).moved(*place).moved(y=lift))
        spoons.append(spoon(0.17, tessellation).turned(turn + 1.3).moved(*place).moved(0, 0.034 + GAP, 0))
        spoons[-1] = spoons[-1].moved(*(np.array([np.sin(turn), 0, np.cos(turn)]) * 0.165))
    jug_place, bowl_place = {"x": 0.40, "z": -0.24}, {"x": 0.30, "z": 0.33}
    on_tray = 2 * GAP + TRAY * 0.4
    return [
        part("table", _table(tessellation), "oak"),
        part("tray", _tray(tessellation).moved(y=GAP), "silver"),
        part("teapot", [s.turned(0.35).moved(-0.16, on_tray, 0.0) for s in _teapot(tessellation)], "celadon"),
        part("cups", cups, "porcelain"),
        part("saucers", saucers, "porcelain"),
        part("tea", teas, "tea"),
        part("spoons", spoons, "silver"),
        part("jug", _jug(tessellation).turned(-0.9).moved(y=on_tray, **jug_place), "porcelain"),
        part("milk", disc(inner_radius(JUG, 0.007, 0.2), 0.2, tessellation).moved(y=on_tray, **jug_place), "wax"),
        part("sugar_bowl", _sugar_bowl(tessellation).moved(y=on_tray, **bowl_place), "celadon"),
        part("sugar", _cubes(rng), "white"),
    ]


def _table(tessellation: float) -> Surface:
    """A round table top with a rounded border, on a foot."""
    border = np.linspace(-np.pi / 2, np.pi / 2, steps(8, tessellation, 3))
    edge = np.stack([1.28 + 0.03 * np.cos(border), -0.03 + 0.03 * np.sin(border)], axis=1)
    foot = [(0.0, -0.5), (0.42, -0.5), (0.42, -0.47), (0.12, -0.42), (0.09, -0.3), (0.16, -0.06)]
    return revolve(np.concatenate([foot, edge, [[0.0, 0.0]]]), steps(96, tessellation, 12))


def _tray(tessellation: float) -> Surface:
    """A round tray with a raised lip."""
    profile = [(0, 0), (0.58, 0), (0.62, 0.3), (0.64, 1.0), (0.627, 1.05), (0.605, 0.5), (0.58, 0.4), (0, 0.4)]
    return revolve(np.array(profile) * [1, TRAY], steps(80, tessellation, 12))


def _teapot(tessellation: float) -> list[Surface]:
    """Body, lid, spout and handle; spout and handle end inside the body."""
    body = [(0, 0), (0.15, 0), (0.165, 0.015), (0.26, 0.10), (0.285, 0.20), (0.23, 0.32), (0.13, 0.375), (0, 0.38)]
    lid = [(0, 0), (0.12, 0), (0.128, 0.012), (0.10, 0.045), (0.035, 0.07), (0.018, 0.085), (0.035, 0.11), (0, 0.135)]
    spout = smooth([(0.2, 0.10, 0), (0.33, 0.16, 0), (0.40, 0.27, 0), (0.48, 0.37, 0)], steps(24, tessellation, 6))
    width = np.interp(np.linspace(0, 1, len(spout)), [0, 0.4, 1], [0.075, 0.045, 0.024])
    grip = [(-0.2, 0.29, 0), (-0.36, 0.34, 0), (-0.43, 0.24, 0), (-0.36, 0.12, 0), (-0.22, 0.10, 0)]
    return [
        lathe(body, tessellation, rows=36, segments=64),
        lathe(lid, tessellation, rows=30).moved(y=0.38 + GAP),
        tube(spout, width, steps(20, tessellation, 6)),
        handle(grip, 0.022, tessellation, rows=28),
    ]


def _jug(tessellation: float) -> Surface:
    grip = handle([(0.07, 0.215, 0), (0.14, 0.22, 0), (0.155, 0.13, 0), (0.085, 0.07, 0)], 0.011, tessellation)
    return merge([vessel(JUG, 0.007, 0.015, tessellation, rows=20), grip])


def _sugar_bowl(tessellation: float) -> Surface:
    grips = [
        handle([(0.115, 0.125, 0), (0.165, 0.13, 0), (0.16, 0.08, 0), (0.118, 0.07, 0)], 0.010, tessellation).turned(a)
        for a in (0.4, 0.4 + np.pi)
    ]
    return merge([vessel(BOWL, 0.008, 0.015, tessellation, rows=16), *grips])


def _cubes(rng: np.random.Generator) -> list[Surface]:
    """Sugar: some heaped in the bowl, some left on the table."""
    half = 0.021
    cube = box([-half, -half, -half], [half, half, half])
    heap = [(0.052 * np.sin(a), 0.105, 0.052 * np.cos(a)) for a in np.arange(5) * 2 * np.pi / 5] + [(0, 0.152, 0)]
    inside = [cube.turned(rng.uniform(0, 3)).moved(0.30 + x, y + 2 * GAP + TRAY * 0.4, 0.33 + z) for x, y, z in heap]
    loose = [(0.0, 1.0), (0.055, 1.06), (-0.85, -0.45)]
    return inside + [cube.turned(rng.uniform(0, 3)).moved(x, half + GAP, z) for x, z in loose]
