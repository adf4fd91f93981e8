"""Cameras, and the paths they follow: an orbit around objects, a walk inside rooms. Unit coordinates throughout."""

import logging
from dataclasses import dataclass, replace
from math import pi, radians, tan

import numpy as np
from jaxtyping import Bool, Float, Float64

from prtnet import PrtnetError
from prtnet.data.samples import area_uniform
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer

log = logging.getLogger(__name__)
Array = np.ndarray
Point = tuple[float, float, float]

ORBIT_FOV, INSIDE_FOV = 40.0, 70.0
# degrees above the horizon: the middle of the orbit and how far it swings, twice per turn
ELEVATION, SWING = 26.0, 10.0
# the share of the vertices per side and axis that the orbit may cut off, so that a ground plane does not count
OUTLIERS = 1.0
# least mean share of the frame that shows the scene
COVERAGE = 0.5
# metres do not exist here: eyes stand at one of these shares of the way from floor to ceiling
EYE_HEIGHTS = (0.35, 0.5)
# how near a walk may come to a surface, the distance above which nearness is not measured, the grid of the walk
CLEARANCE, MAX_CLEARANCE, GRID = 0.07, 0.25, 40
# a room's middle has at most this share of free directions: windows and a missing wall, not a missing half
OPEN = 0.45
CANDIDATES = 600


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; frames are square unless an aspect is given."""

    eye: Point
    target: Point
    up: Point = (0.0, 1.0, 0.0)
    # degrees
    fov_y: float = ORBIT_FOV
    near: float = 0.01
    far: float = 20.0

    def basis(self) -> Float64[Array, "3 3"]:
        """Rows: right, up, and backward (from the target to the eye), orthonormal, in unit coordinates."""
        backward = np.subtract(self.eye, self.target)
        backward = backward / np.linalg.norm(backward)
        right = np.cross(self.up, backward)
        right = right / np.linalg.norm(right)
        return np.stack([right, np.cross(backward, right), backward])

    def view(self) -> Float64[Array, "4 4"]:
        """Unit coordinates to eye coordinates (x right, y up, looking down -z)."""
        matrix, basis = np.eye(4), self.basis()
        matrix[:3, :3], matrix[:3, 3] = basis, -basis @ np.array(self.eye)
        return matrix

    def projection(self, aspect: float = 1.0) -> Float64[Array, "4 4"]:
        """Eye coordinates to OpenGL's clip coordinates, z in [-1, 1]."""
        scale, depth = 1 / tan(radians(self.fov_y) / 2), self.near - self.far
        matrix = np.diag([scale / aspect, scale, (self.near + self.far) / depth, 0.0])
        matrix[2, 3], matrix[3, 2] = 2 * self.near * self.far / depth, -1.0
        return matrix

    def matrix(self, aspect: float = 1.0) -> Float64[Array, "4 4"]:
        """Unit coordinates to clip coordinates."""
        return self.projection(aspect) @ self.view()

    def rays(self, size: int) -> Float64[Array, "size size 3"]:
        """Unit directions through the pixel centres of a square frame, row 0 on top."""
        x = ((np.arange(size) + 0.5) / size * 2 - 1) * tan(radians(self.fov_y) / 2)
        local = np.stack([*np.meshgrid(x, -x), -np.ones((size, size))], axis=-1)
        directions = local @ self.basis()
        return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def path(scene: Scene, tracer: Tracer, views: int, *, kind: str = "auto") -> list[Camera]:
    """`views` cameras, uniform on the scene's own closed path; `kind` as in `kind_of`.

    Raises PrtnetError for an unknown kind, or where no free point is found inside.
    """
    if views < 1:
        raise PrtnetError(f"render.views: found {views}, expected at least 1")
    cameras = _orbit if kind_of(scene, tracer, kind) == "orbit" else _inside
    return cameras(scene, tracer, views)


def kind_of(scene: Scene, tracer: Tracer, kind: str = "auto") -> str:
    """Orbit or inside: what is asked for, else what the scene says, else inside if most points of its middle are
    free and closed in. Raises PrtnetError for another word."""
    if kind == "auto":
        kind = scene.camera
    if kind == "auto":
        kind = "inside" if _closed_in(scene, tracer) else "orbit"
        log.info("camera: %s", kind)
    if kind not in ("orbit", "inside"):
        raise PrtnetError(f"camera: found {kind!r}, expected auto, orbit or inside")
    return kind


def coverage(scene: Scene, tracer: Tracer, camera: Camera, size: int = 32) -> float:
    """Share of the frame's rays that hit the scene."""
    return 1 - float(np.mean(_free(scene, tracer, np.array(camera.eye), camera.rays(size).reshape(-1, 3))))


