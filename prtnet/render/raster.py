"""The mesh on screen: a depth pre-pass and a colour pass, which the methods (`render.method`) fill.

The pre-pass leaves the nearest depth of every pixel, and the colour pass draws only fragments of that very depth:
what is hidden costs nothing, however dear the fragment shader. Everything is drawn in unit coordinates, one-sided,
and images are linear RGB, float32, row 0 on top, 0 where nothing is drawn.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import moderngl
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from prtnet import gl
from prtnet.data import roughness
from prtnet.data.atlas import Atlas
from prtnet.data.scene import Scene
from prtnet.render import reflectance
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import GBuffer, from_faces

Array = np.ndarray
WHITE = np.ones((1, 1, 3), np.float32)
SMOOTH = np.array([[[0, 0, 1]]], np.float32)
# of the texture units, 0 is the albedo's and 1 the method's
NORMAL_UNIT = 2


@dataclass(frozen=True, eq=False)
class Group:
    """Faces that share their textures and a page of the atlas: one draw call."""

    albedo: moderngl.Texture
    roughness: moderngl.Texture
    faces: Int[Array, " n"]  # of atlas.scene, in the order they are drawn
    indices: moderngl.Buffer
    page: int
    # None where no part of the scene has one
    normal_map: moderngl.Texture | None = None

    def use(self) -> None:
        self.albedo.use(0)
        self.roughness.use(reflectance.UNIT)
        if self.normal_map:
            self.normal_map.use(NORMAL_UNIT)


@dataclass(frozen=True, eq=False)
class Portion:
    """What one of several programs draws that make a picture together, each over those before it."""

    faces: Bool[Array, " f"] | None = None  # of atlas.scene; None: all
    # (the weight of its colour at a fragment, the sum of the weights of all programs so far) as GLSL, and the functions
    # that takes; a fragment of weight 0 is left out before its transfer is found. Empty: what it draws is its own
    share: str = ""
    text: str = ""


EVERYTHING = Portion()


class Raster:
    """A scene on the graphics card and a frame to draw it into, square unless it is resized."""

    def __init__(self, atlas: Atlas, size: int):
        self.atlas, self.scene = atlas, atlas.scene.centred()
        self.resize(size, size)
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

    def resize(self, width: int, height: int) -> None:
        """A new frame of `width` x `height` pixels. `size` is the height, which a camera's angle spans."""
        self.target, self.size, self.aspect = gl.target(width, height, depth=True), height, width / height

    def program(self, fragment: str, vertex: str = "", **defines: object) -> moderngl.Program:
        """A fragment shader for the colour pass, joined to the vertex shader that all passes share, which may run a
        function of the text `vertex` as AT_VERTEX."""
        if self.scene.tangents is not None:
            defines["NORMAL_MAP"] = 1
        return gl.program(vertex + gl.shader("mesh.vert.glsl"), fragment, None, VARYING="in", **defines)

    def draws(
        self,
        program: moderngl.Program,
        attributes: Mapping[str, Float32[Array, "v c"]] | None = None,
        faces: Bool[Array, " f"] | None = None,
    ) -> list[tuple[Group, moderngl.VertexArray]]:
        """The mesh, or some of its faces, bound to a program: the textures and a vertex array per group. `attributes`
        join the mesh's own."""
        own = [(_buffer(values), f"{values.shape[1]}f", name) for name, values in (attributes or {}).items()]
        content = [entry for entry in [*self._attributes, *own] if entry[2] in program]
        groups = self._groups if faces is None else [_some(self.scene, group, faces) for group in self._groups]
        return [
            (group, gl.context().vertex_array(program, content, group.indices)) for group in groups if len(group.faces)
        ]

    def render(
        self,
        program: moderngl.Program,
        draws: list[tuple[Group, moderngl.VertexArray]],
        camera: Camera,
        *,
        prepass: bool = True,
        before: Callable[[Group], None] | None = None,
        target: gl.Target | None = None,
        over: bool = False,
    ) -> None:
        """Draw into the frame, or another target of its size, calling `before` ahead of each group. Without `prepass`
        all fragments that are nearest so far are shaded: the plain twin. `over`: after another program, with the same
        camera and its pre-pass, over what that has drawn (Porter and Duff 1984, colours times alpha)."""
        target = target or self.target
        context, framebuffer = gl.context(), target.framebuffer
        matrix = camera.matrix(self.aspect).T
        if over:
            context.enable(moderngl.BLEND)
            context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        else:
            self._begin(target)
        if prepass and not over:
            gl.put(self._depth, camera=matrix)
            everything = framebuffer.color_mask
            nothing: Any = (False, False, False, False)
            framebuffer.color_mask = nothing if target.layers == 1 else (nothing,) * target.layers
            # moderngl applies the masks of a frame buffer when it is used
            framebuffer.use()
            for _, mesh in self._depth_draws:
                mesh.render()
            framebuffer.color_mask = everything
        if prepass or over:
            framebuffer.depth_mask = False
            context.depth_func = "=="
        framebuffer.use()
        gl.put(program, camera=matrix, albedo_map=0, roughness_map=reflectance.UNIT, normal_map=NORMAL_UNIT)
        gl.put(program, eye=camera.eye)
        for group, mesh in draws:
            group.use()
            if before:
                before(group)
            mesh.render()
        framebuffer.depth_mask = True
        context.disable(moderngl.BLEND)

    def _begin(self, target: gl.Target) -> None:
        target.clear()
        gl.context().enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        # of coincident faces the one drawn last wins, with and without a pre-pass
        gl.context().depth_func = "<="

    def faces(self, camera: Camera) -> Float32[Array, "h w 4"]:
        """(face + 1, b1, b2, 1): the face of atlas.scene that each pixel shows, and where on it; 0 where none."""
        self._begin(self.target)
        gl.put(self._ids, camera=camera.matrix(self.aspect).T)
        self._ids_draw.render(moderngl.TRIANGLES)
        image = self.target.read()
        shown = image[..., 0] > 0
        image[shown, 0] = self.order[image[shown, 0].astype(np.int64) - 1] + 1
        return image

    def gbuffer(self, camera: Camera) -> GBuffer:
        """Surface point, normals, albedo and texture coordinate of every covered pixel."""
        faces, albedo = self.faces(camera), self.albedo(camera)
        return from_faces(self.scene, faces, albedo, camera.eye, self.roughness(camera), self.atlas.uv)

    def albedo(self, camera: Camera) -> Float32[Array, "h w 3"]:
        """Linear RGB albedo of each pixel, as every method sees it."""
        self.render(self._albedo, self._albedo_draws, camera)
        return self.target.read()[..., :3]

    def roughness(self, camera: Camera) -> Float32[Array, "h w"] | None:
        """Roughness of each pixel, as every method sees it, below 0 where the file says nothing; None where nowhere."""
        if not roughness.known(self.scene):
            return None
        texts = "albedo.glsl", "reflectance.frag.glsl", "roughness.frag.glsl"
        program = self.program(
            "".join(gl.shader(name) for name in texts),
            gl.shader("reflectance.vert.glsl"),
            AT_VERTEX="hand_on_reflectance()",
            ROUGHNESS=1,
        )
        self.render(program, self.draws(program), camera)
        return self.target.read()[..., 0]


