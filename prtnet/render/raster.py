"""The mesh on screen: a depth pre-pass, a colour pass, and the methods that keep transfer in a texture or in a net.

The pre-pass leaves the nearest depth of every pixel, and the colour pass draws only fragments of that very depth:
what is hidden costs nothing, however dear the fragment shader. Everything is drawn in unit coordinates, one-sided,
and images are linear RGB, float32, row 0 on top, 0 where nothing is drawn.
"""

import math
import re
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from jaxtyping import Float, Float32, Int

from prtnet import PrtnetError, gl, sh
from prtnet.data.atlas import Atlas
from prtnet.data.scene import Scene
from prtnet.export import gloss
from prtnet.export.spelling import number, vector
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import GBuffer, from_faces
from prtnet.render.material import DIFFUSE, Material, fixed_light_matrix

Array = np.ndarray
WHITE = np.ones((1, 1, 3), np.float32)


@dataclass(frozen=True, eq=False)
class Group:
    """Faces that share an albedo texture: one draw call."""

    albedo: moderngl.Texture
    indices: moderngl.Buffer


class Raster:
    """A scene on the graphics card and a square frame to draw it into."""

    def __init__(self, atlas: Atlas, size: int):
        self.atlas, self.size = atlas, size
        self.scene = atlas.scene.centred()
        self.target = gl.target(size, size, depth=True)
        self._attributes = _attributes(self.scene, atlas)
        # faces in the order they are drawn
        self.order, self._groups = _groups(self.scene)
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
    ) -> None:
        """Draw into the frame. Without `prepass` all fragments that are nearest so far are shaded: the plain twin."""
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
        for albedo, mesh in draws:
            albedo.use(0)
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


class Shaded:
    """A material on transfer that a program finds somewhere. Compiled once, or once per light; drawn often."""

    def __init__(self, raster: Raster, coefficients: range, source: str, transfer: str, material: Material):
        # coefficients: the counts that fill the layers of `transfer`
        self.raster, self.coefficients, self.material = raster, coefficients, material
        self.layers = gl.layer_count(coefficients[-1])
        self._source, self._transfer = source, transfer
        self._per_light = material.glossy and material.product == "fixed_light"
        self._light: Array | None = None
        if not self._per_light:
            self._compile(gloss.full(self._lobe()) if material.glossy else "")

    def _lobe(self) -> Float[Array, " bands"]:
        """s_l for as many bands as the coefficients have."""
        squares = [count for count in self.coefficients if math.isqrt(count) ** 2 == count]
        if not squares:
            found = f"{self.coefficients[0]} to {self.coefficients[-1]}"
            raise PrtnetError(f"gloss: found {found} coefficients of transfer, expected a square number (1, 4, 9, ...)")
        return sh.phong_lobe(self.material.exponent, sh.bands_of(squares[-1]))

    def _compile(self, gloss_function: str) -> None:
        names = [f"t{layer}" for layer in range(self.layers)]
        defines: dict[str, Any] = {}
        if gloss_function:
            specular = vector("vec3", np.asarray(self.material.specular))
            defines["GLOSS"] = f"{specular} * prt_gloss(mirrored(), {', '.join(names)})"
        parts = gl.shader("surface.glsl"), self._source, gloss_function, gl.shader("albedo.glsl")
        self.program = self.raster.program(
            "".join(parts) + gl.shader("shading.frag.glsl"),
            LAYERS=self.layers,
            DECLARE="vec4 " + ", ".join(names),
            TRANSFER=self._transfer,
            SUM=" + ".join(f"light[{layer}] * {name}" for layer, name in enumerate(names)),
            DIFFUSE=number(self.material.diffuse / math.pi),
            **defines,
        )
        self.draws = self.raster.draws(self.program)

    def draw(self, camera: Camera, light: Float[Array, "k 3"]) -> Float32[Array, "h w 3"]:
        """The image under a light's SH coefficients."""
        self.set_light(light)
        self.render(camera)
        return self.raster.target.read()[..., :3]

    def milliseconds(self, camera: Camera, light: Float[Array, "k 3"], repeats: int = 5) -> float:
        """Time of one frame, both passes, without reading it back: median after warm-up."""
        self.set_light(light)
        return gl.milliseconds(lambda: self.render(camera), repeats)

    def set_light(self, light: Float[Array, "k 3"]) -> None:
        """Upload a light, or compile it into the shader of a fixed-light product where it is not the last one again.

        Raises PrtnetError where its bands are not those of the transfer.
        """
        if len(light) not in self.coefficients:
            raise PrtnetError(f"light: found {len(light)} SH coefficients, expected {self.coefficients[-1]}")
        padded = np.zeros((4 * self.layers, 3), np.float32)
        padded[: len(light)] = light
        if self._per_light and (self._light is None or not np.array_equal(self._light, padded)):
            lobe = self._lobe()
            square = padded[: sh.count(len(lobe))]
            self._compile(gloss.fixed_light(fixed_light_matrix(square, len(lobe)), lobe))
            self._light = padded
        gl.put(self.program, light=padded)

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""
        self.raster.render(self.program, self.draws, camera, prepass=prepass)


