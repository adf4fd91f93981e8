"""Signed distance to a triangle mesh, in unit coordinates: negative inside.

The length is exact: to the nearest triangle, by a tree of boxes. The sign is a vote: rays go out from the point, and
those that leave more surfaces than they enter say inside. A hole, which a few rays pass, turns no vote, and parts of a
mesh may overlap.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64

from prtnet import PrtnetError
from prtnet.data.nearest import boxes_of, nearest
from prtnet.data.normals import unit
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer

Array = np.ndarray

VOTES = 15  # rays of a point, odd, so that there is no tie
NEAR = 1e-3  # of the surface: points closer to it do not judge a mesh, their rays may start on either side
DOUBTFUL = 0.25  # of a vote, from 0 and from 1, beyond which a point is in doubt
LAYERS = 64  # surfaces that a ray meets, at most
LARGEST_DOUBT = 0.05  # share of points in doubt above which a mesh has no inside


@dataclass(frozen=True, eq=False)
class Nearest:
    """Of each point: the unsigned distance, the triangle, the point on it."""

    distance: Float64[Array, " n"]
    face: Int64[Array, " n"]
    where: Float64[Array, "n 3"]

    def at(self, index: Int64[Array, " m"]) -> "Nearest":
        """Of some of the points."""
        return Nearest(self.distance[index], self.face[index], self.where[index])


class Distance:
    """Distances to one scene. Points and distances in its unit coordinates."""

    def __init__(self, scene: Scene):
        self.scene = scene.centred()
        corners = self.scene.vertices[self.scene.faces]
        self._order, self._boxes = boxes_of(corners)
        self._corners = np.ascontiguousarray(corners[self._order])
        self._tracer = Tracer(self.scene)

    def nearest(self, points: Float[Array, "n 3"]) -> Nearest:
        """The nearest triangle of each point, exact in float64."""
        points = np.ascontiguousarray(points, np.float64)
        face, where = np.empty(len(points), np.int64), np.empty((len(points), 3))
        nearest(points, self._corners, self._boxes, face, where)
        return Nearest(np.linalg.norm(points - where, axis=1), self._order[face], where)

    def inside(self, points: Float[Array, "n 3"], rng: np.random.Generator) -> Float64[Array, " n"]:
        """The mean over a point's rays, in directions by chance: 1 where all say inside, 0 outside, below 0 where
        triangles are wound inwards."""
        found = np.zeros(len(points))
        for _ in range(VOTES):
            found += np.clip(self._crossings(points, unit(rng.normal(size=points.shape))), -1, 1)
        return found / VOTES

    def _crossings(self, points: Float[Array, "n 3"], towards: Float[Array, "n 3"]) -> Int64[Array, " n"]:
        """Back faces less front faces that rays meet: the winding number, where the mesh is closed."""
        total, at, flying = np.zeros(len(points), np.int64), np.array(points, np.float64), np.arange(len(points))
        for _ in range(LAYERS):
            face, _, length = self._tracer.hits(at[flying], towards[flying])
            flying, face, length = flying[face >= 0], face[face >= 0], length[face >= 0]
            if not len(flying):
                break
            back = np.einsum("ni,ni->n", self.scene.face_normals[face], towards[flying]) > 0
            total[flying] += np.where(back, 1, -1)
            at[flying] += (length + self._tracer.offset)[:, None] * towards[flying]
        return total

    def hidden(self, found: Nearest, rng: np.random.Generator) -> Bool[Array, " n"]:
        """Whether nearest points lie within the solid, where parts of a mesh overlap: nobody sees the surface there."""
        above = found.where + NEAR * self.scene.face_normals[found.face]
        return self.inside(above, rng) > 0.5

    def signed(self, points: Float[Array, "n 3"], rng: np.random.Generator) -> tuple[Float64[Array, " n"], Nearest]:
        """Signed distances, and the nearest points they go to.

        Raises PrtnetError for a mesh so open, or of such winding, that the votes of many points disagree.
        """
        found, vote = self.nearest(points), self.inside(points, rng)
        judges = vote[found.distance > NEAR]
        doubt = np.mean((judges < -DOUBTFUL) | ((judges > DOUBTFUL) & (judges < 1 - DOUBTFUL))) if len(judges) else 0
        if doubt > LARGEST_DOUBT:
            raise PrtnetError(
                f"{self.scene.name}: found no clear inside: at {100 * doubt:.0f} % of the points the rays disagree, "
                f"expected at most {100 * LARGEST_DOUBT:.0f} %; close the holes of the mesh, wind all its triangles "
                "outward, and leave out single sheets (scene.without)"
            )
        return np.where(vote > 0.5, -found.distance, found.distance), found


def nearest_of_all(points: Float[Array, "n 3"], corners: Float[Array, "f 3 3"]) -> Float64[Array, " n"]:
    """The plain twin of `Distance.nearest`: the least distance to triangles, every one of them tried in turn.

    To a triangle it is that to its plane where the foot lies within, else the least one to its edges.
    """
    points, best = np.asarray(points, np.float64), np.full(len(points), np.inf)
    for triangle in np.asarray(corners, np.float64):
        normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
        normal /= np.linalg.norm(normal)
        within = np.ones(len(points), bool)
        for start, end in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
            edge, away = end - start, points - start
            within &= away @ np.cross(normal, edge) >= 0
            along = np.clip(away @ edge / (edge @ edge), 0, 1)
            best = np.minimum(best, np.linalg.norm(away - along[:, None] * edge, axis=1))
        best = np.where(within, np.minimum(best, np.abs((points - triangle[0]) @ normal)), best)
    return best
