"""Surfaces that procedural scenes are made of. Closed ones are wound outward; y is up."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles, before they get a material."""

    vertices: Float[Array, "v 3"]
    faces: Int[Array, "f 3"]

    def moved(self, x: float = 0, y: float = 0, z: float = 0) -> "Surface":
        """Shifted."""
        return Surface(self.vertices + [x, y, z], self.faces)

    def turned(self, azimuth: float) -> "Surface":
        """Turned about the y axis by `azimuth` radians, from +z towards +x."""
        return Surface(self.vertices @ turn_y(azimuth).T, self.faces)

    def transformed(self, matrix: ArrayLike) -> "Surface":
        """Under a 3x3 matrix of positive determinant (mirrors would turn the winding)."""
        return Surface(self.vertices @ np.asarray(matrix, np.float64).T, self.faces)


def turn_y(azimuth: float) -> Float[Array, "3 3"]:
    """Rotation about y by `azimuth` radians, from +z towards +x."""
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    return np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])


def tilt_x(angle: float) -> Float[Array, "3 3"]:
    """Rotation about x by `angle` radians, from +y towards +z."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])


def merge(surfaces: Iterable[Surface]) -> Surface:
    """All surfaces as one."""
    surfaces = list(surfaces)
    starts = np.cumsum([0] + [len(s.vertices) for s in surfaces[:-1]])
    return Surface(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate([s.faces + start for s, start in zip(surfaces, starts, strict=True)]).astype(np.int32),
    )


def sheet(points: Float[Array, "r c 3"], *, wrap: bool = False) -> Surface:
    """A grid of points as quads, two triangles each, facing row x column; `wrap` joins the last column to the first."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    if wrap:
        index = np.concatenate([index, index[:, :1]], axis=1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return Surface(points.reshape(-1, 3).astype(np.float64), faces.astype(np.int32))


def compact(surface: Surface) -> Surface:
    """Equal positions welded, and the triangles that collapse by it dropped (poles of surfaces of revolution)."""
    _, first, inverse = np.unique(np.round(surface.vertices, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
    faces = inverse.reshape(-1)[surface.faces].astype(np.int32)
    alive = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return Surface(surface.vertices[first], faces[alive])


def revolve(profile: ArrayLike, segments: int) -> Surface:
    """Surface of revolution about y of (radius, y) points. A profile that goes up on its outer side faces outward."""
    radius, height = np.moveaxis(np.asarray(profile, np.float64), -1, 0)
    angle = np.arange(segments) * 2 * np.pi / segments
    ring = np.stack([np.sin(angle), np.zeros(segments), np.cos(angle)], axis=-1)
    points = radius[:, None, None] * ring + height[:, None, None] * np.array([0.0, 1.0, 0.0])
    return compact(sheet(points[:, ::-1], wrap=True))


def smooth(points: ArrayLike, count: int) -> Float[Array, "n d"]:
    """Uniform Catmull-Rom curve through control points, resampled to `count` points."""
    control = np.asarray(points, np.float64)
    padded = np.concatenate([2 * control[:1] - control[1:2], control, 2 * control[-1:] - control[-2:-1]])
    place = np.linspace(0, len(control) - 1, count)
    index = np.minimum(place.astype(int), len(control) - 2)
    t = (place - index)[:, None]
    p0, p1, p2, p3 = (padded[index + i] for i in range(4))
    return 0.5 * (2 * p1 + (p2 - p0) * t + (2 * p0 - 5 * p1 + 4 * p2 - p3) * t**2 + (3 * p1 - p0 - 3 * p2 + p3) * t**3)


def tube(path: Float[Array, "n 3"], radius: ArrayLike, segments: int) -> Surface:
    """A closed tube along a path, with flat caps; the ring is carried along without twist (parallel transport)."""
    path = np.asarray(path, np.float64)
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.empty_like(path)
    start = np.eye(3)[np.argmin(np.abs(tangent[0]))]
    for i, direction in enumerate(tangent):
        start = start - direction * (start @ direction)
        start /= np.linalg.norm(start)
        side[i] = start
    up = np.cross(tangent, side)
    angle = np.arange(segments) * 2 * np.pi / segments
    ring = np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * up[:, None]
    rows = path[:, None] + np.broadcast_to(radius, len(path))[:, None, None] * ring
    ends = [np.broadcast_to(path[i], (1, segments, 3)) for i in (0, -1)]
    return compact(sheet(np.concatenate([ends[0], rows, ends[1]])[:, ::-1], wrap=True))


def box(low: ArrayLike, high: ArrayLike) -> Surface:
    """An axis-aligned closed box of 12 triangles."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return Surface(low + corners * (high - low), np.array(faces, np.int32))


def rounded_box(low: ArrayLike, high: ArrayLike, radius: float, arc: int) -> Surface:
    """A closed box with edges rounded by `radius`, each in `arc` steps: cushions."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    half, centre = (high - low) / 2, (high + low) / 2
    inner = half - min(radius, float(half.min()) * 0.999)
    lines = [
        np.concatenate([np.linspace(-h, -i, arc + 1), np.linspace(i, h, arc + 1)])
        for h, i in zip(half, inner, strict=True)
    ]
    sides = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        u, v = np.meshgrid(lines[first], lines[second], indexing="ij")
        for sign in (-1, 1):
            points = np.empty((*u.shape, 3))
            points[..., axis], points[..., first], points[..., second] = sign * half[axis], u, v
            sides.append(sheet(points if sign > 0 else points[:, ::-1]))
    cube = merge(sides)
    core = np.clip(cube.vertices, -inner, inner)
    away = cube.vertices - core
    rounded = core + (half - inner) * away / np.linalg.norm(away, axis=1, keepdims=True)
    return compact(Surface(rounded + centre, cube.faces))


def panel(across: ArrayLike, up: ArrayLike, filled: ArrayLike, depth: float) -> Surface:
    """A closed plate with openings: cells between the lines `across` (x) and `up` (y), from z = -depth to z = 0."""
    x, y = np.asarray(across, np.float64), np.asarray(up, np.float64)
    cells = np.pad(np.asarray(filled, bool), 1)
    quads = []
    for i, j in np.argwhere(cells) - 1:
        size = np.array([x[i + 1] - x[i], y[j + 1] - y[j]])
        right, top, back = np.array([size[0], 0, 0]), np.array([0, size[1], 0]), np.array([0, 0, -depth])
        corner = np.array([x[i], y[j], 0])
        quads += [quad(corner, right, top), quad(corner + back, top, right)]
        if not cells[i, j + 1]:
            quads.append(quad(corner, top, back))
        if not cells[i + 2, j + 1]:
            quads.append(quad(corner + right, back, top))
        if not cells[i + 1, j]:
            quads.append(quad(corner, back, right))
        if not cells[i + 1, j + 2]:
            quads.append(quad(corner + top, right, back))
    return compact(merge(quads))


def ellipsoid(radii: ArrayLike, segments: int) -> Surface:
    """A closed ellipsoid about the origin."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, max(segments // 2, 3) + 1)
    radius = np.cos(angle)
    radius[[0, -1]] = 0
    return revolve(np.stack([radius, np.sin(angle)], axis=1), segments).transformed(np.diag(np.asarray(radii, float)))


def quad(corner: ArrayLike, right: ArrayLike, up: ArrayLike) -> Surface:
    """Two triangles, facing right x up."""
    corner, right, up = (np.asarray(v, np.float64) for v in (corner, right, up))
    return Surface(
        np.stack([corner, corner + right, corner + right + up, corner + up]), np.array([[0, 1, 2], [0, 2, 3]])
    )


def ground(half_x: float, half_z: float, y: float = 0.0) -> Surface:
    """A 2-triangle plane about the y axis that faces up."""
    return quad([-half_x, y, half_z], [2 * half_x, 0, 0], [0, 0, -2 * half_z])