class TextureMethod(Shaded):
    """Transfer from a texture over the atlas (Dhawal, Aakash KT and Narayanan 2022), bilinear."""

    def __init__(
        self, raster: Raster, texture: Float[Array, "s s k"], *, half: bool = False, material: Material = DIFFUSE
    ):
        channels = texture.shape[2]
        layers = range(gl.layer_count(channels))
        transfer = "; ".join(f"t{layer} = texture(transfer_map, vec3(atlas_uv, {layer}.0))" for layer in layers)
        declarations = "uniform sampler2DArray transfer_map;\nin vec2 atlas_uv;\n"
        super().__init__(raster, range(channels, channels + 1), declarations, transfer, material)
        self.texture = gl.upload_layers(texture, half=half)
        # bytes on the graphics card, padding included
        self.bytes = len(layers) * 4 * (2 if half else 4) * texture.shape[0] * texture.shape[1]

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""
        self.texture.use(1)
        gl.put(self.program, transfer_map=1)
        super().render(camera, prepass=prepass)


class NetMethod(Shaded):
    """Transfer from an exported GLSL function `prt_transfer(position, normal, out vec4 t0, ...)` at every pixel."""

    def __init__(self, raster: Raster, function: str, *, material: Material = DIFFUSE):
        signature = re.search(r"void\s+prt_transfer\s*\(([^)]*)\)", function)
        outputs = signature.group(1).count("out vec4") if signature else 0
        if not outputs:
            raise PrtnetError(
                "net shader: expected a function void prt_transfer(vec3, vec3, out vec4 t0, ...), found none"
            )
        arguments = ", ".join(f"t{layer}" for layer in range(outputs))
        transfer = f"prt_transfer(position, normalize(normal), {arguments})"
        super().__init__(raster, range(4 * outputs - 3, 4 * outputs + 1), function + "\n", transfer, material)


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


def _groups(scene: Scene) -> tuple[Int[Array, " f"], list[Group]]:
    """Face order by albedo texture, and one group for each; parts without a texture share a white one."""
    textures = {id(m.texture): m.texture for m in scene.materials if m.texture is not None}
    images = [WHITE, *textures.values()]
    number = {key: i + 1 for i, key in enumerate(textures)}
    kind = np.array([0 if m.texture is None else number[id(m.texture)] for m in scene.materials])[scene.part]
    order = np.argsort(kind, kind="stable")
    groups = []
    for value in np.unique(kind):
        faces = np.ascontiguousarray(scene.faces[order[kind[order] == value]], np.int32)
        groups.append(Group(_mipmapped(images[value]), gl.context().buffer(faces.tobytes())))
    return order, groups


def _mipmapped(image: Float[Array, "h w 3"]) -> moderngl.Texture:
    made = gl.upload(image, half=True)
    made.build_mipmaps()
    made.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
    made.repeat_x = made.repeat_y = True
    return made
