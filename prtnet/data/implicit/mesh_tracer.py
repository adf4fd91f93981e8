"""The quicker visibility: Embree on the projected mesh of an implicit surface.

Between its vertices the mesh lies beside the surface: points of the surface are above it where it bulges, and below it
in hollows, where every ray would hit the mesh from behind. So each point first sends one ray along its normal; if that
leaves the mesh within a voxel, the point starts from there. An offset that clears all hollows by itself must be ten
times as large, and lifts points in creases out of the shade (experiments/results/bench_implicit.csv).
"""

import numpy as np
from jaxtyping import Float

from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer

OFFSET = 0.02  # voxels at which rays start off the mesh
REACH = 1.0  # voxels within which a point below the mesh is lifted through it


class MeshTracer(Tracer):
    """Rays against `mesh.scene_of(implicit, resolution)` from points of the surface itself."""

    def __init__(self, scene: Scene, resolution: int, *, kind: str = "auto"):
        super().__init__(scene, kind=kind, offset=OFFSET * 2 / resolution)
        self._reach = REACH * 2 / resolution
        self._outwards = scene.face_normals.astype(np.float32)

    def origins(
        self, positions: Float[np.ndarray, "n 3"], geometric_normals: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """Where rays start: unit coordinates, float32, off both the surface and its mesh along the unit normals."""
        unit, normals = self.frame.to_unit(positions), geometric_normals.astype(np.float32)
        face, _, distance = self.hits(unit.astype(np.float32), normals)
        behind = np.einsum("ni,ni->n", self._outwards[face], normals) > 0
        lift = np.where((face >= 0) & behind & (distance < self._reach), distance, 0)
        return (unit + (self.offset + lift)[:, None] * geometric_normals).astype(np.float32)
