"""Shadow maps: what each lamp sees of a scene, as depths in the layers of one array (`prtnet.export.lamps`)."""

import ctypes
from typing import Any

import moderngl
import numpy as np

from prtnet import PrtnetError, gl
from prtnet.data.lighting.lamp import Lamp, Lighting
from prtnet.data.scene import Scene
from prtnet.export import lamps

# texture unit of the maps, where the caller names no other
UNIT = 4
GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT = 0x8D40, 0x8D00
GL_DEPTH_COMPONENT32F, GL_DEPTH_COMPONENT, GL_FLOAT = 0x8CAC, 0x1902, 0x1406
GL_COMPARE_MODE, GL_COMPARE_FUNC, GL_COMPARE_REF_TO_TEXTURE, GL_LEQUAL = 0x884C, 0x884D, 0x884E, 0x0203


class ShadowMaps:
    """Everything in a scene casts shadows, both sides of every face, as rays see them. `size`: texels along a side."""

    def __init__(self, scene: Scene, size: int = 1024, *, room: int = lamps.LAMPS):
        # room: lamps that a shader knows at once
        context, unit_scene = gl.context(), scene.centred()
        limit = context.info["GL_MAX_TEXTURE_SIZE"]
        if not lamps.LEAST_SIZE <= size <= limit:
            raise PrtnetError(f"shadow maps: found a size of {size} texels, expected {lamps.LEAST_SIZE} to {limit}")
        self.size, self.room = size, room
        faces = unit_scene.faces
        if unit_scene.face_origin is not None:
            # backs of two-sided faces cast the shadows of their fronts
            faces = faces[: int(unit_scene.face_origin.max()) + 1]
        used = unit_scene.vertices[np.unique(faces)]
        self.box = np.stack([used.min(axis=0), used.max(axis=0)])
        self._program = gl.program(gl.shader("shadow.vert.glsl"), gl.shader("depth.frag.glsl"))
        corners = context.buffer(np.ascontiguousarray(unit_scene.vertices, np.float32).tobytes())
        index = context.buffer(np.ascontiguousarray(faces, np.int32).tobytes())
        self._mesh = context.vertex_array(self._program, [(corners, "3f", "in_position")], index)
        self._framebuffer = context.framebuffer(depth_attachment=context.depth_renderbuffer((size, size)))
        self._map, self._layers = _layers(size, lamps.FACES), lamps.FACES
        self._drawn: tuple[Any, ...] | None = None
        self._lighting: Lighting | None = None
        self.uniforms: dict[str, Any] = lamps.uniforms(Lighting(), [], room)

    def draw(self, lighting: Lighting, *, again: bool = False) -> None:
        """The maps of a lighting's lamps. Where they stand as they did, nothing is drawn but `again`.

        Raises PrtnetError for more lamps than there is room for.
        """
        if lighting is self._lighting and not again:
            return
        lamps.check(lighting, self.room)
        matrices = [lamps.shadow_matrices(lamp, self.box) for lamp in lighting.lamps]
        self.uniforms = lamps.uniforms(lighting, matrices, self.room)
        self._lighting, placed = lighting, tuple(_place(lamp) for lamp in lighting.lamps)
        if placed == self._drawn and not again:
            return
        needed = lamps.FACES * len(matrices)
        if needed > self._layers:
            self._map, self._layers = _layers(self.size, needed), needed
        for lamp, found in enumerate(matrices):
            for face, matrix in enumerate(found):
                self._draw(lamps.FACES * lamp + face, matrix)
        self._drawn = placed

    def _draw(self, layer: int, matrix: np.ndarray) -> None:
        context, library = gl.context(), ctypes.CDLL(gl.EGL["libgl"])
        # moderngl attaches no layers
        library.glBindFramebuffer(GL_FRAMEBUFFER, self._framebuffer.glo)
        library.glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, self._map.glo, 0, layer)
        self._framebuffer.use()
        self._framebuffer.clear(depth=1.0)
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = "<="
        context.polygon_offset = lamps.SLOPE_BIAS, lamps.DEPTH_BIAS
        gl.put(self._program, shadow=matrix.T)
        self._mesh.render()
        context.polygon_offset = 0.0, 0.0

    def bind(self, program: moderngl.Program, unit: int = UNIT) -> None:
        """Have a program with `export.lamps.functions` see the lamps and maps that were drawn last."""
        self._map.use(unit)
        # compilers leave out the end of an array that nothing reads
        held = {name: getattr(program.get(name, None), "array_length", 0) for name in self.uniforms}
        arrays = {name: v[: held[name]] for name, v in self.uniforms.items() if isinstance(v, np.ndarray)}
        gl.put(program, **(self.uniforms | arrays))
        found = program.get("shadow_map", None)
        if isinstance(found, moderngl.Uniform):
            # moderngl sets no uniforms of this kind of sampler
            library = ctypes.CDLL(gl.EGL["libgl"])
            library.glUseProgram(program.glo)
            library.glUniform1i(found.location, unit)


def _layers(size: int, count: int) -> moderngl.TextureArray:
    """A depth texture array, which moderngl has none of: an array of its own with another storage."""
    made = gl.context().texture_array((1, 1, 1), 1, dtype="f4")
    made.filter = (moderngl.LINEAR, moderngl.LINEAR)
    made.repeat_x = made.repeat_y = False
    made.use(0)
    library, kind = ctypes.CDLL(gl.EGL["libgl"]), gl.GL_TEXTURE_2D_ARRAY
    library.glTexImage3D(
        kind, 0, GL_DEPTH_COMPONENT32F, size, size, count, 0, GL_DEPTH_COMPONENT, GL_FLOAT, ctypes.c_void_p()
    )
    library.glTexParameteri(kind, GL_COMPARE_MODE, GL_COMPARE_REF_TO_TEXTURE)
    library.glTexParameteri(kind, GL_COMPARE_FUNC, GL_LEQUAL)
    return made


def _place(lamp: Lamp) -> tuple[Any, ...]:
    """What its shadows follow from."""
    return lamp.kind, lamp.position, lamp.aim, lamp.outer
