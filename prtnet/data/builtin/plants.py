"""Five potted plants on a plane of two triangles: many thin two-sided leaves, the hard case of per-vertex transfer."""

import numpy as np
from jaxtyping import Float

from prtnet.data.builtin.palette import part, steps
from prtnet.data.part import Part
from prtnet.data.shapes import Surface, ground, merge, revolve, sheet, smooth, tube, turn_y

Array = np.ndarray
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
GAP = 0.004
# outer radius at the rim, height
POTS = {
    "terracotta": (0.30, 0.42),
    "cream": (0.26, 0.50),
    "glazed_blue": (0.34, 0.34),
    "slate": (0.24, 0.58),
    "white": (0.22, 0.30),
}


def parts(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """Pots, soil, stems and leaves, one part for each colour."""
    growers = [_rubber_tree, _bush, _arching_grass, _sword_leaves, _fern]
    colours = ["leaf_dark", "leaf_bright", "leaf_yellow", "leaf_blue", "leaf_bright"]
    places = np.array([[-0.55, -0.42], [0.62, -0.5], [0.02, 0.52], [1.02, 0.42], [-0.88, 0.5]])
    places += rng.uniform(-0.04, 0.04, places.shape)
    found: list[Part] = [part("ground", ground(1.8, 1.5), "ground")]
    soil: list[Surface] = []
    stems: list[Surface] = []
    for (colour, (radius, height)), grow, leaf_colour, (x, z) in zip(
        POTS.items(), growers, colours, places, strict=True
    ):
        found.append(part(f"pot_{colour}", _pot(radius, height, tessellation).moved(x, GAP, z), colour))
        level = GAP + 0.86 * height
        soil.append(_soil(0.92 * radius, tessellation).moved(x, level, z))
        stalks, leaves = grow(tessellation, rng)
        stems += [stalk.moved(x, level, z) for stalk in stalks]
        found.append(part(f"leaves_{grow.__name__[1:]}", merge(leaves).moved(x, level, z), leaf_colour, sheets=True))
    return [*found, part("soil", soil, "soil"), part("stems", stems, "stem")]


def potted_tree(tessellation: float, rng: np.random.Generator, place: tuple[float, float, float]) -> list[Part]:
    """One rubber tree in its pot, for other scenes."""
    radius, height = 0.26, 0.36
    stalks, leaves = _rubber_tree(tessellation, rng)
    level = 0.86 * height
    return [
        part("pot", _pot(radius, height, tessellation).moved(*place), "terracotta"),
        part("soil", _soil(0.92 * radius, tessellation).moved(y=level).moved(*place), "soil"),
        part("stems", merge(stalks).moved(y=level).moved(*place), "stem"),
        part("leaves", merge(leaves).moved(y=level).moved(*place), "leaf_dark", sheets=True),
    ]


def _pot(radius: float, height: float, tessellation: float) -> Surface:
    """A closed, hollow pot with a rolled rim."""
    outer = [(0.0, 0.0), (0.62, 0.0), (0.66, 0.015), (0.80, 0.45), (0.90, 0.80), (0.92, 0.84)]
    rim = [(1.00, 0.86), (1.02, 0.93), (1.00, 0.99), (0.96, 1.00), (0.92, 0.98)]
    inner = [(0.885, 0.93), (0.87, 0.84), (0.84, 0.78), (0.0, 0.78)]
    profile = np.array(outer + rim + inner)
    rows = [profile[:2], _refine(profile[1:-1], steps(2, tessellation, 1))[1:], profile[-1:]]
    return revolve(np.concatenate(rows) * [radius, height], steps(48, tessellation, 8))


def _refine(profile: Float[Array, "n 2"], times: int) -> Float[Array, "m 2"]:
    """Every segment of a polyline cut into `times` equal ones."""
    place = np.linspace(0, len(profile) - 1, (len(profile) - 1) * times + 1)
    return np.stack([np.interp(place, np.arange(len(profile)), profile[:, axis]) for axis in range(2)], axis=1)


def _soil(radius: float, tessellation: float) -> Surface:
    """A low mound whose border ends inside the wall of the pot."""
    rings = np.linspace(1, 0, steps(6, tessellation, 2) + 1)
    return revolve(np.stack([rings * radius, 0.1 * radius * (1 - rings**2)], axis=1), steps(32, tessellation, 8))


def leaf(
    length: float, width: float, *, elevation: float, droop: float, cup: float, along: int, across: int, wide_at: float
) -> Surface:
    """A leaf from the origin towards +z: its midrib starts `elevation` radians above the ground and bends by `droop`.

    `cup` folds the two halves up, `wide_at` (0..1) is where along the midrib it is widest.
    """
    t = np.linspace(0, 1, along + 1)
    slope = elevation - droop * t
    ahead = np.stack([np.zeros_like(t), np.sin(slope), np.cos(slope)], axis=1)
    stride = (ahead[1:] + ahead[:-1]) / 2 * (length / along)
    midrib = np.concatenate([np.zeros((1, 3)), np.cumsum(stride, axis=0)])
    above = np.stack([np.zeros_like(t), np.cos(slope), -np.sin(slope)], axis=1)
    power = np.log(0.5) / np.log(wide_at)
    half = width / 2 * np.maximum(np.sin(np.pi * t**power), 0.03)
    s = np.linspace(-1, 1, across + 1)
    side = np.array([1.0, 0, 0]) * np.cos(cup * np.abs(s))[:, None] * s[:, None]
    lift = np.abs(s) * np.sin(cup * np.abs(s))
    points = midrib[:, None] + half[:, None, None] * (side + lift[:, None] * above[:, None])
    return sheet(points)


def _resolution(tessellation: float, along: int, across: int) -> dict[str, int]:
    return {"along": steps(along, tessellation, 3), "across": 2 * steps(across, tessellation, 1)}


def _rubber_tree(tessellation: float, rng: np.random.Generator) -> tuple[list[Surface], list[Surface]]:
    """Three bent trunks with broad leaves in a golden-angle spiral."""
    stems, leaves = [], []
    for trunk in range(3):
        azimuth = trunk * 2 * np.pi / 3 + rng.uniform(-0.3, 0.3)
        height, lean = rng.uniform(0.95, 1.35), rng.uniform(0.12, 0.2)
        control = np.array([[0, -0.05, 0.03], [0, height * 0.5, 0.06 + lean], [0, height, 0.02 + lean]])
        path = smooth(control, steps(14, tessellation, 4)) @ turn_y(azimuth).T
        stems.append(tube(path, np.linspace(0.020, 0.009, len(path)), steps(8, tessellation, 4)))
        fine = smooth(control, 200) @ turn_y(azimuth).T
        for i, place in enumerate(np.linspace(0.28, 0.99, 17)):
            blade = leaf(
                rng.uniform(0.26, 0.36) * (1.1 - 0.35 * place),
                rng.uniform(0.13, 0.17) * (1.1 - 0.35 * place),
                elevation=rng.uniform(0.3, 0.6) + 0.5 * place**4,
                droop=rng.uniform(0.5, 1.1),
                cup=0.35,
                wide_at=0.45,
                **_resolution(tessellation, 9, 3),
            )
            leaves.append(_attach(blade, fine[int(place * 199)], i * GOLDEN_ANGLE + rng.uniform(-0.2, 0.2)))
    return stems, leaves


def _bush(tessellation: float, rng: np.random.Generator) -> tuple[list[Surface], list[Surface]]:
    """Many thin twigs with small leaves."""
    stems, leaves = [], []
    for twig in range(16):
        azimuth = twig * GOLDEN_ANGLE + rng.uniform(-0.2, 0.2)
        spread = 0.10 + 0.30 * np.sqrt((twig + 0.5) / 16)
        height = rng.uniform(0.55, 0.75) * (1.15 - 0.9 * spread)
        control = np.array([[0, -0.04, 0.1 * spread], [0, height * 0.55, 0.5 * spread], [0, height, spread]])
        path = smooth(control, steps(8, tessellation, 3)) @ turn_y(azimuth).T
        stems.append(tube(path, np.linspace(0.009, 0.004, len(path)), steps(6, tessellation, 3)))
        fine = smooth(control, 100) @ turn_y(azimuth).T
        for i, place in enumerate(np.linspace(0.25, 1.0, 12)):
            blade = leaf(
                rng.uniform(0.09, 0.14),
                rng.uniform(0.055, 0.075),
                elevation=rng.uniform(0.1, 0.7),
                droop=rng.uniform(0.2, 0.9),
                cup=0.3,
                wide_at=0.5,
                **_resolution(tessellation, 5, 1),
            )
            leaves.append(_attach(blade, fine[int(place * 99)], azimuth + i * GOLDEN_ANGLE))
    return stems, leaves


def _arching_grass(tessellation: float, rng: np.random.Generator) -> tuple[list[Surface], list[Surface]]:
    """A spider plant: long narrow leaves that arch over the rim."""
    leaves = []
    for i in range(70):
        age = (i + 0.5) / 70
        blade = leaf(
            rng.uniform(0.5, 0.85),
            rng.uniform(0.028, 0.04),
            elevation=1.45 - 0.7 * age + rng.uniform(-0.08, 0.08),
            droop=rng.uniform(1.3, 1.9) + 0.35 * age,
            cup=0.5,
            wide_at=0.3,
            **_resolution(tessellation, 16, 1),
        )
        azimuth = i * GOLDEN_ANGLE
        root = 0.05 * np.sqrt(age) * np.array([np.sin(azimuth), 0, np.cos(azimuth)])
        leaves.append(_attach(blade, root - [0, 0.01, 0], azimuth + rng.uniform(-0.15, 0.15)))
    return [], leaves


def _sword_leaves(tessellation: float, rng: np.random.Generator) -> tuple[list[Surface], list[Surface]]:
    """A snake plant: stiff upright blades."""
    leaves = []
    for i in range(16):
        azimuth = i * GOLDEN_ANGLE
        blade = leaf(
            rng.uniform(0.5, 0.95),
            rng.uniform(0.075, 0.10),
            elevation=1.5 - 0.012 * i + rng.uniform(-0.06, 0.06),
            droop=rng.uniform(-0.1, 0.25),
            cup=0.6,
            wide_at=0.35,
            **_resolution(tessellation, 16, 2),
        )
        root = 0.035 * np.sqrt(i + 0.5) * np.array([np.sin(azimuth), 0, np.cos(azimuth)])
        leaves.append(_attach(blade, root - [0, 0.02, 0], azimuth + rng.uniform(-0.5, 0.5)))
    return [], leaves


def _fern(tessellation: float, rng: np.random.Generator) -> tuple[list[Surface], list[Surface]]:
    """Arching fronds with two rows of leaflets."""
    stems, leaves = [], []
    for frond in range(13):
        azimuth, reach = frond * GOLDEN_ANGLE, rng.uniform(0.30, 0.42)
        top = rng.uniform(0.26, 0.42)
        control = np.array([[0, -0.02, 0.01], [0, top, 0.4 * reach], [0, 0.75 * top, reach]])
        path = smooth(control, steps(10, tessellation, 4)) @ turn_y(azimuth).T
        stems.append(tube(path, np.linspace(0.006, 0.0025, len(path)), steps(5, tessellation, 3)))
        fine = smooth(control, 100) @ turn_y(azimuth).T
        for place in np.linspace(0.22, 0.98, 11):
            for hand in (-1, 1):
                blade = leaf(
                    0.15 * (1.12 - place) + 0.02,
                    0.034,
                    elevation=0.25 + rng.uniform(-0.1, 0.1),
                    droop=0.7,
                    cup=0.2,
                    wide_at=0.4,
                    **_resolution(tessellation, 4, 1),
                )
                leaves.append(_attach(blade, fine[int(place * 99)], azimuth + hand * 1.15))
    return stems, leaves


def _attach(blade: Surface, root: Float[Array, " 3"], azimuth: float) -> Surface:
    return blade.turned(azimuth).moved(*root)
