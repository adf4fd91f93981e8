"""Vertex PRT on screen: colour from transfer and light at each vertex, interpolated over the triangles.

Sloan, Kautz and Snyder 2002. A vertex finds its transfer by gl_VertexID with texelFetch in an RGBA32F texture:
vertex attributes end at 16 vec4, and OpenGL promises buffer textures of 65 536 texels only, a texture 1024^2 and
drivers far more.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Float32

from prtnet import PrtnetError, gl
from prtnet.data import vertex
from prtnet.data.atlas import Atlas
from prtnet.data.scene import Scene
from prtnet.export.spelling import number
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import barycentric, from_faces, shade
from prtnet.render.material import DIFFUSE
from prtnet.render.method import Shaded, padded_groups
from prtnet.render.raster import Raster

Array = np.ndarray


class VertexMethod(Shaded):
    """Transfer at the vertices of a drawn mesh (`data.vertex.mesh`), which may be finer than what others draw.

    Diffuse only: a lobe is narrower than a triangle.
    """

    def __init__(self, drawn: Scene, transfer: Float[Array, "v c"], size: int, *, groups: int = 1):
        count, channels = len(transfer), transfer.shape[1] // groups
        self.layers, self.groups = gl.layer_count(channels), groups
        self.material, self._per_light, self._light = DIFFUSE, False, None
        self.raster = Raster(Atlas(drawn, np.zeros((count, 2), np.float32), "none", float("nan")), size)
        self.coefficients = range(channels, channels + 1)
        image = pack(transfer, gl.context().info["GL_MAX_TEXTURE_SIZE"], groups)
        self.program = self.raster.program(
            "in vec3 lit;\n" + gl.shader("albedo.glsl") + gl.shader("shading.frag.glsl"),
            gl.shader("vertex_light.glsl"),
            AT_VERTEX="lit = light_of_vertex()",
            LAYERS=self.layers,
            GROUPS=groups,
            PER_ROW=image.shape[1] // (groups * self.layers),
            DECLARE="",
            TRANSFER="",
            SUM="lit",
            DIFFUSE=number(1 / math.pi),
        )
        self.draws = self.raster.draws(self.program)
        self.texture = gl.upload(image)

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
    raster: Raster, camera: Camera, transfer: Float[Array, "v c"], light: Float[Array, "k 3"], *, groups: int = 1
) -> Float32[Array, "h w 3"]:
    """The plain twin of VertexMethod: transfer interpolated at each pixel of the mesh that `raster` draws."""
    faces = raster.faces(camera)
    _, face, weights = barycentric(faces)
    gbuffer = from_faces(raster.scene, faces, raster.albedo(camera), camera.eye)
    return shade(gbuffer, vertex.interpolate(transfer, raster.scene, face, weights), light, groups=groups)
