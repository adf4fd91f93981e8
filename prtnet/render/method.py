"""Methods on screen: a material on transfer that a fragment shader finds in a texture or computes by a net."""

import math
import re
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError, gl, sh
from prtnet.export import gloss
from prtnet.export.spelling import number, vector
from prtnet.render.camera import Camera
from prtnet.render.material import DIFFUSE, Material, fixed_light_matrix
from prtnet.render.raster import Raster

Array = np.ndarray


class Shaded:
    """A material on transfer that a program finds somewhere. Compiled once, or once per light; drawn often."""

    def __init__(
        self,
        raster: Raster,
        coefficients: range,
        source: str,
        transfer: str,
        material: Material,
        groups: int = 1,
    ):
        # coefficients: the counts that fill the layers of one group of `transfer`
        self.raster, self.coefficients, self.material, self.groups = raster, coefficients, material, groups
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
        names = [f"t{layer}" for layer in range(self.groups * self.layers)]
        defines: dict[str, Any] = {}
        if gloss_function:
            specular = vector("vec3", np.asarray(self.material.specular))
            defines["GLOSS"] = f"{specular} * prt_gloss(mirrored(), {', '.join(names[: self.layers])})"
        parts = gl.shader("surface.glsl"), self._source, gloss_function, gl.shader("albedo.glsl")
        self.program = self.raster.program(
            "".join(parts) + gl.shader("shading.frag.glsl"),
            LAYERS=self.layers,
            DECLARE="vec4 " + ", ".join(names),
            TRANSFER=self._transfer,
            SUM=irradiance_text(names, self.layers),
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
        self,
        raster: Raster,
        texture: Float[Array, "s s c"],
        *,
        half: bool = False,
        material: Material = DIFFUSE,
        groups: int = 1,
    ):
        channels = texture.shape[2] // groups
        padded = padded_groups(texture, groups)
        # the direct group is for gloss alone
        first = 0 if material.glossy or groups == 1 else gl.layer_count(channels)
        layers = range(first, padded.shape[2] // 4)
        fetch = "t{} = texture(transfer_map, vec3(atlas_uv, {}.0))"
        transfer = "; ".join(fetch.format(layer, layer - first) for layer in layers)
        declarations = "uniform sampler2DArray transfer_map;\nin vec2 atlas_uv;\n"
        super().__init__(raster, range(channels, channels + 1), declarations, transfer, material, groups)
        self.texture = gl.upload_layers(padded[..., 4 * first :], half=half)
        # bytes on the graphics card, padding included
        self.bytes = len(layers) * 4 * (2 if half else 4) * texture.shape[0] * texture.shape[1]

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""
        self.texture.use(1)
        gl.put(self.program, transfer_map=1)
        super().render(camera, prepass=prepass)


class NetMethod(Shaded):
    """Transfer from an exported GLSL function `prt_transfer(position, normal, out vec4 t0, ...)` at every pixel."""

    def __init__(self, raster: Raster, function: str, *, material: Material = DIFFUSE, groups: int = 1):
        signature = re.search(r"void\s+prt_transfer\s*\(([^)]*)\)", function)
        outputs = signature.group(1).count("out vec4") if signature else 0
        if not outputs:
            raise PrtnetError(
                "net shader: expected a function void prt_transfer(vec3, vec3, out vec4 t0, ...), found none"
            )
        arguments = ", ".join(f"t{layer}" for layer in range(outputs))
        transfer = f"prt_transfer(position, normalize(normal), {arguments})"
        most = 4 * outputs // groups
        super().__init__(raster, range(most - 3, most + 1), function + "\n", transfer, material, groups)


def irradiance_text(names: list[str], layers: int) -> str:
    """sum_i t_i L_i per colour as an expression: one group of `layers` vectors, or those that follow the first."""
    if len(names) == layers:
        return " + ".join(f"light[{layer}] * {name}" for layer, name in enumerate(names))
    sums = []
    for colour in range(3):
        group = names[(colour + 1) * layers : (colour + 2) * layers]
        sums.append(" + ".join(f"dot(transpose(light[{i}])[{colour}], {name})" for i, name in enumerate(group)))
    return f"vec3({', '.join(sums)})"


def padded_groups(values: Float[Array, "*n c"], groups: int) -> Float32[Array, "*n _"]:
    """Each group of channels padded with 0 to a multiple of four."""
    each = values.shape[-1] // groups
    split = np.asarray(values, np.float32).reshape(*values.shape[:-1], groups, each)
    room = [(0, 0)] * (split.ndim - 1) + [(0, -each % 4)]
    return np.pad(split, room).reshape(*values.shape[:-1], -1)
