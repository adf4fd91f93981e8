"""What each pixel shows: surface point, normals, albedo; and shading from transfer known per pixel."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32

from prtnet.data import vertex
from prtnet.data.samples import at_barycentric
from prtnet.data.scene import Scene
from prtnet.render import reflectance
from prtnet.render.camera import Point
from prtnet.render.material import DIFFUSE, Material, radiance

Array = np.ndarray

# least barycentric weight of a pixel's point: a ray that starts in the very plane of the next face hits it at once
INSIDE = 1e-4


@dataclass(frozen=True, eq=False)
class GBuffer:
    """The covered pixels of one view, in the order of `pixel`."""

    # unit coordinates
    positions: Float32[Array, "n 3"]
    # unit shading normals
    normals: Float32[Array, "n 3"]
    # unit normals of the triangles, towards the camera
    geometric_normals: Float32[Array, "n 3"]
    # linear RGB, part factor times texture
    albedo: Float32[Array, "n 3"]
    # face of atlas.scene
    face: Int32[Array, " n"]
    # row * width + column, row 0 on top, ascending
    pixel: Int[Array, " n"]
    # rows of the frame, and its columns where it is square
    size: int
    # in unit coordinates
    eye: Point
    # index into `parts`, their names
    part: Int32[Array, " n"]
    parts: tuple[str, ...]
    # of the file; below 0 where it says nothing, None where it does so nowhere
    roughness: Float32[Array, " n"] | None = None
    # in the atlas, v up; None where the scene was drawn without one
    uv: Float32[Array, "n 2"] | None = None

    @property
    def covered(self) -> Bool[Array, "size size"]:
        """Which pixels show anything."""
        mask = np.zeros(self.size * self.size, bool)
        mask[self.pixel] = True
        return mask.reshape(self.size, -1)

    def image(self, colours: Float[Array, "n 3"]) -> Float32[Array, "size size 3"]:
        """The frame with a colour for each covered pixel; 0 elsewhere."""
        image = np.zeros((self.size * self.size, 3), np.float32)
        image[self.pixel] = colours
        return image.reshape(self.size, self.size, 3)


def from_faces(
    unit_scene: Scene,
    faces: Float32[Array, "h w 4"],
    albedo: Float32[Array, "h w 3"],
    eye: Point,
    roughness: Float32[Array, "h w"] | None = None,
    atlas_uv: Float32[Array, "v 2"] | None = None,
) -> GBuffer:
    """The G-buffer of an image of (face + 1, b1, b2, 1): the points follow in float64 and lie on their faces.

    `atlas_uv`: texture coordinates of the scene's vertices.
    """
    pixel, face, weights = barycentric(faces)
    points = at_barycentric(unit_scene, face, weights)
    return GBuffer(
        positions=points.positions.astype(np.float32),
        normals=points.normals,
        geometric_normals=points.geometric_normals,
        albedo=albedo.reshape(-1, 3)[pixel],
        face=points.face,
        pixel=pixel,
        size=len(faces),
        eye=eye,
        part=unit_scene.part[points.face],
        parts=reflectance.names_of(unit_scene),
        roughness=None if roughness is None else roughness.reshape(-1)[pixel],
        uv=None if atlas_uv is None else vertex.interpolate(atlas_uv, unit_scene, face, weights).astype(np.float32),
    )


def barycentric(faces: Float32[Array, "h w 4"]) -> tuple[Int[Array, " n"], Int[Array, " n"], Float[Array, "n 3"]]:
    """(pixel, face, barycentric weights) of the covered pixels of an image of (face + 1, b1, b2, 1)."""
    image = faces.reshape(-1, 4)
    pixel = np.flatnonzero(image[:, 0] > 0)
    face, weights = image[pixel, 0].astype(np.int64) - 1, np.empty((len(pixel), 3))
    # a pixel centre may lie a hair outside of its triangle
    weights[:, 1:] = np.clip(image[pixel, 1:3], 0, 1)
    weights[:, 0] = 1 - weights[:, 1] - weights[:, 2]
    weights = np.maximum(weights, INSIDE)
    return pixel, face, weights / weights.sum(axis=1, keepdims=True)


def shade(
    gbuffer: GBuffer,
    transfer: Float[Array, "n c"],
    light: Float[Array, "kj 3"],
    material: Material = DIFFUSE,
    *,
    groups: int = 1,
    incident: Float[Array, "n k 3"] | None = None,
) -> Float32[Array, "size size 3"]:
    """Radiance towards the eye at every covered pixel, linear RGB; 0 elsewhere. The plain twin of the GLSL methods.

    `groups` and `incident` as in `radiance`.
    """
    return gbuffer.image(colours(gbuffer, transfer, light, material, groups=groups, incident=incident))


def colours(
    gbuffer: GBuffer,
    transfer: Float[Array, "n c"],
    light: Float[Array, "kj 3"],
    material: Material = DIFFUSE,
    *,
    groups: int = 1,
    incident: Float[Array, "n k 3"] | None = None,
) -> Float[Array, "n 3"]:
    """`shade` of the covered pixels alone, in the order of `pixel`."""
    towards = np.asarray(gbuffer.eye) - gbuffer.positions.astype(np.float64)
    own = reflectance.of_points(material, gbuffer.parts, gbuffer.part, gbuffer.roughness)
    return radiance(
        material, gbuffer.albedo, transfer, light, gbuffer.normals, towards, own, groups=groups, incident=incident
    )
