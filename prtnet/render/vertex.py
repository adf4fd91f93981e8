"""Vertex PRT on screen: colour from transfer and light at each vertex, interpolated over the triangles.

Sloan, Kautz and Snyder 2002. A vertex finds its transfer by gl_VertexID with texelFetch in an RGBA32F texture:
vertex attributes end at 16 vec4, and OpenGL promises buffer textures of 65 536 texels only, a texture 1024^2 and
drivers far more.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32

from prtnet import PrtnetError, gl
from prtnet.data import vertex
from prtnet.data.atlas import Atlas
from prtnet.data.scene import Scene
from prtnet.export.spelling import number, vector
from prtnet.render import reflectance
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import barycentric
from prtnet.render.material import DIFFUSE, Material, radiance, shine
from prtnet.render.method import Shaded
from prtnet.render.raster import Raster
from prtnet.render.transfer_map import padded_groups

Array = np.ndarray

# in mesh.vert.glsl: the direction to the eye, mirrored at the vertex's normal
MIRRORED = "reflect(normalize(in_position - eye), normalize(in_normal))"


class VertexMethod(Shaded):
    """Transfer at the vertices of a drawn mesh (`data.vertex.mesh`), which may be finer than what others draw.

    Gloss is found at the vertices, too, for the eye as each of them sees it: a highlight smaller than a triangle is
    lost between its corners, or smeared over it.
    """

    def __init__(
        self, drawn: Scene, transfer: Float[Array, "v c"], size: int, *, material: Material = DIFFUSE, groups: int = 1
    ):
        count, channels = len(transfer), transfer.shape[1] // groups
        self.layers, self.material, self.groups = gl.layer_count(channels), material, groups
        self.raster = Raster(Atlas(drawn, np.zeros((count, 2), np.float32), "none", float("nan")), size)
        self.coefficients = range(channels, channels + 1)
        image = pack(transfer, gl.context().info["GL_MAX_TEXTURE_SIZE"], groups)
        self.texture, self._per_row = gl.upload(image), image.shape[1] // (groups * self.layers)
        self._attributes = self._reflected()
        self._prepare()

    def _reflected(self) -> dict[str, Float32[Array, "v c"]]:
        own = reflectance.at_vertices(self.material, self.raster.scene)
        return reflectance.as_attributes(own) if own else {}

    def _compile(self, gloss_function: str) -> None:
        own = bool(self._attributes)
        defines: dict[str, Any] = {}
        texts, statements = [self._fetching()], ["lit = light_of_vertex()"]
        if own:
            texts.append(gl.shader("vertex_own.glsl"))
            statements.append("lit *= in_reflectance.a")
        if gloss_function:
            texts += [gl.shader("vertex_gloss.glsl"), gloss_function]
            specular = "in_reflectance.rgb" if own else vector("vec3", np.asarray(self.material.specular))
            fetched = [f"transfer_of_vertex({layer})" for layer in range(self.layers)]
            call = self._gloss_call(MIRRORED, "in_exponent", fetched)
            statements.append(f"shine = {specular} * {call}")
            defines["GLOSS"] = "shine"
        varyings = "in vec3 lit;\n" + "in vec3 shine;\n" * bool(gloss_function)
        self.program = self.raster.program(
            varyings + gl.shader("albedo.glsl") + gl.shader("shading.frag.glsl"),
            "".join(texts),
            AT_VERTEX="; ".join(statements),
            LAYERS=self.layers,
            LIGHT_LAYERS=self.light_layers,
            GROUPS=self.groups,
            PER_ROW=self._per_row,
            DECLARE="",
            TRANSFER="",
            SUM="lit",
            DIFFUSE=number((1 if own else self.material.diffuse) / math.pi),
            **defines,
        )
        self.draws = self.raster.draws(self.program, self._attributes)

    def _fetching(self) -> str:
        """GLSL of light_of_vertex() and, for gloss, transfer_of_vertex(layer)."""
        return gl.shader("vertex_light.glsl")

    def covers(self, camera: Camera) -> Bool[Array, "h w"]:
        """The pixels that show the mesh."""
        return self.raster.faces(camera)[..., 0] > 0

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""
        self.texture.use(1)
        gl.put(self.program, vertex_transfer=1)
        super().render(camera, prepass=prepass)


def pack(transfer: Float[Array, "v c"], limit: int, groups: int = 1) -> Float32[Array, "h w 4"]:
    """The texture of vertex_light.glsl: ceil(k/4) texels for each group of each vertex, as many in a row as `limit`
    allows.

    Raises PrtnetError when it would have more than `limit` rows.
    """
    padded = padded_groups(transfer, groups)
    count, layers = len(padded), padded.shape[1] // 4
    per_row = min(limit // layers, count)
    rows = -(-count // per_row)
    if rows > limit:
        most = limit * per_row
        raise PrtnetError(f"vertex transfer: found {count} vertices, expected at most {most} (this driver's textures)")
    image = np.zeros((rows * per_row, 4 * layers), np.float32)
    image[:count] = padded
    return image.reshape(rows, per_row * layers, 4)


def shade_vertices(
    raster: Raster,
    camera: Camera,
    transfer: Float[Array, "v c"],
    light: Float[Array, "kj 3"],
    material: Material = DIFFUSE,
    *,
    groups: int = 1,
) -> Float32[Array, "h w 3"]:
    """The plain twin of VertexMethod: both parts of the colour found at the vertices of the mesh that `raster` draws,
    interpolated at each pixel, the diffuse one times its albedo."""
    scene, faces = raster.scene, raster.faces(camera)
    pixel, face, weights = barycentric(faces)
    own, white = reflectance.at_vertices(material, scene), np.ones((len(transfer), 3))
    towards = np.asarray(camera.eye) - scene.vertices
    unlit = replace(material, specular=(0.0, 0.0, 0.0), parts={})
    diffuse = radiance(unlit, white, transfer, light, scene.normals, towards, own, groups=groups)
    image = np.zeros((faces.shape[0] * faces.shape[1], 3), np.float32)
    image[pixel] = raster.albedo(camera).reshape(-1, 3)[pixel] * vertex.interpolate(diffuse, scene, face, weights)
    if material.glossy:
        shining = shine(material, transfer[:, : transfer.shape[1] // groups], light, scene.normals, towards, own)
        image[pixel] += vertex.interpolate(shining, scene, face, weights)
    return image.reshape(*faces.shape[:2], 3)