def _free(scene: Scene, tracer: Tracer, eye: Float[Array, " 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
    origins = np.broadcast_to(scene.frame.from_unit(eye), directions.shape)
    return ~tracer.occluded(np.ascontiguousarray(origins), directions)


def _orbit(scene: Scene, tracer: Tracer, views: int) -> list[Camera]:
    """Around the bulk of the vertices, as far as they fit the frame, nearer where too little of the frame is filled."""
    points = scene.frame.to_unit(scene.vertices[np.unique(scene.faces)])
    low, high = np.percentile(points, [OUTLIERS, 100 - OUTLIERS], axis=0)
    kept = points[((points >= low) & (points <= high)).all(axis=1)]
    kept = kept if len(kept) else points
    azimuth = (np.arange(views) + 0.5) / views * 2 * pi
    elevation = np.radians(ELEVATION + SWING * np.sin(2 * azimuth))
    away = np.stack([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)], 1)
    middle = (low + high) / 2
    fits = np.array([_fitting_distance(kept - middle, direction) for direction in away])
    cameras: list[Camera] = []
    for nearer in np.linspace(1, 0.6, 21):
        cameras = [look(middle + nearer * fit * way, middle, ORBIT_FOV) for fit, way in zip(fits, away, strict=True)]
        shown = np.mean([coverage(scene, tracer, camera) for camera in cameras[:: max(1, views // 8)]])
        if shown >= COVERAGE:
            break
    return [before(camera, points) for camera in cameras]


def before(camera: Camera, points: Float[Array, "n 3"]) -> Camera:
    """The camera with its near plane moved up to the vertices, of which it cuts off none: a depth buffer tells
    distances apart by their ratio to that plane's, and faces that all but touch need all it has."""
    depth = (np.array(camera.eye) - points) @ camera.basis()[2]
    return replace(camera, near=max(camera.near, 0.99 * float(depth.min())))


def _fitting_distance(points: Float[Array, "n 3"], direction: Float[Array, " 3"]) -> float:
    """How far from the middle an eye must be to have all but the outermost points in its frame."""
    basis = Camera(_point(direction), (0.0, 0.0, 0.0)).basis()
    right, up, backward = basis @ points.T
    needed = backward + np.maximum(np.abs(right), np.abs(up)) / tan(radians(ORBIT_FOV) / 2)
    return float(np.percentile(needed, 100 - OUTLIERS / 2)) * 1.03


def look(eye: Float[Array, " 3"], target: Float[Array, " 3"], fov_y: float) -> Camera:
    """A camera that cuts nothing off the scene."""
    # the far plane clears the cube [-1, 1]^3 from wherever the eye is
    far = float(np.linalg.norm(eye)) + 2.0
    return Camera(_point(eye), _point(target), fov_y=fov_y, near=far / 2000, far=far)


def _point(values: Float[Array, " 3"]) -> Point:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _closed_in(scene: Scene, tracer: Tracer) -> bool:
    """Whether most free points of the scene's middle see little but the scene: a room, a hall."""
    rng = np.random.default_rng(0)
    half = _half_extent(scene)
    points = rng.uniform(-0.6, 0.6, (48, 3)) * half
    directions = rng.normal(size=(128, 3))
    free = [np.mean(_free(scene, tracer, point, directions)) for point in points]
    # inside a solid everything is closed in, too: there the surface winds round the point
    enclosed = (np.array(free) < 0.2) & (winding(scene, points) < 0.5)
    return bool(np.mean(enclosed) > 0.4)


def _half_extent(scene: Scene) -> Float64[Array, " 3"]:
    return np.abs(scene.frame.to_unit(scene.vertices[np.unique(scene.faces)])).max(axis=0)


def winding(scene: Scene, points: Float[Array, "n 3"]) -> Float64[Array, " n"]:
    """Generalised winding number at points in unit coordinates: 1 inside a solid, -1 in a room of inward faces.

    Jacobson, Kavan and Sorkine-Hornung 2013, eq. 5; solid angles after Van Oosterom and Strackee 1983.
    """
    corners = scene.frame.to_unit(scene.vertices)[scene.faces]
    out = np.empty(len(points))
    for i, point in enumerate(points):
        a, b, c = np.moveaxis(corners - point, 1, 0)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        dot = [np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a))]
        below = la * lb * lc + dot[0] * lc + dot[1] * la + dot[2] * lb
        out[i] = np.sum(np.arctan2(np.einsum("ij,ij->i", a, np.cross(b, c)), below)) / (2 * pi)
    return out


@dataclass(frozen=True, eq=False)
class _Floor:
    """Clearance at one height, on a grid over x and z."""

    height: float
    low: Float64[Array, " 3"]
    high: Float64[Array, " 3"]
    clear: Float64[Array, "g g"]

    def at(self, points: Float[Array, "*n 3"]) -> Float64[Array, "*n"]:
        """Clearance at the nearest grid point; 0 outside."""
        cell = np.round((points - self.low) / np.maximum(self.high - self.low, 1e-9) * (GRID - 1)).astype(np.int64)
        inside = ((cell >= 0) & (cell < GRID))[..., [0, 2]].all(axis=-1)
        cell = np.clip(cell, 0, GRID - 1)
        return np.where(inside, self.clear[cell[..., 0], cell[..., 2]], 0.0)

    def reach(self, points: Float[Array, "n 3"], azimuth: Float[Array, " a"]) -> Float64[Array, "n a"]:
        """How far one can walk from each point in each direction before something comes too near."""
        steps = np.arange(0, 3, 0.02)
        way = np.stack([np.sin(azimuth), np.zeros_like(azimuth), np.cos(azimuth)], axis=1)
        walk = points[:, None, None] + steps[:, None] * way[:, None]
        blocked = self.at(walk) < CLEARANCE
        blocked[..., -1] = True
        return steps[np.argmax(blocked, axis=-1)]


def _inside(scene: Scene, tracer: Tracer, views: int) -> list[Camera]:
    """Eyes on a closed walk around the middle of the widest space at eye height, each looking across that middle."""
    floor, middle = _widest(scene, tracer)
    azimuth = (np.arange(views) + 0.5) / views * 2 * pi
    # a walk that jumps from niche to niche is none: the reach of a direction is the least of its surroundings
    spread = np.radians(np.linspace(-20, 20, 9))
    own, across = (floor.reach(middle, (turn + azimuth[:, None] + spread).ravel())[0] for turn in (0, pi))
    own, across = (reach.reshape(views, -1).min(axis=1)[:, None] for reach in (own, across))
    way = np.stack([np.sin(azimuth), np.zeros(views), np.cos(azimuth)], axis=1)
    eyes, targets = middle + 0.75 * own * way, middle - 0.5 * across * way
    # more of the floor than of the ceiling
    targets[:, 1] -= 0.2 * np.linalg.norm(eyes - targets, axis=1)
    return [look(eye, target, INSIDE_FOV) for eye, target in zip(eyes, targets, strict=True)]


def _widest(scene: Scene, tracer: Tracer) -> tuple[_Floor, Float64[Array, "1 3"]]:
    """The free point that is best closed in and has the longest walks around it, and the floor it is on."""
    azimuth, rng = np.arange(24) / 24 * 2 * pi, np.random.default_rng(0)
    directions = rng.normal(size=(256, 3))
    found = []
    for floor in _floors(scene):
        grid = np.stack(np.meshgrid(*np.linspace(floor.low, floor.high, GRID)[:, [0, 2]].T, indexing="ij"), axis=-1)
        points = np.insert(grid[floor.clear > 1.5 * CLEARANCE], 1, floor.height, axis=1)
        # the harmonic mean likes round spaces better than corridors
        wide = 1 / np.mean(1 / (floor.reach(points, azimuth) + 0.05), axis=1) if len(points) else np.zeros(0)
        found += [(wide[i], floor, points[i]) for i in np.argsort(-wide)]
    best, middle = 0.0, None
    for wide, floor, point in sorted(found, key=lambda entry: -entry[0])[:CANDIDATES]:
        free = np.mean(_free(scene, tracer, point, directions))
        score = wide * (1 - free) ** 3
        if score > best and free < OPEN and winding(scene, point[None])[0] < 0.5:
            best, middle = score, (floor, point[None])
    if middle is None:
        raise PrtnetError(f"{scene.name}: found no free point that is closed in, expected a room to look around in")
    return middle


def _floors(scene: Scene) -> list[_Floor]:
    surface = scene.frame.to_unit(area_uniform(scene, 12_000, np.random.default_rng(0)).positions)
    low, high = surface.min(axis=0), surface.max(axis=0)
    x, z = (np.linspace(low[axis], high[axis], GRID) for axis in (0, 2))
    floors = []
    for height in low[1] + np.array(EYE_HEIGHTS) * (high[1] - low[1]):
        near = surface[np.abs(surface[:, 1] - height) < MAX_CLEARANCE]
        clear = np.full((GRID, GRID), MAX_CLEARANCE)
        for i, j in np.ndindex(GRID, GRID):
            away = near - np.array([x[i], height, z[j]])
            clear[i, j] = np.sqrt(min(MAX_CLEARANCE**2, np.min(np.einsum("ij,ij->i", away, away), initial=9)))
        floors.append(_Floor(float(height), low, high, clear))
    return floors
