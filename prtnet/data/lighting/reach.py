"""Which places of a scene are worth a lamp, and what of the scene a light reaches. Unit coordinates.

Rooms are lit from within, other scenes from among and around their things, above the ground that they stand on.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float64

from prtnet import PrtnetError
from prtnet.data.lighting import direct
from prtnet.data.lighting.lamp import Lamp
from prtnet.data.lighting.placing import WITHIN, Places
from prtnet.data.samples import area_uniform, select
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer

Array = np.ndarray

POINTS = 256  # by which a light is judged
CANDIDATES = 2048
SHELL = 0.8  # unit lengths around the box of a scene that is no room
POOL = 256  # places that are looked at together
LEAST_CLEAR = 0.02  # unit lengths between a lamp and any surface, where there is no more room


class Reach:
    """What lights are chosen by, in one scene. Its points and places are drawn from `rng`."""

    def __init__(self, scene: Scene, tracer: Tracer, rng: np.random.Generator):
        self.scene, self.tracer = scene, tracer
        self._around, self._rng = Places(scene, tracer), rng
        found = area_uniform(scene, CANDIDATES, rng)
        worth, sees_out = self._around.worth(found)
        chosen = np.flatnonzero(worth)[:POINTS]
        if not len(chosen):
            raise PrtnetError(f"{scene.name}: found no surface that light can reach: all lie on each other")
        self.points, self._open = select(found, chosen), sees_out[chosen]
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

    def _pool(self) -> Iterator[Float64[Array, " 3"]]:
        clear, room = self._around.clear, self._around.room
        while clear > LEAST_CLEAR:
            inner, outer = self._proposed(0.0), self._proposed(SHELL)
            around = self._rng.random(POOL) < 0.5
            found = inner if room else np.where(around[:, None], outer, inner)
            found = found[self._around.free(found, clear)]
            if room and len(found):
                found = found[self._around.enclosure(found) >= WITHIN * room]
            # in a narrow scene nearer to its surfaces
            clear = clear if len(found) else clear * 0.8
            yield from found
        raise PrtnetError(
            f"{self.scene.name}: found no free place for a lamp, {LEAST_CLEAR} unit lengths from every surface and"
            " outside of solids, expected a scene with room in it or around it"
        )

    def _proposed(self, margin: float) -> Float64[Array, "n 3"]:
        low, high = self.scene.vertices.min(axis=0), self.scene.vertices.max(axis=0)
        # nothing below the ground
        return self._rng.uniform(low - np.array([margin, 0, margin]), high + margin, (POOL, 3))
