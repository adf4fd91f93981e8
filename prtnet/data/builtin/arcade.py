"""Pieces of arcades: walls on round arches, columns, cross vaults, ribs, mouldings, balusters, hanging cloth.

All but cloth and open mouldings are closed. Lengths are in metres.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from prtnet.data.builtin.palette import steps
from prtnet.data.shapes import Surface, box, compact, merge, panel, quad, revolve, sheet, smooth

Array = np.ndarray

# of a column, in radii of its foot: plinth, what its shaft loses, abacus
PLINTH, TAPER, ABACUS = (1.42, 0.5), 0.16, (1.45, 0.5)


def arched_wall(
    bays: int,
    bay: float,
    *,
    radius: float,
    ring: float,
    low: float,
    top: float,
    half: float,
    proud: float,
    end: float,
    segments: int,
) -> Surface:
    """A wall along x about the origin that stands on piers at y = `low`, with a round arch in the middle of each bay.

    The wall is 2 `half` thick; a ring of breadth `ring` around each arch is `proud` of it on both sides. The last
    piers reach `end` beyond the last bays.
    """
    centres = (np.arange(bays) - (bays - 1) / 2) * bay
    arch = _arch(radius, ring, top - low, half, proud, segments)
    reach = radius + ring
    left = np.concatenate([[-bays * bay / 2 - end], centres + reach])
    right = np.concatenate([centres - reach, [bays * bay / 2 + end]])
    pieces = [arch.moved(x) for x in centres]
    for x0, x1 in zip(left, right, strict=True):
        pieces.append(_pier(x0, x1, top - low, half))
    tall, deep = np.array([0, top - low, 0]), np.array([0, 0, 2 * half])
    pieces.append(quad([left[0], 0, -half], deep, tall))
    pieces.append(quad([right[-1], 0, half], -deep, tall))
    return compact(merge(pieces)).moved(y=low)


def _arch(radius: float, ring: float, top: float, half: float, proud: float, segments: int) -> Surface:
    """One arch from spring to spring, without the faces that it shares with the piers."""
    angle = np.linspace(np.pi, 0, segments + 1)
    out = half + proud
    outer = radius + ring
    # the section at the crown, once around: the arch's underside, its front, the wall, the top, and back
    bent = [(radius, -out), (radius, out), (outer, out), (outer, half), (outer, -half), (outer, -out)]
    rows = [
        np.stack([reach * np.cos(angle), reach * _sine(angle), np.full_like(angle, z)], axis=1) for reach, z in bent
    ]
    crown = [row * [1, 0, 1] + [0, top, 0] for row in rows[3:5]]
    body = sheet(np.stack([*rows[:4], *crown, *rows[4:]], axis=1), wrap=True)
    feet = [Surface(np.array([[side * r, 0, z] for r, z in bent]), _fan(6, side > 0)) for side in (-1, 1)]
    return merge([body, *feet])


def _sine(angle: Float[Array, " n"]) -> Float[Array, " n"]:
    """The sine of angles in [0, pi], 0 at both ends."""
    return np.sin(np.where(angle < np.pi, angle, 0))


def _fan(count: int, turned: bool) -> Array:
    """Triangles of a convex polygon."""
    faces = [(0, i, i + 1) for i in range(1, count - 1)]
    return np.array([face[::-1] for face in faces] if turned else faces, np.int32)


def _pier(x0: float, x1: float, top: float, half: float) -> Surface:
    """The wall between two arches, open to both: front, back, top and foot."""
    right, up, deep = np.array([x1 - x0, 0, 0]), np.array([0, top, 0]), np.array([0, 0, 2 * half])
    front, back = np.array([x0, 0, half]), np.array([x0, 0, -half])
    return merge(
        [quad(front, right, up), quad(back, up, right), quad(front + up, right, -deep), quad(back, right, deep)]
    )


def column(height: float, radius: float, tessellation: float) -> Surface:
    """A round column on a square plinth, with base, swelling shaft, capital and abacus; it stands on y = 0."""
    profile = _column_profile(height / radius, tessellation) * radius
    (foot, thick), (head, deep) = np.multiply(PLINTH, radius), np.multiply(ABACUS, radius)
    plinth = box([-foot, 0, -foot], [foot, thick, foot])
    abacus = box([-head, height - deep, -head], [head, height, head])
    return merge([plinth, revolve(profile, steps(16, tessellation, 8)), abacus])


def _column_profile(height: float, tessellation: float) -> Float[Array, "n 2"]:
    """(radius, y) in radii of the foot: two rolls and a hollow, the shaft (entasis from a quarter up), a capital."""
    low, high, sink = PLINTH[1], height - ABACUS[1], 0.05
    arc = steps(3, tessellation, 1)
    base = [[(0, -sink), (1.2, -sink)], _roll(1.2, 0, 0.28, 0.17, arc), [(1.1, 0.36), (1.1, 0.44)]]
    base += [_roll(1.1, 0.5, 0.66, 0.1, arc), [(1.02, 0.76)]]
    t = np.linspace(0, 1, steps(6, tessellation, 3))
    radius = 1 - TAPER * np.maximum(0, (t - 0.25) / 0.75) ** 1.5
    foot, neck = low + 0.9, high - 0.95
    shaft = np.stack([radius, foot + (neck - foot) * t], axis=1)
    slim = 1 - TAPER
    bell = smooth([(slim, 0.28), (slim + 0.06, 0.5), (1.1, 0.74), (1.34, 0.86)], steps(4, tessellation, 3))
    head = [_roll(slim, 0.04, 0.2, 0.09, arc), bell, [(1.34, 0.95 + sink), (0, 0.95 + sink)]]
    return np.concatenate([np.concatenate(base) + [0, low], shaft, np.concatenate(head) + [0, neck]])


def _roll(radius: float, low: float, high: float, bulge: float, arc: int) -> Float[Array, "n 2"]:
    """Half an ellipse that stands out of a profile."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, arc + 2)
    return np.stack([radius + bulge * np.cos(angle), (low + high) / 2 + (high - low) / 2 * np.sin(angle)], axis=1)


