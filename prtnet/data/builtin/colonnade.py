"""A court inside a two-storey arcade, open to the sky, as in the halls that large scenes are shown with.

Nine bays by four: columns, round arches, cross vaults below and beams above, a balustrade, cloths that hang over it,
sails across the court, urns, benches and a basin. Metres, y up, long along x.
"""

import numpy as np
from jaxtyping import Float

from prtnet.data.builtin import arcade
from prtnet.data.builtin.court import furniture
from prtnet.data.builtin.palette import part, steps
from prtnet.data.part import Part
from prtnet.data.shapes import Surface, box, merge, quad

Array = np.ndarray

BAY, LONG, SHORT = 2.0, 9, 4
# half axes of the rectangle that the columns stand on, and how deep the walks behind them are
COURT = (LONG * BAY / 2, SHORT * BAY / 2)
HALF, UPPER_HALF, DEPTH = 0.22, 0.19, 2.4
# from the columns to the outer wall, and the thickness of that wall
WALK, WALL = HALF + DEPTH, 0.3
FLOOR, SPRING, STOREY = 0.30, 3.0, 4.35
RAIL, UPPER_SPRING, EAVES = 5.22, 7.0, 8.18
RISE = 1.0
SINK = 0.02


def parts(tessellation: float, rng: np.random.Generator) -> list[Part]:
    """The building, then what stands and hangs in it; the seed moves doors, cloths, urns and benches."""
    return [
        *_floors(),
        part("outer_wall", _outer_wall(), "ochre"),
        part("pilasters", _pilasters(), "sandstone"),
        part("columns", _columns(tessellation), "marble"),
        part("arches", _walls(tessellation), "sandstone"),
        part("vaults", [_vaults(tessellation), *_ribs(tessellation)], "plaster"),
        part("mouldings", _mouldings(), "marble"),
        part("balustrade", _balustrade(tessellation), "marble"),
        part("beams", _beams(), "walnut"),
        part("roof", _roof(), "terracotta"),
        *_doors(rng),
        *furniture(tessellation, rng),
    ]


def _lines(half: float) -> Float[Array, " n"]:
    """Where the columns of a side stand along it, the corners among them."""
    return np.arange(round(2 * half / BAY) + 1) * BAY - half


def _round_the_court() -> list[tuple[float, float, float]]:
    """(x, z, azimuth) of all columns but those of the corners; the azimuth is that of the court as seen from them."""
    x, z = COURT
    found = [(along, side * z, np.pi * (side > 0)) for side in (-1, 1) for along in _lines(x)[1:-1]]
    return found + [(side * x, along, -side * np.pi / 2) for side in (-1, 1) for along in _lines(z)[1:-1]]


def _bays() -> list[tuple[float, float, float]]:
    """(x, z, azimuth) of the middles of all bays, as `_round_the_court`."""
    x, z = COURT
    found = [(along + BAY / 2, side * z, np.pi * (side > 0)) for side in (-1, 1) for along in _lines(x)[:-1]]
    return found + [(side * x, along + BAY / 2, -side * np.pi / 2) for side in (-1, 1) for along in _lines(z)[:-1]]


def _corners() -> list[tuple[float, float]]:
    return [(sx * COURT[0], sz * COURT[1]) for sx in (-1, 1) for sz in (-1, 1)]


def _floors() -> list[Part]:
    """The paved court, and two steps up to the floor of the walks; sheets that are seen from above."""
    x, z = COURT
    half_x, half_z = round(x - 0.8), round(z - 0.8)
    tiles: tuple[list[Surface], list[Surface]] = ([], [])
    for i in range(-half_x, half_x):
        for j in range(-half_z, half_z):
            tiles[(i + j) % 2].append(quad([i, 0, j + 1], [1, 0, 0], [0, 0, -1]))
    border = arcade.around([(x - 0.68 - half_x, 0), (0, 0)], half_x, half_z, closed=False)
    stairs = [(WALK + SINK, FLOOR), (-0.35, FLOOR), (-0.35, 0.15), (-0.7, 0.15), (-0.7, -SINK)]
    return [
        part("paving", tiles[0], "limestone"),
        part("paving_dark", tiles[1], "basalt"),
        part("paving_border", border, "sandstone"),
        part("stylobate", arcade.around(stairs, x, z, closed=False), "limestone"),
    ]


def _outer_wall() -> Surface:
    low, high = -0.1, EAVES + SINK
    return arcade.around([(WALK, low), (WALK + WALL, low), (WALK + WALL, high), (WALK, high)], *COURT)


