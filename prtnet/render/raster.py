"""The mesh on screen: a depth pre-pass and a colour pass, which the methods (`render.method`) fill.

The pre-pass leaves the nearest depth of every pixel, and the colour pass draws only fragments of that very depth:
what is hidden costs nothing, however dear the fragment shader. Everything is drawn in unit coordinates, one-sided,
and images are linear RGB, float32, row 0 on top, 0 where nothing is drawn.
"""

from collections.abc import Callable
from dataclasses import dataclass

import moderngl
import numpy as np
from jaxtyping import Float, Float32, Int

from prtnet import gl
from prtnet.data.atlas import Atlas
from prtnet.data.scene import Scene
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import GBuffer, from_faces

Array = np.ndarray
WHITE = np.ones((1, 1, 3), np.float32)


@dataclass(frozen=True, eq=False)
class Group:
    """Faces that share an albedo texture and a page of the atlas: one draw call."""

    albedo: moderngl.Texture
    indices: moderngl.Buffer
    page: int


class Raster:
    """A scene on the graphics card and a square frame to draw it into."""

    def __init__(self, atlas: Atlas, size: int):
        self.atlas, self.size = atlas, size
        self.scene = atlas.scene.centred()
        self.target = gl.target(size, size, depth=True)
        self._attributes = _attributes(self.scene, atlas)
        # faces in the order they are drawn
        self.order, self._groups = _groups(self.scene, atlas.page_of_face)
        corners = self.scene.vertices[self.scene.faces[self.order]]
        self._corners = _buffer(corners)
        self._depth = self.program(gl.shader("depth.frag.glsl"))
        self._depth_draws = self.draws(self._depth)
        self._ids = gl.program(gl.shader("ids.vert.glsl"), gl.shader("ids.frag.glsl"))
        self._ids_draw = gl.context().vertex_array(self._ids, [(self._corners, "3f", "in_position")])
        self._albedo = self.program(gl.shader("albedo.glsl") + gl.shader("albedo.frag.glsl"))
        self._albedo_draws = self.draws(self._albedo)

    def program(self, fragment: str, vertex: str = "", **defines: object) -> moderngl.Program:
        """A fragment shader for the colour pass, joined to the vertex shader that all passes share, which may run a
        function of the text `vertex` as AT_VERTEX."""
        return gl.program(vertex + gl.shader("mesh.vert.glsl"), fragment, None, **defines)

    def draws(self, program: moderngl.Program) -> list[tuple[moderngl.Texture, moderngl.VertexArray]]:
        """The mesh bound to a program: an albedo texture and a vertex array per group."""
        content = [entry for entry in self._attributes if entry[2] in program]
        return [(group.albedo, gl.context().vertex_array(program, content, group.indices)) for group in self._groups]

    def render(
        self,
        program: moderngl.Program,
        draws: list[tuple[moderngl.Texture, moderngl.VertexArray]],
        camera: Camera,
        *,
        prepass: bool = True,
        before: Callable[[Group], None] | None = None,
    ) -> None:
        """Draw into the frame, calling `before` ahead of each group. Without `prepass` all fragments that are nearest
        so far are shaded: the plain twin."""
        context, framebuffer = gl.context(), self.target.framebuffer
        matrix = camera.matrix().T
        self._begin()
        if prepass:
            gl.put(self._depth, camera=matrix)
            framebuffer.color_mask = False, False, False, False
            for _, mesh in self._depth_draws:
                mesh.render()
            framebuffer.color_mask = True, True, True, True
            framebuffer.depth_mask = False
            context.depth_func = "=="
        gl.put(program, camera=matrix, albedo_map=0, eye=camera.eye)
        for group, (albedo, mesh) in zip(self._groups, draws, strict=True):
            albedo.use(0)
            if before:
                before(group)
            mesh.render()
        framebuffer.depth_mask = True

    def _begin(self) -> None:
        self.target.clear()
        gl.context().enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        # of coincident faces the one drawn last wins, with and without a pre-pass
        gl.context().depth_func = "<="

    def faces(self, camera: Camera) -> Float32[Array, "h w 4"]:
        """(face + 1, b1, b2, 1): the face of atlas.scene that each pixel shows, and where on it; 0 where none."""
        self._begin()
        gl.put(self._ids, camera=camera.matrix().T)
        self._ids_draw.render(moderngl.TRIANGLES)
        image = self.target.read()
        shown = image[..., 0] > 0
        image[shown, 0] = self.order[image[shown, 0].astype(np.int64) - 1] + 1
        return image

    def gbuffer(self, camera: Camera) -> GBuffer:
        """Surface point, normals and albedo of every covered pixel."""
        return from_faces(self.scene, self.faces(camera), self.albedo(camera), camera.eye)

    def albedo(self, camera: Camera) -> Float32[Array, "h w 3"]:
        """Linear RGB albedo of each pixel, as every method sees it."""
        self.render(self._albedo, self._albedo_draws, camera)
        return self.target.read()[..., :3]


def _attributes(scene: Scene, atlas: Atlas) -> list[tuple[moderngl.Buffer, str, str]]:
    factor = np.empty((len(scene.vertices), 3), np.float32)
    factor[scene.faces.ravel()] = np.repeat(np.stack([m.albedo for m in scene.materials])[scene.part], 3, axis=0)
    albedo_uv = np.zeros((len(scene.vertices), 2)) if scene.uv is None else scene.uv
    return [
        (_buffer(scene.vertices), "3f", "in_position"),
        (_buffer(scene.normals), "3f", "in_normal"),
        (_buffer(atlas.uv), "2f", "in_atlas_uv"),
        (_buffer(albedo_uv), "2f", "in_albedo_uv"),
        (_buffer(factor), "3f", "in_factor"),
    ]


def _buffer(values: Float[Array, "*n"]) -> moderngl.Buffer:
    return gl.context().buffer(np.ascontiguousarray(values, np.float32).tobytes())


def _groups(scene: Scene, page: Int[Array, " f"]) -> tuple[Int[Array, " f"], list[Group]]:
    """Face order by albedo texture and page, and one group for each; parts without a texture share a white one."""
    textures = {id(m.texture): m.texture for m in scene.materials if m.texture is not None}
    images = [WHITE, *textures.values()]
    number = {key: i + 1 for i, key in enumerate(textures)}
    kind = np.array([0 if m.texture is None else number[id(m.texture)] for m in scene.materials])[scene.part]
    order = np.lexsort((page, kind))
    groups, albedo = [], {}
    for value, number in np.unique(np.stack([kind, page], axis=1), axis=0):
        chosen = order[(kind[order] == value) & (page[order] == number)]
        faces = np.ascontiguousarray(scene.faces[chosen], np.int32)
        if value not in albedo:
            albedo[value] = _mipmapped(images[value])
        groups.append(Group(albedo[value], gl.context().buffer(faces.tobytes()), int(number)))
    return order, groups


def _mipmapped(image: Float[Array, "h w 3"]) -> moderngl.Texture:
    made = gl.upload(image, half=True)
    made.build_mipmaps()
    made.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    made.repeat_x = made.repeat_y = True
    return made
