"""Where lamps may stand: not inside solids, not on a surface, and in rooms between their walls. Unit coordinates."""

from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float64

from prtnet import PrtnetError
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.nearest import boxes_of, nearest
from prtnet.data.normals import unit
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer

Array = np.ndarray

RAYS = 64  # from a place, in all directions
INSIDE = 0.5  # share of a place's rays that must say so
LAYERS = 64  # surfaces that a ray meets, at most


def check(lighting: Lighting, scene: Scene, tracer: Tracer) -> None:
    """Raises PrtnetError, naming the lamp, where one stands inside geometry or nearer to it than rays start off it."""
    near = [(i, lamp) for i, lamp in enumerate(lighting.lamps) if lamp.kind != "directional"]
    if not near:
        return
    where = Places(scene, tracer)
    positions = np.array([lamp.position for _, lamp in near])
    inside, distance = where.inside(positions), where.distance(positions)
    for (number, lamp), within, away in zip(near, inside, distance, strict=True):
        if within or away <= tracer.offset:
            place = ", ".join(f"{value:.4g}" for value in lamp.position)
            found = "inside geometry" if within else f"{away:.2g} unit lengths from a surface"
            raise PrtnetError(
                f"lighting: found the {lamp.kind} lamp {number} at ({place}) {found}, expected a free place more than"
                f" {tracer.offset:.2g} from any surface; coordinates are those of the scene moved into [-1, 1]"
            )


class Places:
    """What surrounds places in one scene; `tracer` is that of its triangles."""

    def __init__(self, scene: Scene, tracer: Tracer):
        self.scene, self.tracer = scene.centred(), tracer
        self._fans = fibonacci(RAYS)

    @cached_property
    def _tree(self) -> tuple[Array, Array]:
        corners = self.scene.vertices[self.scene.faces]
        order, boxes = boxes_of(corners)
        return np.ascontiguousarray(corners[order]), boxes

    def distance(self, positions: Float[Array, "n 3"]) -> Float64[Array, " n"]:
        """To the nearest surface."""
        points = np.ascontiguousarray(positions, np.float64)
        face, where = np.empty(len(points), np.int64), np.empty((len(points), 3))
        nearest(points, *self._tree, face, where)
        return np.linalg.norm(points - where, axis=1)

    def enclosure(self, positions: Float[Array, "n 3"]) -> Float64[Array, " n"]:
        """Share of all directions in which one sees a surface."""
        face = self._first(positions)
        return np.mean(face >= 0, axis=1)

    def inside(self, positions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        """Whether places are within a solid: most rays see its faces from behind, or leave more faces than they enter.

        The first finds tables in rooms that are nothing but walls facing inwards, the second the inside of solids that
        others reach into. Two-sided faces bound no solid, and holes turn few rays.
        """
        face = self._first(positions)
        towards = np.broadcast_to(self._fans, (*face.shape, 3))
        seen_behind = np.mean(self._crossing(face, towards) > 0, axis=1) > INSIDE
        return seen_behind | (self._winding(positions) > INSIDE)

    def _first(self, positions: Array) -> Array:
        origins = np.repeat(np.asarray(positions, np.float32), RAYS, axis=0)
        return self.tracer.hits(origins, np.tile(self._fans, (len(positions), 1)))[0].reshape(-1, RAYS)

    def _crossing(self, face: Array, towards: Array) -> Array:
        """+1 where a ray leaves a solid, -1 where it enters one, else 0."""
        leaving = np.sign(np.einsum("...i,...i->...", self.scene.face_normals[face], towards)).astype(int)
        return np.where((face < 0) | self.scene.two_sided[face], 0, leaving)

    def _winding(self, positions: Array) -> Array:
        at = np.repeat(np.asarray(positions, np.float64), RAYS, axis=0)
        towards, total = np.tile(self._fans, (len(positions), 1)), np.zeros(len(at), int)
        flying = np.arange(len(at))
        for _ in range(LAYERS):
            face, _, length = self.tracer.hits(at[flying], towards[flying])
            flying, face, length = flying[face >= 0], face[face >= 0], length[face >= 0].astype(np.float64)
            if not len(flying):
                break
            total[flying] += self._crossing(face, towards[flying])
            at[flying] += (length + self.tracer.offset)[:, None] * towards[flying]
        return np.clip(total, -1, 1).reshape(-1, RAYS).mean(axis=1)


def fibonacci(count: int) -> Float64[Array, "n 3"]:
    """Even directions on the sphere (Keinert et al. 2015), turned so that none lies along an axis."""
    height = 1 - (2 * np.arange(count) + 1) / count
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5)) + 0.31
    radius = np.sqrt(1 - height**2)
    return unit(np.stack([radius * np.cos(turn), height, radius * np.sin(turn)], axis=1) + 1e-3)