def _pilasters() -> list[Surface]:
    """Flat piers with foot and head on the outer wall, opposite each column, on both storeys."""
    made = []
    for low, high in ((FLOOR - SINK, SPRING + 0.03), (STOREY - 2 * SINK, EAVES - 0.24)):
        pier = merge(
            [
                box([-0.2, low, -0.1], [0.2, high, 0.1]),
                box([-0.25, low - 0.01, -0.1], [0.25, low + 0.3, 0.14]),
                box([-0.25, high - 0.16, -0.1], [0.25, high + 0.01, 0.15]),
            ]
        )
        for x, z, azimuth in _round_the_court():
            away = (WALK + 0.06) * np.array([np.sin(azimuth), np.cos(azimuth)])
            made.append(pier.turned(azimuth).moved(x - away[0], 0, z - away[1]))
    return made


def _columns(tessellation: float) -> list[Surface]:
    """Columns on both storeys, the upper ones on pedestals, and square piers in the corners."""
    below = arcade.column(SPRING - FLOOR + 0.01, 0.19, tessellation).moved(y=FLOOR - 0.01)
    above = arcade.column(UPPER_SPRING - RAIL + 0.01, 0.14, tessellation).moved(y=RAIL - 0.01)
    pedestal = merge(
        [
            box([-0.2, STOREY - SINK, -0.2], [0.2, RAIL - 0.04, 0.2]),
            box([-0.25, STOREY - SINK - 0.01, -0.25], [0.25, STOREY + 0.14, 0.25]),
            box([-0.25, RAIL - 0.13, -0.25], [0.25, RAIL, 0.25]),
        ]
    )
    made = [piece.moved(x, 0, z) for x, z, _ in _round_the_court() for piece in (below, pedestal, above)]
    for x, z in _corners():
        for low, high in ((FLOOR - 0.01, SPRING), (STOREY - SINK, UPPER_SPRING)):
            made.append(box([x - 0.3, low, z - 0.3], [x + 0.3, high - 0.05, z + 0.3]))
            made.append(box([x - 0.35, low - 0.01, z - 0.35], [x + 0.35, low + 0.25, z + 0.35]))
            made.append(box([x - 0.35, high - 0.12, z - 0.35], [x + 0.35, high, z + 0.35]))
    return made


def _walls(tessellation: float) -> list[Surface]:
    """The arched walls of four sides on two storeys; those of the short sides run into those of the long ones."""
    segments = steps(14, tessellation, 6)
    lower = {"radius": 0.78, "ring": 0.14, "low": SPRING - SINK, "top": STOREY, "half": HALF, "proud": 0.035}
    upper = {"radius": 0.80, "ring": 0.11, "low": UPPER_SPRING - SINK, "top": EAVES + 2 * SINK, "half": UPPER_HALF}
    made = []
    for knobs in (lower, upper | {"proud": 0.03}):
        for bays, away, azimuth, end in ((LONG, COURT[1], 0.0, HALF), (SHORT, COURT[0], np.pi / 2, -0.1)):
            wall = arcade.arched_wall(bays, BAY, **knobs, end=end, segments=segments).turned(azimuth)
            for side in (-1, 1):
                made.append(wall.moved(*(side * away * np.array([np.sin(azimuth), 0, np.cos(azimuth)]))))
    return made


def _vaults(tessellation: float) -> Surface:
    """Cross vaults over the lower walk, in one piece with the floor of the upper one."""
    arc = np.cos(np.linspace(np.pi, 0, steps(9, tessellation, 3) + 1))
    lines, rises, walks = [], [], []
    for half in COURT:
        # the walks' edges reach into the walls
        inner, outer = half + HALF - SINK, half + WALK + SINK
        bays = [(-outer, -inner), *((low, low + BAY) for low in _lines(half)[:-1]), (inner, outer)]
        line = np.concatenate([(low + high) / 2 + (high - low) / 2 * arc for low, high in bays])
        fresh = np.append(True, np.diff(line) > 1e-6)
        lines.append(line[fresh])
        rises.append(RISE * np.tile(arcade.half_round(arc), len(bays))[fresh])
        walks.append(np.abs(lines[-1][1:] + lines[-1][:-1]) / 2 > inner)
    filled = walks[0][:, None] | walks[1][None]
    x, z = lines
    return arcade.vaults(x, z, (rises[0], rises[1]), filled, spring=SPRING + SINK, top=STOREY - SINK)