def _attributes(scene: Scene, atlas: Atlas) -> list[tuple[moderngl.Buffer, str, str]]:
    factor = np.empty((len(scene.vertices), 3), np.float32)
    factor[scene.faces.ravel()] = np.repeat(np.stack([m.albedo for m in scene.materials])[scene.part], 3, axis=0)
    albedo_uv = np.zeros((len(scene.vertices), 2)) if scene.uv is None else scene.uv
    tangents = [] if scene.tangents is None else [(_buffer(scene.tangents), "4f", "in_tangent")]
    return tangents + [
        (_buffer(scene.vertices), "3f", "in_position"),
        (_buffer(scene.normals), "3f", "in_normal"),
        (_buffer(atlas.uv), "2f", "in_atlas_uv"),
        (_buffer(albedo_uv), "2f", "in_albedo_uv"),
        (_buffer(factor), "3f", "in_factor"),
        (_buffer(roughness.at_vertices(scene)), "1f", "in_roughness"),
    ]


def _buffer(values: Float[Array, "*n"]) -> moderngl.Buffer:
    return gl.context().buffer(np.ascontiguousarray(values, np.float32).tobytes())


def _groups(scene: Scene, page: Int[Array, " f"]) -> tuple[Int[Array, " f"], list[Group]]:
    """Face order by textures and page, and one group for each; parts that have no texture share a white one, and no
    normal map is a smooth one."""
    albedos, of_albedo = _distinct([material.texture for material in scene.materials], WHITE, _mipmapped)
    maps, of_map = _distinct([material.normal_map for material in scene.materials], SMOOTH, _bilinear)
    roughs, of_rough = _distinct([material.roughness_map for material in scene.materials], WHITE[..., 0], _mipmapped)
    kinds = np.stack([of_albedo[scene.part], of_rough[scene.part], of_map[scene.part], page], axis=1)
    order = np.lexsort(kinds.T[::-1])
    groups = []
    for kind in np.unique(kinds, axis=0):
        chosen = order[(kinds[order] == kind).all(axis=1)]
        normal_map = None if scene.tangents is None else maps[kind[2]]()
        indices = _indices(scene, chosen)
        groups.append(Group(albedos[kind[0]](), roughs[kind[1]](), chosen, indices, int(kind[3]), normal_map))
    return order, groups


def _some(scene: Scene, group: Group, faces: Bool[Array, " f"]) -> Group:
    chosen = group.faces[faces[group.faces]]
    return replace(group, faces=chosen, indices=_indices(scene, chosen) if len(chosen) else group.indices)


def _indices(scene: Scene, chosen: Int[Array, " n"]) -> moderngl.Buffer:
    return gl.context().buffer(np.ascontiguousarray(scene.faces[chosen], np.int32).tobytes())


def _distinct(
    images: Sequence[Array | None], none: Array, upload: Callable[[Array], moderngl.Texture]
) -> tuple[list[Callable[[], moderngl.Texture]], Int[Array, " m"]]:
    """(makers of the different textures, `none` first, each uploaded once and only when asked for; number of each)."""
    different = {id(image): image for image in images if image is not None}
    number = {key: place for place, key in enumerate(different, 1)}
    makers = [cache(partial(upload, image)) for image in (none, *different.values())]
    return makers, np.array([0 if image is None else number[id(image)] for image in images])


def _mipmapped(image: Float[Array, "h w"] | Float[Array, "h w 3"]) -> moderngl.Texture:
    image = image if image.ndim == 3 else image[..., None]
    made = gl.upload(image, half=True)
    made.build_mipmaps()
    made.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    made.repeat_x = made.repeat_y = True
    return made


def _bilinear(image: Float[Array, "h w 3"]) -> moderngl.Texture:
    made = gl.upload(image)
    made.filter = (moderngl.LINEAR, moderngl.LINEAR)
    made.repeat_x = made.repeat_y = True
    return made
