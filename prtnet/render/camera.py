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
COVERAGE = 0.55
# metres do not exist here: eyes stand at this share of the way from floor to ceiling
EYE_HEIGHT = 0.45


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
    """`views` cameras, uniform on the scene's own closed path.

    `kind` is "orbit", "inside", or "auto": what the scene says, and where it says nothing, inside if most points of its
    middle are free and closed in. Raises PrtnetError for another kind, or where no free point is found inside.
    """
    if kind == "auto":
        kind = scene.camera
    if kind == "auto":
        kind = "inside" if _closed_in(scene, tracer) else "orbit"
        log.info("camera: %s", kind)
    if views < 1:
        raise PrtnetError(f"render.views: found {views}, expected at least 1")
    if kind == "orbit":
        return _orbit(scene, tracer, views)
    if kind == "inside":
        return _inside(scene, views)
    raise PrtnetError(f"camera: found {kind!r}, expected auto, orbit or inside")


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
    for nearer in (1.0, 0.92, 0.85, 0.78, 0.72, 0.66, 0.6):
        cameras = [_look(middle + nearer * fit * way, middle, ORBIT_FOV) for fit, way in zip(fits, away, strict=True)]
        shown = np.mean([coverage(scene, tracer, camera) for camera in cameras[:: max(1, views // 8)]])
        if shown >= COVERAGE:
            break
    return cameras


def _fitting_distance(points: Float[Array, "n 3"], direction: Float[Array, " 3"]) -> float:
    """How far from the middle an eye must be to have all but the outermost points in its frame."""
    basis = Camera(_point(direction), (0.0, 0.0, 0.0)).basis()
    right, up, backward = basis @ points.T
    needed = backward + np.maximum(np.abs(right), np.abs(up)) / tan(radians(ORBIT_FOV) / 2)
    return float(np.percentile(needed, 100 - OUTLIERS / 2)) * 1.03


def _look(eye: Float[Array, " 3"], target: Float[Array, " 3"], fov_y: float) -> Camera:
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
    """Generalised winding number at points in unit coordinates: 1 inside a solid, -1 in a room whose faces look inwards.

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


def _inside(scene: Scene, views: int) -> list[Camera]:
    """Eyes on a closed walk around the middle at eye height, each looking across the middle to the other side."""
    half = _half_extent(scene)
    height = -half[1] + 2 * EYE_HEIGHT * half[1]
    azimuth = (np.arange(views) + 0.5) / views * 2 * pi
    share = np.linspace(0.25, 0.75, 11)
    outwards = np.stack([np.sin(azimuth) * half[0], np.zeros(views), np.cos(azimuth) * half[2]], axis=1)
    candidates = share[None, :, None] * outwards[:, None] + [0, height, 0]
    room = clearance(scene, candidates.reshape(-1, 3)).reshape(views, -1)
    solid = (winding(scene, candidates.reshape(-1, 3)) > 0.5).reshape(views, -1)
    # half-way out is best, and more than an arm's length of clearance does not matter
    score = np.minimum(room, 0.15) / 0.15 - 2 * np.abs(share - 0.55) - 10 * solid
    if np.all(solid):
        raise PrtnetError(f"{scene.name}: no free point found at eye height, expected a room; set the camera to orbit")
    eyes = candidates[np.arange(views), np.argmax(score, axis=1)]
    target = -0.35 * eyes * [1, 0, 1] + [0, height - 0.15 * half[1], 0]
    return [replace(_look(eye, at, INSIDE_FOV), near=0.005) for eye, at in zip(eyes, target, strict=True)]


def clearance(scene: Scene, points: Float[Array, "n 3"]) -> Float64[Array, " n"]:
    """Distance from unit-coordinate points to the nearest surface, to about 0.02."""
    surface = scene.frame.to_unit(area_uniform(scene, 20_000, np.random.default_rng(0)).positions)
    return np.array([np.sqrt(np.min(np.sum((surface - point) ** 2, axis=1))) for point in points])