def _ribs(tessellation: float) -> list[Surface]:
    """Bands below the vaults from each column to its pilaster."""
    band = arcade.rib(DEPTH / 2, RISE, 0.14, 0.14, steps(12, tessellation, 6)).turned(np.pi / 2)
    away = HALF + DEPTH / 2
    made = []
    for x, z, azimuth in _round_the_court():
        back = away * np.array([np.sin(azimuth), np.cos(azimuth)])
        made.append(band.turned(azimuth).moved(x - back[0], SPRING + 0.02, z - back[1]))
    return made


def _mouldings() -> list[Surface]:
    """Round the court: a string course between the storeys and a cornice; at the outer walls a skirting."""
    course = [(0.06, 4.06), (0.06, 4.12), (0.12, 4.18), (0.14, 4.26), (0.14, 4.32)]
    cornice = [(0.06, 7.86), (0.06, 7.92), (0.11, 7.97), (0.11, 8.02)]
    made = []
    for profile, half in ((course, HALF), (cornice, UPPER_HALF)):
        # the rectangle's outside is the wall: what stands out of it goes inwards
        inwards = arcade.moulding(profile, SINK)[::-1] * [-1, 1]
        made.append(arcade.around(inwards, COURT[0] - half, COURT[1] - half))
    for low, high in ((FLOOR - SINK, FLOOR + 0.22), (STOREY - 2 * SINK, STOREY + 0.18)):
        skirting = np.array([(WALK - 0.03, low), (WALK + SINK, low), (WALK + SINK, high), (WALK - 0.03, high)])
        made.append(arcade.around(skirting, *COURT))
    return made


def _balustrade(tessellation: float) -> list[Surface]:
    """Five posts in each bay between two rails that run from column to column."""
    post = arcade.baluster(RAIL - 0.1 - (STOREY + 0.1), 0.062, tessellation)
    made = []
    for half, y0, y1 in ((0.1, STOREY - SINK, STOREY + 0.11), (0.11, RAIL - 0.11, RAIL - 0.02)):
        made.append(arcade.around([(-half, y0), (half, y0), (half, y1), (-half, y1)], *COURT))
    for x, z, azimuth in _bays():
        for along in np.linspace(-0.64, 0.64, 5):
            at = along * np.array([np.cos(azimuth), -np.sin(azimuth)])
            made.append(post.moved(x + at[0], STOREY + 0.1, z + at[1]))
    return made


def _beams() -> list[Surface]:
    """Below the ceiling of the upper walk: beams at the columns, rafters between, and their ends under the eaves."""
    made = []
    low, wide = -WALK - SINK, 0.1
    for x, z, azimuth in _round_the_court():
        beam = box([-wide, EAVES - 0.24, low], [wide, EAVES + SINK, 0.0])
        made.append(beam.turned(azimuth).moved(x, 0, z))
    for x, z, azimuth in _bays():
        for along in (-0.33, 0.33):
            rafter = box([along - 0.05, EAVES - 0.11, low], [along + 0.05, EAVES + 0.01, 0.0])
            made.append(rafter.turned(azimuth).moved(x, 0, z))
        for along in np.arange(-0.8, 0.9, 0.4):
            end = box([along - 0.045, EAVES - 0.1, 0.1], [along + 0.045, EAVES + 0.01, 0.66])
            made.append(end.turned(azimuth).moved(x, 0, z))
    return made


def _roof() -> Surface:
    """A slope from the eaves over the court up to the outer walls; its underside is the ceiling of the upper walk."""
    out = WALK + WALL + 0.25
    profile = [(-0.72, EAVES), (out, EAVES), (out, EAVES + 0.95), (-0.72, EAVES + 0.12)]
    return arcade.around(profile, *COURT)


def _doors(rng: np.random.Generator) -> list[Part]:
    """Double doors in some bays of the outer wall, taller ones in the middle of the short sides below."""
    frames, leaves = [], []
    bays = _bays()
    for low in (FLOOR - SINK, STOREY - 2 * SINK):
        for number in sorted(rng.choice(2 * LONG, 5, replace=False).tolist()):
            x, z, azimuth = bays[number]
            away = WALK * np.array([np.sin(azimuth), np.cos(azimuth)])
            for made, piece in zip((frames, leaves), arcade.doorway(0.5, 2.1, 0.14), strict=True):
                made.append(piece.turned(azimuth).moved(x - away[0], low, z - away[1]))
    for side in (-1, 1):
        for made, piece in zip((frames, leaves), arcade.doorway(0.62, 2.5, 0.16), strict=True):
            for z in (-BAY / 2, BAY / 2):
                made.append(piece.turned(-side * np.pi / 2).moved(side * (COURT[0] + WALK), FLOOR - SINK, z))
    return [part("door_frames", frames, "marble"), part("doors", leaves, "oak")]
