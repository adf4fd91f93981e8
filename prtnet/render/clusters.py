"""A scene of several nets on screen (`prtnet.clusters`): each cluster's faces drawn with its own net.

After one depth pre-pass every cluster has a program and a draw call. At a border, triangles that reach into both are
drawn by both: each fragment has its weights and leaves before the net runs where its own is 0 (`clip`); or a triangle
belongs to the cluster of its centroid and nothing is blended (`assign`), so that borders run along edges of the mesh.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Float64

from prtnet import clusters
from prtnet.clusters import ClusterSpec, Split
from prtnet.data.scene import Scene
from prtnet.export import clusters as spelt
from prtnet.export.bundle import Bundle
from prtnet.export.clusters import Stack
from prtnet.models.cluster_inference import ClusterInference
from prtnet.render.camera import Camera
from prtnet.render.deferred import DeferredMethod
from prtnet.render.gbuffer import GBuffer
from prtnet.render.material import DIFFUSE, Material
from prtnet.render.method import NetMethod, Shaded
from prtnet.render.raster import Portion, Raster

Array = np.ndarray

MARGIN = 1e-5  # in unit lengths: float32 on the way to a fragment


class ClusterMethod(Shaded):
    """A program and a draw call for each cluster. `made`: the shaders of each net."""

    def __init__(
        self,
        raster: Raster,
        spec: ClusterSpec,
        made: Sequence[Bundle],
        *,
        material: Material = DIFFUSE,
        border: str = "clip",
    ):
        faces = faces_of(spec, raster.scene, border)
        self.raster, self.material, self.groups = raster, material, spec.nets[0].groups
        self.triangles = int(faces.sum())  # of all draw calls
        blended = border == "clip" and not spec.split.parts and len(spec.nets) > 1
        self.parts = [
            NetMethod(
                raster,
                each.transfer,
                material=material,
                groups=self.groups,
                grids=each.net.grids,
                hashes=each.net.hashes,
                weights=each.weights,
                folding=(each.net, each.irradiance) if each.irradiance else None,
                place=f"{spelt.POSITION}({index}, position)",
                portion=_portion(spec, index, faces[index], blended=blended),
            )
            for index, each in enumerate(made)
        ]
        first = self.parts[0]
        self.coefficients, self.layers = first.coefficients, first.layers
        self.light_counts, self.light_layers = first.light_counts, first.light_layers

    def set_material(self, material: Material) -> None:
        """Other weights and exponents in the same programs."""
        self.material = material
        for part in self.parts:
            part.set_material(material)

    def set_light(self, light: Float[Array, "k 3"]) -> None:
        """Upload a light to all programs. Raises PrtnetError where its bands are not those of the transfer."""
        for part in self.parts:
            part.set_light(light)

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back. There is a pre-pass in any case: what is blended must
        be the nearest."""
        for number, part in enumerate(self.parts):
            part.bind()
            self.raster.render(part.program, part.draws, camera, over=number > 0)


def _portion(spec: ClusterSpec, index: int, faces: Bool[Array, " f"], *, blended: bool) -> Portion:
    text = spelt.functions(spec)
    if not blended:
        return Portion(faces, "", text)
    return Portion(faces, "prt_cluster_share(position)", text + spelt.share(spec, index))


def stack_method(raster: Raster, spec: ClusterSpec, stack: Stack, *, material: Material = DIFFUSE) -> NetMethod:
    """All nets in one program and one draw call, chosen at each fragment."""
    return NetMethod(
        raster,
        stack.text,
        material=material,
        groups=spec.nets[0].groups,
        grids=stack.grids,
        hashes=stack.hashes,
        weights=stack.weights,
    )


class DeferredClusters(DeferredMethod):
    """All nets in torch, each at the covered pixels where its weight is above 0."""

    def __init__(
        self,
        raster: Raster,
        spec: ClusterSpec,
        *,
        material: Material = DIFFUSE,
        border: str = "clip",
        select: str = "draw",
    ):
        super().__init__(raster, spec.nets[0], material=material)
        self._blend, self._words = ClusterInference(spec), (border, select)

    def _transfer(self, gbuffer: GBuffer) -> Float[Array, "n c"]:
        share = shares(self._blend.spec, self.raster.scene, gbuffer, *self._words)
        return self._blend(share, gbuffer.positions, gbuffer.normals)


def shares(
    spec: ClusterSpec, scene: Scene, gbuffer: GBuffer, border: str, select: str = "draw"
) -> Float64[Array, "n c"]:
    """The weights of the clusters at the covered pixels of a view. Without blending there is one, that of the triangle,
    or, where one program has all nets, the greatest."""
    if border == "assign" and select == "draw":
        return faces_of(spec, scene, border)[:, gbuffer.face].T.astype(np.float64)
    found = clusters.weights(spec, gbuffer.positions, gbuffer.part)
    return found if border == "clip" else np.eye(len(spec.nets))[found.argmax(axis=1)]


def faces_of(spec: ClusterSpec, scene: Scene, border: str) -> Bool[Array, "c f"]:
    """The faces of each cluster's draw call, in unit coordinates: those that its region, grown by delta, touches, or
    those whose centroid it has."""
    assert border in clusters.BORDERS
    corners = scene.vertices[scene.faces].astype(np.float64)
    if spec.split.parts or border == "assign":
        owner = clusters.blend(spec.split, spec.cluster, 0.0, corners.mean(axis=1), scene.part)
        return np.argmax(owner, axis=1) == np.arange(len(spec.nets))[:, None]
    low, high = corners.min(axis=1), corners.max(axis=1)
    touched = np.zeros((len(spec.nets), len(corners)), bool)
    for box, cluster in zip(leaf_boxes(spec.split), spec.cluster, strict=True):
        reach = spec.delta + MARGIN
        touched[cluster] |= ((low <= box[1] + reach) & (high >= box[0] - reach)).all(axis=1)
    return touched


def leaf_boxes(split: Split) -> Float[Array, "leaves 2 3"]:
    """The lowest and highest corner of each leaf's region, in unit coordinates; infinite at the outside."""
    boxes, arriving = np.empty((split.leaves, 2, 3)), {0: np.array([[-np.inf] * 3, [np.inf] * 3])}
    if not split.planes:
        boxes[:] = arriving[0]
    for index, plane in enumerate(split.planes):
        for child, side in ((plane.below, 1), (plane.above, 0)):
            box = arriving[index].copy()
            box[side, plane.axis] = plane.at
            if child < 0:
                boxes[-1 - child] = box
            else:
                arriving[child] = box
    return boxes