def baluster(height: float, radius: float, tessellation: float) -> Surface:
    """A turned post, widest below its middle; it stands on y = 0."""
    curve = smooth(
        [(0.75, 0), (0.5, 0.14), (1, 0.34), (0.85, 0.52), (0.45, 0.82), (0.75, 1)], steps(9, tessellation, 6)
    )
    profile = np.concatenate([[(0, 0)], curve, [(0, 1)]]) * [radius, height]
    return revolve(profile, steps(8, tessellation, 6))


def around(profile: ArrayLike, half_x: float, half_z: float, *, closed: bool = True) -> Surface:
    """A profile of (outwards, y) points led round a rectangle, with mitred corners.

    Closed profiles run counter-clockwise, with `outwards` to the right. Open ones face right of the way they run.
    """
    points = np.asarray(profile, np.float64)
    if closed:
        points = np.concatenate([points, points[:1]])
    away, y = points.T
    x, z = half_x + away, half_z + away
    corners = [np.stack([sx * x, y, sz * z], axis=1) for sx, sz in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return compact(sheet(np.stack(corners, axis=1), wrap=True))


def moulding(steps_out: Sequence[tuple[float, float]], back: float) -> Float[Array, "n 2"]:
    """The closed profile of a moulding of (out, y) points, from below upwards, that reaches `back` into its wall."""
    (_, low), (_, high) = steps_out[0], steps_out[-1]
    return np.array([(-back, low), *steps_out, (-back, high)])


def vaults(
    x: Float[Array, " i"],
    z: Float[Array, " j"],
    rise: tuple[Float[Array, " i"], Float[Array, " j"]],
    filled: Bool[Array, "_ _"],
    spring: float,
    top: float,
) -> Surface:
    """A closed slab with cross vaults below: its underside is at `spring` plus the greater of the rises along x and z.

    `filled` says which cells between the lines `x` and `z` there are. Cells are cut along the groins.
    """
    heights = spring + np.maximum(rise[0][:, None], rise[1][None])
    grid = np.stack(np.broadcast_arrays(x[:, None], heights, z[None]), axis=-1).reshape(-1, 3)
    number = np.arange(heights.size).reshape(heights.shape)
    i, j = np.nonzero(filled)
    a, b, c, d = number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]
    # a groin climbs along one diagonal, and the ends of the other are level
    along = np.abs(grid[a, 1] - grid[c, 1]) >= np.abs(grid[b, 1] - grid[d, 1])
    first = np.where(along[:, None], np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(along[:, None], np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    below = np.concatenate([first, second])
    lid = number.size
    # borders: edges that one face has and no other has the other way
    edges = below[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    key, opposite = edges @ [2 * lid, 1], edges[:, ::-1] @ [2 * lid, 1]
    start, end = edges[~np.isin(key, opposite)].T
    sides = np.stack([start, start + lid, end + lid, start, end + lid, end], axis=1).reshape(-1, 3)
    above = below[:, ::-1] + lid
    high = np.where([False, True, False], top, grid)
    return compact(Surface(np.concatenate([grid, high]), np.concatenate([below, above, sides]).astype(np.int32)))


def half_round(t: Float[Array, " n"]) -> Float[Array, " n"]:
    """Height of a round arch of radius 1 at -1 <= t <= 1."""
    return np.sqrt(np.maximum(0, 1 - t**2))


def rib(half_span: float, rise: float, drop: float, half: float, segments: int) -> Surface:
    """A closed elliptic band in the plane z = 0, spring on y = 0, that hangs `drop` below its vault at the crown."""
    angle = np.linspace(0, np.pi, segments + 1)
    rows = []
    for a, b, z in (
        (half_span - 0.4 * drop, rise - drop, -half),
        (half_span - 0.4 * drop, rise - drop, half),
        (half_span + 0.03, rise + 0.03, half),
        (half_span + 0.03, rise + 0.03, -half),
    ):
        rows.append(np.stack([a * np.cos(angle), b * _sine(angle), np.full_like(angle, z)], axis=1))
    body = sheet(np.stack(rows, axis=1)[::-1], wrap=True)
    feet = [Surface(np.stack([row[end] for row in rows]), _fan(4, end == 0)) for end in (0, -1)]
    return compact(merge([body, *feet]))


def doorway(half: float, height: float, border: float) -> tuple[Surface, Surface]:
    """(frame, leaves) of a double door in the plane z = 0 that faces +z; it stands on y = 0."""
    across, up = [-half - border, -half, half, half + border], [0, height, height + border]
    frame = panel(across, up, [[1, 1], [0, 1], [1, 1]], 0.16).moved(z=0.12)
    wide = half / 2 - 0.004
    leaf = [box([-wide, 0.01, -0.03], [wide, height + 0.01, 0.03])]
    for low, high in ((0.1, 0.45), (0.52, 0.92)):
        leaf.append(box([-0.34 * half, low * height, 0.02], [0.34 * half, high * height, 0.055]))
    leaves = [piece.moved(side * half / 2) for side in (-1, 1) for piece in leaf]
    return frame, merge(leaves)


def cloth(path: Float[Array, "r 3"], width: float, fold: float, folds: float, phase: float, columns: int) -> Surface:
    """A cloth of a width along x that follows a path over (y, z), in folds that deepen along it by `fold`."""
    u = np.linspace(0, 1, columns)[None]
    t = np.linspace(0, 1, len(path))[:, None]
    along = np.gradient(path, axis=0)
    normal = np.cross([1.0, 0.0, 0.0], along)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    wave = fold * np.sqrt(t) * np.sin(2 * np.pi * (folds * u + 0.12 * np.sin(3 * t + phase)) + phase)
    across = (u - 0.5) * width * (1 - 0.06 * t) + 0.02 * width * t * np.sin(5 * t + phase)
    points = path[:, None] + across[..., None] * np.array([1.0, 0, 0]) + wave[..., None] * normal[:, None]
    return sheet(points)
