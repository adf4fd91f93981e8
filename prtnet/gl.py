"""OpenGL without a window: one headless context, float targets, full-screen passes, read-back, timing.

NumPy images have row 0 on top everywhere in prtnet, OpenGL keeps row 0 at the bottom. The flip happens in this file
and nowhere else: `upload`, `upload_layers` and `read` take and return top-down arrays, so v = 1 of a texture
coordinate is the top row of its image.
"""

import ctypes
import logging
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import moderngl
import numpy as np
from jaxtyping import Float, Num

from prtnet import PrtnetError

log = logging.getLogger(__name__)
SHADERS = Path(__file__).parent / "render" / "shaders"
EGL: dict[str, Any] = {"backend": "egl", "libgl": "libGL.so.1", "libegl": "libEGL.so.1"}
# of an array's texels by their NumPy type: moderngl's name, OpenGL's number
TEXELS = {"float32": "f4", "float16": "f2", "uint8": "f1"}
GL_TYPES = {"float32": 0x1406, "float16": 0x140B, "uint8": 0x1401}
GL_TEXTURE_2D_ARRAY, GL_RGBA = 0x8C1A, 0x1908
_cache = threading.local()


def context() -> moderngl.Context:
    """The headless EGL context of this process and thread, made at the first call.

    A context belongs to the thread that made it, and does not survive a fork: either gets its own.
    Raises PrtnetError when EGL or an OpenGL 3.3 driver is missing.
    """
    if getattr(_cache, "process", None) != os.getpid():
        _cache.context, _cache.process = _create(), os.getpid()
    _cache.context.gc()
    return _cache.context


def _create() -> moderngl.Context:
    try:
        made = moderngl.create_context(require=330, standalone=True, **EGL)
    except Exception as error:  # glcontext raises bare Exception
        raise PrtnetError(
            f"OpenGL: no headless EGL context of version 3.3 could be made ({error}); "
            "a driver and its libraries are expected: apt-get install libegl1 libgl1"
        ) from error
    # released by context() in the thread that owns the context, never by whichever thread collects garbage
    made.gc_mode = "context_gc"
    log.info("OpenGL: %s", made.info["GL_RENDERER"])
    return made


@contextmanager
def adopted(opened: Callable[[], moderngl.Context]) -> Iterator[None]:
    """A block in which everything is drawn with a window's context, which `opened` makes.

    A thread has one current context: the headless one is left before the window opens, and after the block another is
    made where one is needed. What was uploaded to either stays behind in it.
    """
    if getattr(_cache, "process", None) == os.getpid():
        _cache.context.__exit__(None, None, None)
    _cache.process = None
    try:
        _cache.context = opened()
        _cache.context.gc_mode, _cache.process = "context_gc", os.getpid()
        yield
    finally:
        _cache.process = None


def shader(name: str) -> str:
    """The text of a file in render/shaders, without its version line (`program` writes that)."""
    return (SHADERS / name).read_text()


def program(vertex: str, fragment: str, geometry: str | None = None, **defines: object) -> moderngl.Program:
    """Compile shader texts as GLSL 330, each with `#define NAME value` lines on top.

    Raises PrtnetError with the compiler's own message, for the text may come from a file.
    """
    head = "#version 330 core\n" + "".join(f"#define {name} {value}\n" for name, value in defines.items())
    try:
        return context().program(
            vertex_shader=head + vertex,
            fragment_shader=head + fragment,
            geometry_shader=None if geometry is None else head + geometry,
        )
    except moderngl.Error as error:
        raise PrtnetError(f"GLSL: the shader does not compile: {error}") from error


def put(program: moderngl.Program, **uniforms: object) -> None:
    """Set uniforms by name: arrays as float32 bytes, the rest as values. What the compiler dropped is passed over."""
    for name, value in uniforms.items():
        uniform = program.get(name, None)
        if not isinstance(uniform, moderngl.Uniform):
            continue
        if isinstance(value, np.ndarray):
            uniform.write(np.ascontiguousarray(value, np.float32).tobytes())
        else:
            uniform.value = value


@dataclass(frozen=True)
class Target:
    """A float32 RGBA frame buffer of some layers, with or without depth."""

    framebuffer: moderngl.Framebuffer

    @property
    def layers(self) -> int:
        return len(self.framebuffer.color_attachments)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height: a window's frame buffer is as large as what is drawn of it."""
        return self.framebuffer.viewport[2], self.framebuffer.viewport[3]

    def clear(self) -> None:
        self.framebuffer.use()
        self.framebuffer.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)

    def read(self, layer: int = 0) -> Float[np.ndarray, "h w 4"]:
        """Inverse of drawing: the pixels, row 0 on top."""
        width, height = self.size
        data = self.framebuffer.read((width, height), components=4, attachment=layer, dtype="f4")
        return np.frombuffer(data, np.float32).reshape(height, width, 4)[::-1].copy()

    def write(self, image: Float[np.ndarray, "h w 4"]) -> None:
        """Inverse of `read`, of the first layer."""
        texture = self.framebuffer.color_attachments[0]
        assert isinstance(texture, moderngl.Texture)
        texture.write(_bytes(image, np.float32))


def target(width: int, height: int, layers: int = 1, *, depth: bool = False) -> Target:
    """A new `Target`. Depth is 32 bit floating point. Raises PrtnetError above the driver's largest size."""
    limit = context().info["GL_MAX_TEXTURE_SIZE"]
    if not 1 <= min(width, height) <= max(width, height) <= limit:
        raise PrtnetError(
            f"image size: found {width} x {height}, expected 1 to {limit} (this driver's largest texture)"
        )
    colours = [context().texture((width, height), 4, dtype="f4") for _ in range(layers)]
    depth_texture = context().depth_texture((width, height)) if depth else None
    return Target(context().framebuffer(colours, depth_texture))


