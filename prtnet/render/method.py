"""Methods on screen: a material on transfer that a fragment shader finds in a texture or computes by a net."""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError, gl, sh
from prtnet.data.texture import Page, page_of
from prtnet.export import gloss
from prtnet.export.spelling import number, vector
from prtnet.render.camera import Camera
from prtnet.render.material import DIFFUSE, Material, fixed_light_matrix
from prtnet.render.raster import Group, Raster
from prtnet.render.transfer_map import TransferMap

Array = np.ndarray


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
        parts = (
            gl.shader("surface.glsl"),
            self._source,
            gloss_function,
            gl.shader("albedo.glsl"),
            gl.shader("shading_normal.glsl"),
        )
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
    """Transfer from textures over the atlas (Dhawal, Aakash KT and Narayanan 2022), bilinear or, with mip levels,
    trilinear."""

    def __init__(
        self,
        raster: Raster,
        texture: Float[Array, "s s k"] | Sequence[Page],
        *,
        texels: str = "float32",
        level_of_detail: str = "derivative",
        material: Material = DIFFUSE,
    ):
        # texture: an image, or the pages of the raster's atlas; texels: a format of data.quantise
        pages = [page_of(texture)] if isinstance(texture, Array) else texture
        channels = pages[0].levels[0].shape[2]
        self.map = TransferMap(raster.atlas, pages, texels, level_of_detail)
        self.bytes = self.map.bytes
        counts = range(channels, channels + 1)
        super().__init__(raster, counts, self.map.declarations, self.map.statements, material)

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""

        def before(group: Group) -> None:
            self.map.bind(self.program, group.page, camera, self.raster.size)

        self.raster.render(self.program, self.draws, camera, prepass=prepass, before=before)


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
        transfer = f"prt_transfer(position, shading_normal(), {arguments})"
        super().__init__(raster, range(4 * outputs - 3, 4 * outputs + 1), function + "\n", transfer, material)
