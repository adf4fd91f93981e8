"""What surrounds a place: where lamps may stand, and which surfaces are worth lighting. Unit coordinates.

A room, whose inside sees surfaces almost everywhere, is lit and looked at from within: its outer walls do not count.
"""

from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Float64

from prtnet import PrtnetError
from prtnet.data import directions as sets
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.nearest import boxes_of, nearest
from prtnet.data.normals import unit
from prtnet.data.samples import Samples
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer, rays

Array = np.ndarray

RAYS = 64  # from a place, in all directions
INSIDE = 0.5  # share of a place's rays that must say so
LAYERS = 64  # surfaces that a ray meets, at most
CLEAR = 0.25  # unit lengths between a lamp drawn at random and any surface
CLEARER = 75  # percent of the free places in a room that are nearer, at most
NEAR = 0.02  # unit lengths: places nearer to a surface see little else
HIDDEN = 0.01  # unit lengths: points that see no further, as on the bottom of what stands on a floor, have no light
ROOM = 0.7  # share of directions in which the middling free place of a room sees a surface
WITHIN = 0.7  # of that share, which places in a room have at least
INNER = 0.3  # of that share, which points on the surfaces of a room have at least
TRIED = 512  # places that a scene is known as a room by


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
    def _within(self) -> tuple[Float64[Array, "n 3"], Float64[Array, " n"]]:
        """(free places in the scene's box, their enclosure)."""
        low, high = self.scene.vertices.min(axis=0), self.scene.vertices.max(axis=0)
        places = np.random.default_rng(0).uniform(low, high, (TRIED, 3))
        places = places[self.free(places, NEAR)]
        return places, self.enclosure(places)

    @cached_property
    def room(self) -> float:
        """Share of directions in which the middling free place in the scene's box sees surfaces; 0 for no room."""
        _, enclosure = self._within
        share = float(np.median(enclosure)) if len(enclosure) else 0.0
        return share if share > ROOM else 0.0

    @cached_property
    def clear(self) -> float:
        """How far from all surfaces lamps are drawn: what light they send there stays of the order of the mean."""
        places, enclosure = self._within
        inner = places[enclosure >= WITHIN * self.room]
        return min(CLEAR, float(np.percentile(self.distance(inner), CLEARER))) if self.room else CLEAR

    def free(self, positions: Float[Array, "n 3"], clear: float) -> Bool[Array, " n"]:
        """Whether a lamp may be put there: `clear` or more from all surfaces, in no solid."""
        found = self.distance(positions) >= clear
        found[found] = ~self.inside(positions[found])
        return found

    def worth(self, points: Samples) -> tuple[Bool[Array, " n"], Bool[Array, " n"]]:
        """(whether surface points can be lit and, in a room, belong to its inside, whether they see out of the scene).

        Of a room that has no such points all that are not hidden count.
        """
        local, _ = sets.local_set("cosine_fibonacci", RAYS, np.random.default_rng(0))
        frames = sets.frames(sets.turns(points.geometric_normals, np.zeros(len(points.face))))
        starts = (points.positions + self.tracer.offset * points.geometric_normals).astype(np.float32)
        origins, towards = rays(starts, frames, local.astype(np.float32))
        face, _, far = self.tracer.hits(origins, towards)
        face, far = face.reshape(len(starts), -1), far.reshape(len(starts), -1)
        buried = np.mean(self._crossing(face, towards.reshape(len(starts), -1, 3)) > 0, axis=1) > INSIDE
        seen = (far.max(axis=1) > HIDDEN) & ~buried
        inner = seen & (np.isfinite(far).mean(axis=1) > INNER * self.room)
        return inner if self.room and inner.any() else seen, np.any(np.isinf(far), axis=1)

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
        return np.mean(self._first(positions) >= 0, axis=1)

    def inside(self, positions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        """Whether places are within a solid: most rays see its faces from behind, or leave more faces than they enter.

        The first finds tables in rooms that are nothing but walls facing inwards, the second the inside of solids that
        others reach into. Two-sided faces bound no solid, and holes turn few rays.
        """
        if not len(positions):
            return np.zeros(0, bool)
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