def screen(width: int, height: int) -> Target:
    """The frame buffer of the window whose context is adopted, which has that size now."""
    framebuffer = context().screen
    framebuffer.viewport = (0, 0, width, height)
    return Target(framebuffer)


def fullscreen(program: moderngl.Program, target: Target) -> None:
    """Run a program of `fullscreen.vert.glsl` and some fragment shader once per pixel."""
    context().disable(moderngl.DEPTH_TEST | moderngl.CULL_FACE | moderngl.BLEND)
    target.framebuffer.use()
    context().vertex_array(program, []).render(moderngl.TRIANGLES, vertices=3)


def upload(image: Float[np.ndarray, "h w c"], *, half: bool = False) -> moderngl.Texture:
    """A nearest-neighbour texture of 1 to 4 channels; texel (row, column) of `image` keeps its place, row 0 on top."""
    height, width, channels = image.shape
    kind = np.float16 if half else np.float32
    made = context().texture((width, height), channels, _bytes(image, kind), dtype="f2" if half else "f4", alignment=1)
    made.filter = (moderngl.NEAREST, moderngl.NEAREST)
    made.repeat_x = made.repeat_y = False
    return made


def upload_volume(volume: Float[np.ndarray, "d h w 4"]) -> moderngl.Texture3D:
    """An unfiltered RGBA 3D texture; texel (x, y, z) is volume[z, y, x], float32 or float16."""
    depth, height, width, _ = volume.shape
    kind = TEXELS[volume.dtype.name]
    made = context().texture3d((width, height, depth), 4, np.ascontiguousarray(volume), dtype=kind)
    made.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return made


def upload_table(table: Float[np.ndarray, "h w 4"]) -> moderngl.Texture:
    """An unfiltered RGBA texture; texel (x, y) is table[y, x], float32 or float16."""
    height, width, _ = table.shape
    made = context().texture((width, height), 4, np.ascontiguousarray(table), dtype=TEXELS[table.dtype.name])
    made.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return made


def upload_indices(image: Num[np.ndarray, "h w"], texel_bytes: int) -> moderngl.Texture:
    """An unfiltered texture of whole numbers of 1 or 2 bytes, for a usampler2D; row 0 on top."""
    height, width = image.shape
    data = _bytes(image, np.uint8 if texel_bytes == 1 else np.uint16)
    made = context().texture((width, height), 1, data, dtype=f"u{texel_bytes}", alignment=1)
    made.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return made


def upload_layers(levels: Sequence[Num[np.ndarray, "_ _ k"]]) -> moderngl.TextureArray:
    """An array of ceil(k/4) RGBA layers, the last one padded with 0, clamped at the border; texels as the images have
    them: float32, float16, or uint8, which reads as 0 to 1. One level is bilinear, a chain of halved sides trilinear.
    """
    height, width, channels = levels[0].shape
    layers = layer_count(channels)
    made = context().texture_array((width, height, layers), 4, _layers(levels[0]), dtype=TEXELS[levels[0].dtype.name])
    made.filter = (moderngl.LINEAR, moderngl.LINEAR)
    if len(levels) > 1:
        made.build_mipmaps(0, len(levels) - 1)
        made.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
        for level, image in enumerate(levels[1:], 1):
            _put_level(made, level, image)
    made.repeat_x = made.repeat_y = False
    return made


def _layers(image: Num[np.ndarray, "h w k"]) -> bytes:
    height, width, channels = image.shape
    padded = np.zeros((layer_count(channels), height, width, 4), image.dtype)
    for channel in range(channels):
        padded[channel // 4, :, :, channel % 4] = image[::-1, :, channel]
    return padded.tobytes()


def _put_level(array: moderngl.TextureArray, level: int, image: Num[np.ndarray, "h w k"]) -> None:
    """moderngl writes no level but the first of an array: glTexSubImage3D through the library it has loaded."""
    height, width, channels = image.shape
    found = [max(1, side >> level) for side in (array.width, array.height)]
    assert found == [width, height], f"level {level}: {width} x {height} texels, expected {found}"
    library, kind = ctypes.CDLL(EGL["libgl"]), GL_TYPES[image.dtype.name]
    array.use(0)
    library.glTexSubImage3D(
        GL_TEXTURE_2D_ARRAY, level, 0, 0, 0, width, height, layer_count(channels), GL_RGBA, kind, _layers(image)
    )


def largest_texture() -> tuple[int, int, int]:
    """The driver's limits: texels along a side, layers of an array, mat4x3 uniforms of a fragment shader."""
    limits = context().info
    # each of the four columns may take the room of a vec4
    matrices = limits["GL_MAX_FRAGMENT_UNIFORM_COMPONENTS"] // 16
    return limits["GL_MAX_TEXTURE_SIZE"], limits["GL_MAX_ARRAY_TEXTURE_LAYERS"], matrices


def layer_count(channels: int) -> int:
    """RGBA layers that hold this many channels."""
    return -(-channels // 4)


def _bytes(image: np.ndarray, kind: type) -> bytes:
    return np.ascontiguousarray(image[::-1], kind).tobytes()


def milliseconds(draw: Callable[[], object], repeats: int = 5) -> float:
    """Median wall time of `draw` after one warm-up. GL_TIME_ELAPSED lies on llvmpipe, so: finish and a clock."""
    draw()
    context().finish()
    taken = []
    for _ in range(repeats):
        start = time.perf_counter()
        draw()
        context().finish()
        taken.append(1000 * (time.perf_counter() - start))
    return median(taken)
