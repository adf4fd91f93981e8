"""An implicit surface on screen: a pass that sphere-traces, and a colour pass, which the methods fill.

The first pass leaves point, unit normal and part of every pixel in float textures (march.frag.glsl). The second is one
triangle over the frame: its depth test lets through the pixels whose rays met the surface, so that the others cost
nothing, however dear the fragment shader. `Marched` stands where `render.raster.Raster` does: everything is in unit
coordinates, and images are linear RGB, float32, row 0 on top, 0 where nothing is drawn.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from jaxtyping import Bool, Float32

from prtnet import PrtnetError, gl
from prtnet.data.implicit import project
from prtnet.data.implicit.field import unit_gradient
from prtnet.data.implicit.surface import Implicit
from prtnet.data.scene import IDENTITY, Material, Scene
from prtnet.export import sphere_tracing
from prtnet.export.sphere_tracing import BOX, REFINEMENTS, STEPS
from prtnet.render import reflectance
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import GBuffer
from prtnet.render.raster import Raster
from prtnet.render.transfer_map import pixel_angle

Array = np.ndarray

# texture units of what the first pass leaves; 1 is the method's
PLACES, FACINGS = 0, 2
# how far a step may take a point of the first pass, which is as near as float32 allows but at outlines
FURTHEST = 0.01


@dataclass(frozen=True, eq=False)
class Covering:
    """The triangle bound to a program, and what each part reflects."""

    mesh: moderngl.VertexArray
    by_part: Mapping[str, Float32[Array, "p c"]]


class Marched:
    """An implicit surface on the graphics card and a frame to draw it into, square unless it is resized."""

    def __init__(self, implicit: Implicit, size: int, *, steps: int = STEPS):
        self.implicit, self.steps = implicit, steps
        self.scene = stand_in(implicit.name, implicit.materials)
        self._albedos = np.stack([material.albedo for material in implicit.materials]).astype(np.float32)
        self.resize(size, size)
        text = sphere_tracing.emit(implicit.field) + gl.shader("march.frag.glsl")
        self._march = gl.program(gl.shader("fullscreen.vert.glsl"), text)
        self._marching = gl.context().vertex_array(self._march, [])

    def resize(self, width: int, height: int) -> None:
        """A new frame of `width` x `height` pixels. `size` is the height, which a camera's angle spans."""
        self.target, self.size, self.aspect = gl.target(width, height, depth=True), height, width / height
        colours = [gl.context().texture((width, height), 4, dtype="f4") for _ in range(2)]
        self._met = gl.Target(gl.context().framebuffer(colours, self.target.framebuffer.depth_attachment))
        self._places, self._facings = colours

    def program(self, fragment: str, vertex: str = "", **defines: object) -> moderngl.Program:
        """A fragment shader of meshes for the colour pass. `vertex` is what their vertices hand on: here each fragment
        finds it by its part.

        Raises PrtnetError for what implicit surfaces do not have: a file's roughness, or a place in an atlas.
        """
        if "atlas_uv" in fragment:
            raise PrtnetError(
                "implicit surface: found a method that reads an atlas, which it does not have; expected a net without "
                "texels (train.texel_size=0)"
            )
        if "ROUGHNESS" in defines:
            raise PrtnetError("material.roughness: found file for an implicit surface, which has none, expected config")
        defines |= {"OWN": 1} if vertex else {}
        text = "#define main shade\n" + fragment + gl.shader("marched.frag.glsl")
        parts = len(self.implicit.materials)
        return gl.program(gl.shader("fullscreen.vert.glsl"), text, None, VARYING="", MARCHED=1, PARTS=parts, **defines)

    def draws(
        self,
        program: moderngl.Program,
        attributes: Mapping[str, Float32[Array, "p c"]] | None = None,
        faces: Bool[Array, " p"] | None = None,
    ) -> Covering:
        """The frame bound to a program. `attributes`, of the vertices of `scene`, are those of the parts.

        Raises PrtnetError for `faces`: there are none to draw apart.
        """
        if faces is not None:
            raise PrtnetError(
                "split.select: found a draw call for each cluster of an implicit surface, which has no triangles to "
                "share out, expected fragment"
            )
        return Covering(gl.context().vertex_array(program, []), {"in_factor": self._albedos, **(attributes or {})})

    def render(self, program: moderngl.Program, draws: Covering, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the frame. Without `prepass` missed pixels are not kept from the shader, which finds out by itself:
        the plain twin."""
        self.march(camera)
        # a mask holds from when its frame buffer is used
        self.target.framebuffer.depth_mask = False
        self.target.framebuffer.use()
        context = gl.context()
        context.enable_only(moderngl.DEPTH_TEST if prepass else moderngl.NOTHING)
        # the triangle stands half-way, what was met in front of it
        context.depth_func = ">"
        self._places.use(PLACES)
        self._facings.use(FACINGS)
        gl.put(program, eye=camera.eye, places=PLACES, facings=FACINGS, **draws.by_part)
        draws.mesh.render(moderngl.TRIANGLES, vertices=3)
        self.target.framebuffer.depth_mask = True

    def march(self, camera: Camera) -> None:
        """The first pass, and an empty frame."""
        self.target.clear()
        self._met.clear()
        gl.context().enable_only(moderngl.DEPTH_TEST)
        gl.context().depth_func = "<"
        gl.put(self._march, size=self.target.size, prt_steps=(self.steps, REFINEMENTS), **self._rays(camera))
        self._marching.render(moderngl.TRIANGLES, vertices=3)

    def _rays(self, camera: Camera) -> dict[str, object]:
        """The uniforms that say where rays begin and where they go."""
        pixel, (right, up, backward) = pixel_angle(camera, self.size), camera.basis()
        half, ahead = pixel * self.size / 2, max(0.0, float(backward @ camera.eye) - np.sqrt(3) * BOX)
        return {
            "prt_window": np.stack([half * self.aspect * right, half * up, -backward]),
            "prt_middle": np.array(camera.eye) - ahead * backward,
            "prt_ahead": ahead,
            "prt_pixel": pixel,
        }

    def surface(self, camera: Camera) -> tuple[Float32[Array, "h w 4"], Float32[Array, "h w 4"]]:
        """What the first pass leaves: (point, part + 1) and (unit normal, 0) of each pixel, 0 where nothing is met."""
        self.march(camera)
        return self._met.read(0), self._met.read(1)

    def gbuffer(self, camera: Camera) -> GBuffer:
        """Surface point, normal, albedo and part of every covered pixel: what the first pass found, taken to the
        surface in float64. Faces are those of `scene`."""
        places = self.surface(camera)[0].reshape(-1, 4)
        pixel, field = np.flatnonzero(places[:, 3] > 0), self.implicit.field
        positions = project.onto(field, places[pixel, :3].astype(np.float64), furthest=FURTHEST)
        part = places[pixel, 3].astype(np.int32) - 1
        normals = unit_gradient(field, positions).astype(np.float32)
        return GBuffer(
            positions=positions.astype(np.float32),
            normals=normals,
            geometric_normals=normals,
            albedo=self._albedos[part],
            face=part,
            pixel=pixel,
            size=self.size,
            eye=camera.eye,
            part=part,
            parts=reflectance.names_of(self.scene),
        )

    def albedo(self, camera: Camera) -> Float32[Array, "h w 3"]:
        """Linear RGB albedo of each pixel, as every method sees it."""
        part = self.surface(camera)[0][..., 3].astype(np.int64)
        return np.concatenate([np.zeros((1, 3), np.float32), self._albedos])[part]

    def roughness(self, camera: Camera) -> None:
        """Nothing: implicit surfaces have none of a file."""


def stand_in(name: str, materials: Sequence[Material]) -> Scene:
    """Triangles of no extent, one for each part: what is said of vertices and faces of meshes is said of parts here."""
    count = len(materials)
    faces = np.repeat(np.arange(count, dtype=np.int32)[:, None], 3, axis=1)
    normals = np.tile(np.array([0, 1, 0], np.float32), (count, 1))
    return Scene(
        name,
        np.zeros((count, 3)),
        faces,
        normals,
        None,
        np.arange(count, dtype=np.int32),
        np.zeros(count, bool),
        tuple(materials),
        IDENTITY,
    )


Drawing = Raster | Marched
