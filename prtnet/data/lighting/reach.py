"""Which places of a scene are worth a lamp, and what of the scene a light reaches. Unit coordinates.

A room, whose inside sees surfaces almost everywhere, is lit and judged from within: its outer walls do not count.
Other scenes are lit from among and around their things, above the ground that they stand on.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Float64

from prtnet import PrtnetError
from prtnet.data import directions as sets
from prtnet.data.lighting import direct
from prtnet.data.lighting.lamp import Lamp
from prtnet.data.lighting.placing import Places
from prtnet.data.samples import Samples, area_uniform, select
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer, rays

Array = np.ndarray

POINTS = 256  # by which a light is judged
CANDIDATES = 2048
CLEAR = 0.25  # unit lengths between a lamp and any surface
HIDDEN = 0.01  # unit lengths: points that see no further are no part of what is judged
ROOM = 0.6  # share of directions in which the middling free place of a room sees a surface
WITHIN = 0.7  # of that share, which a place or a point in a room has at least
SHELL = 0.8  # unit lengths around the box of a scene that is no room
POOL = 256  # places that are looked at together
TRIES = 16  # pools without a place


class Reach:
    """What lights are chosen by, in one scene. Its points and places are drawn from `rng`."""

    def __init__(self, scene: Scene, tracer: Tracer, rng: np.random.Generator):
        self.scene, self.tracer = scene, tracer
        self._around, self._rng = Places(scene, tracer), rng
        self._box = scene.vertices.min(axis=0), scene.vertices.max(axis=0)
        within = self._free(self._proposed(rng, 0.0, 2 * POOL))
        self._enclosure = float(np.median(self._around.enclosure(within))) if len(within) else 0.0
        self.room = self._enclosure > ROOM
        self.points, self._open = self._judges(rng)
        self._places = self._pool()

    def place(self) -> Float64[Array, " 3"]:
        """The next free place."""
        return next(self._places)

    def sees_out(self) -> bool:
        """Whether any light from far away gets to the points."""
        return bool(self._open.any())

    def irradiance(self, lamp: Lamp) -> Float64[Array, " n"]:
        """Of the points, were the lamp's colour 1."""
        places, normals, sides = (
            np.asarray(each, np.float64)
            for each in (self.points.positions, self.points.normals, self.points.geometric_normals)
        )
        starts = (places + self.tracer.offset * sides).astype(np.float32)
        return direct.from_lamp(lamp, self.tracer, places, normals, sides, starts)

    def _judges(self, rng: np.random.Generator) -> tuple[Samples, Array]:
        """(points, whether each sees out of the scene)."""
        found = area_uniform(self.scene, CANDIDATES, rng)
        far = self._seen(found)
        good = far.max(axis=1) > HIDDEN
        if self.room:
            inner = good & (np.isfinite(far).mean(axis=1) > WITHIN * self._enclosure)
            good = inner if inner.any() else good
        chosen = np.flatnonzero(good)[:POINTS]
        if not len(chosen):
            raise PrtnetError(f"{self.scene.name}: found no surface that light can reach")
        return select(found, chosen), np.any(np.isinf(far[chosen]), axis=1)

    def _seen(self, points: Samples) -> Float[Array, "n d"]:
        """How far points see, in unit lengths; infinite out of the scene."""
        local, _ = sets.local_set("cosine_fibonacci", 64, np.random.default_rng(0))
        frames = sets.frames(sets.turns(points.geometric_normals, np.zeros(len(points.face))))
        starts = points.positions + self.tracer.offset * points.geometric_normals
        return self.tracer.hits(*rays(starts.astype(np.float32), frames, local.astype(np.float32)))[2].reshape(
            len(frames), -1
        )

    def _pool(self) -> Iterator[Float64[Array, " 3"]]:
        failed = 0
        while failed < TRIES:
            inner = self._proposed(self._rng, 0.0, POOL)
            outer = self._proposed(self._rng, SHELL, POOL)
            around = self._rng.random(POOL) < 0.5
            found = self._free(inner if self.room else np.where(around[:, None], outer, inner))
            if self.room and len(found):
                found = found[self._around.enclosure(found) >= WITHIN * self._enclosure]
            failed = 0 if len(found) else failed + 1
            yield from found
        raise PrtnetError(
            f"{self.scene.name}: found no free place for a lamp, {CLEAR} unit lengths from every surface and outside of"
            " solids, expected a scene with room in it or around it"
        )

    def _proposed(self, rng: np.random.Generator, margin: float, count: int) -> Float64[Array, "n 3"]:
        low, high = self._box
        # nothing below the ground
        return rng.uniform(low - np.array([margin, 0, margin]), high + margin, (count, 3))

    def _free(self, places: Float64[Array, "n 3"]) -> Float64[Array, "n 3"]:
        places = places[self._around.distance(places) >= CLEAR]
        return places[~self._around.inside(places)] if len(places) else places
