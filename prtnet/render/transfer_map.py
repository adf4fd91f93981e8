"""Transfer textures on the graphics card: one for each page of the atlas, in their format, with or without mip levels.

The level of detail is the hardware's, from derivatives of the texture coordinate, or follows the distance to the eye
(Dhawal, Aakash KT and Narayanan 2022, *PRTT*): log2 of the world size of a pixel at that distance over a texel's.
The first also sees how steeply a surface is looked at; the second does not, and costs no derivatives.
"""

from collections.abc import Sequence

import moderngl
import numpy as np
from jaxtyping import Float, Float32, Float64

from prtnet import PrtnetError, gl
from prtnet.data import quantise
from prtnet.data.atlas import Atlas
from prtnet.data.texture import Page
from prtnet.data.unwrap import uv_areas
from prtnet.render.camera import Camera

Array = np.ndarray

LEVELS_OF_DETAIL = ("derivative", "distance")
UNIT = 1


def check(level_of_detail: str) -> None:
    """Raises PrtnetError, naming the configuration's key, for a choice that there is not."""
    if level_of_detail not in LEVELS_OF_DETAIL:
        expected = ", ".join(LEVELS_OF_DETAIL)
        raise PrtnetError(f"atlas.level_of_detail: found {level_of_detail!r}, expected one of {expected}")


class TransferMap:
    """The pages of an atlas, uploaded, and how a fragment shader reads the one that is bound."""

    def __init__(self, atlas: Atlas, pages: Sequence[Page], texels: str, level_of_detail: str, *, first: int = 0):
        # first: the number of the first vector that is filled
        check(level_of_detail)
        self._first = first
        self.layers = gl.layer_count(pages[0].levels[0].shape[2])
        self._stored = [quantise.encode(page.levels, page.used, texels) for page in pages]
        self._textures: list[moderngl.TextureArray] = [gl.upload_layers(stored.levels) for stored in self._stored]
        self._decoded = texels == "uint8"
        self._by_distance = level_of_detail == "distance" and len(pages[0].levels) > 1
        self._texel_sizes = texel_sizes(atlas, [len(page.used) for page in pages])
        counts = [level.shape[0] * level.shape[1] for page in pages for level in page.levels]
        # bytes on the graphics card, padding included
        self.bytes = sum(counts) * 4 * self.layers * quantise.FORMATS[texels]

    @property
    def declarations(self) -> str:
        """GLSL before `statements`, after the text of surface.glsl."""
        text = "uniform sampler2DArray transfer_map;\nin vec2 atlas_uv;\n"
        if self._decoded:
            text += f"uniform vec4 transfer_scale[{self.layers}];\nuniform vec4 transfer_offset[{self.layers}];\n"
        return text + ("uniform float level_scale;\n" if self._by_distance else "")

    @property
    def statements(self) -> str:
        """GLSL that fills t0, t1, ..."""
        lines = ["float level = log2(max(distance(position, eye) * level_scale, 1.0))"] if self._by_distance else []
        for layer in range(self.layers):
            place = f"transfer_map, vec3(atlas_uv, {layer}.0)"
            found = f"textureLod({place}, level)" if self._by_distance else f"texture({place})"
            if self._decoded:
                found = f"{found} * transfer_scale[{layer}] + transfer_offset[{layer}]"
            lines.append(f"t{self._first + layer} = {found}")
        return "; ".join(lines)

    def fetched(self, layer: int | str, texel: str) -> str:
        """GLSL of a vector of the first level at a texel, an ivec2, unfiltered."""
        found = f"texelFetch(transfer_map, ivec3({texel}, {layer}), 0)"
        return f"({found} * transfer_scale[{layer}] + transfer_offset[{layer}])" if self._decoded else found

    def bind(self, program: moderngl.Program, page: int, camera: Camera, size: int) -> None:
        """Have a program read a page in a frame of `size`^2 pixels."""
        self._textures[page].use(UNIT)
        gl.put(program, transfer_map=UNIT)
        if self._decoded:
            stored = self._stored[page]
            gl.put(program, transfer_scale=self._padded(stored.scale), transfer_offset=self._padded(stored.offset))
        if self._by_distance:
            gl.put(program, level_scale=float(pixel_angle(camera, size) / self._texel_sizes[page]))

    def _padded(self, values: Float32[Array, " k"]) -> Float32[Array, " p"]:
        return np.pad(values, (0, 4 * self.layers - len(values)))


def pixel_angle(camera: Camera, size: int) -> float:
    """Of the middle pixel of a frame of `size`^2, radians: what it covers at a distance of 1."""
    return 2 * float(np.tan(np.radians(camera.fov_y) / 2)) / size


def texel_sizes(atlas: Atlas, sides: Sequence[int]) -> Float64[Array, " p"]:
    """Mean length of a texel of each page on the surface, in unit coordinates."""
    scene = atlas.scene.centred()
    number = atlas.page_of_face
    surface = np.bincount(number, scene.face_areas, len(sides))
    texels = np.bincount(number, uv_areas(atlas.uv[scene.faces].astype(np.float64)), len(sides)) * np.square(sides)
    return np.sqrt(surface / np.maximum(texels, 1e-12))


def levels_by_distance(
    away: Float[Array, " n"], camera: Camera, size: int, texel_size: float | np.floating
) -> Float[Array, " n"]:
    """The level of detail at distances from the eye: the plain twin of `TransferMap.statements`."""
    return np.log2(np.maximum(away * pixel_angle(camera, size) / texel_size, 1))


def padded_groups(values: Float[Array, "*n c"], groups: int) -> Float32[Array, "*n _"]:
    """Each group of channels padded with 0 to a multiple of four."""
    each = values.shape[-1] // groups
    split = np.asarray(values, np.float32).reshape(*values.shape[:-1], groups, each)
    room = [(0, 0)] * (split.ndim - 1) + [(0, -each % 4)]
    return np.pad(split, room).reshape(*values.shape[:-1], -1)
