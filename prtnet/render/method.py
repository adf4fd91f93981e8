"""Methods on screen: a material on transfer that a fragment shader finds in a texture or computes by a net."""

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError, gl, sh
from prtnet.data.texture import Page, page_of
from prtnet.encoding import HashGrid
from prtnet.export import fold, gloss, weight_texture
from prtnet.export.spelling import number, vector
from prtnet.netspec import NetSpec
from prtnet.render import features, reflectance
from prtnet.render.camera import Camera
from prtnet.render.marched import Drawing
from prtnet.render.material import DIFFUSE, Material, fixed_light_matrix
from prtnet.render.raster import EVERYTHING, Group, Portion, Raster
from prtnet.render.transfer_map import TransferMap, padded_groups

Array = np.ndarray

GRID_UNIT = 7  # texture units from here on are for the grids and texels of a net, at most nine


class Shaded:
    """A material on transfer that a program finds somewhere. Compiled once, or once per light; drawn often."""

    def __init__(
        self,
        raster: Drawing,
        coefficients: range,
        source: str,
        transfer: str,
        material: Material,
        groups: int = 1,
        portion: Portion = EVERYTHING,
    ):
        # coefficients: the counts that fill the layers of one group of `transfer`
        self._portion = portion
        self.raster, self.coefficients, self.material, self.groups = raster, coefficients, material, groups
        self.layers = gl.layer_count(coefficients[-1])
        self._source, self._transfer = source, transfer
        self._attributes = self._reflected()
        self._prepare()

    def _prepare(self) -> None:
        """Compile what waits for no light."""
        material = self.material
        self._light: Array | None = None
        self._per_light = material.glossy and material.product == "fixed_light"
        self._count_light()
        if not self._per_light:
            function = ""
            if material.glossy:
                bands_light, _ = material.orders(self._bands())
                function = gloss.full(self._lobe(), self._bands(), bands_light)
            self._compile(function)

    def _reflected(self) -> dict[str, Float32[Array, "v c"]]:
        """What points reflect, as vertex attributes."""
        return reflectance.attributes(self.material, self.raster.scene)

    def set_material(self, material: Material) -> None:
        """Other weights and exponents in the same program. This material and the last must differ between points."""
        assert material.varies
        assert self.material.varies
        self.material = material
        self._attributes = self._reflected()
        self.draws: Any = self.raster.draws(self.program, self._attributes, self._portion.faces)

    def _count_light(self) -> None:
        """The counts of coefficients that a light may have, and the layers that hold them."""
        self.light_counts, self.light_layers = self.coefficients, self.layers
        if self.material.light_bands:
            count = sh.count(self.material.light_bands)
            # where the light is the shorter one it is padded
            self.light_counts = range(count, count + 1)
            self.light_layers = max(self.layers, gl.layer_count(count))

    def _lobe(self) -> gloss.Lobe:
        """s_l for as many bands as the radiance has, or that number where exponents vary."""
        _, bands = self.material.orders(self._bands())
        return sh.phong_lobe(self.material.exponent, bands) if self.material.one_exponent else bands

    def _bands(self) -> int:
        """The bands of the transfer."""
        squares = [count for count in self.coefficients if math.isqrt(count) ** 2 == count]
        if not squares:
            found = f"{self.coefficients[0]} to {self.coefficients[-1]}"
            raise PrtnetError(f"gloss: found {found} coefficients of transfer, expected a square number (1, 4, 9, ...)")
        return sh.bands_of(squares[-1])

    def _gloss_call(self, mirrored: str, exponent: str, names: list[str]) -> str:
        arguments = [mirrored, *([] if self.material.one_exponent else [exponent]), *names]
        return f"prt_gloss({', '.join(arguments)})"

    def _compile(self, gloss_function: str) -> None:
        names, own = self._vectors(), bool(self._attributes)
        defines: dict[str, Any] = {"DIFFUSE": number(self.material.diffuse / math.pi)}
        if gloss_function:
            specular = "reflectance.rgb" if own else vector("vec3", np.asarray(self.material.specular))
            defines["GLOSS"] = f"{specular} * ({self._seen(names)})"
        if own:
            defines |= {"DIFFUSE": f"({number(1 / math.pi)} * reflectance.a)", "AT_VERTEX": "hand_on_reflectance()"}
            defines |= {"ROUGHNESS": 1} if self.material.roughness == "file" else {}
        texts = [gl.shader("surface.glsl"), self._source, gloss_function, gl.shader("albedo.glsl")]
        texts += [gl.shader("shading_normal.glsl"), *[gl.shader("reflectance.frag.glsl")] * own, self._portion.text]
        defines |= {"SHARE": self._portion.share} if self._portion.share else {}
        self.program = self.raster.program(
            "".join(texts) + gl.shader("shading.frag.glsl"),
            gl.shader("reflectance.vert.glsl") if own else "",
            LAYERS=self.light_layers,
            DECLARE="vec4 " + ", ".join(names),
            TRANSFER=self._transfer,
            SUM=self._received(names),
            **defines,
        )
        self.draws: Any = self.raster.draws(self.program, self._attributes, self._portion.faces)

    def _vectors(self) -> list[str]:
        """The vec4 that the source of transfer fills."""
        return [f"t{layer}" for layer in range(self.groups * self.layers)]

    def _received(self, names: list[str]) -> str:
        """Irradiance as an expression of the vectors."""
        starts = range(0, len(names), self.layers)
        return irradiance_text([self._summed(names[first : first + self.layers]) for first in starts])

    def _seen(self, names: list[str]) -> str:
        """What the lobe takes of all light, as an expression of the vectors."""
        return self._gloss_call("mirrored()", "exponent()", names[: self.layers])

    def _summed(self, group: list[str]) -> list[str]:
        """The vectors of a group that the diffuse sum takes. Where a light has more coefficients than the transfer,
        what fills up the last vector must not meet them."""
        if self.light_counts[-1] <= self.coefficients[-1]:
            return group
        room = sh.count(self._bands()) - 4 * (self.layers - 1)
        last = [f"{group[-1]}[{i}]" if i < room else "0.0" for i in range(4)]
        return [*group[:-1], f"vec4({', '.join(last)})"]

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
        self._check_light(light)
        padded = np.zeros((4 * self.light_layers, 3), np.float32)
        padded[: len(light)] = light
        if self._per_light and (self._light is None or not np.array_equal(self._light, padded)):
            bands = self._bands()
            bands_light, bands_out = self.material.orders(bands)
            square = padded[: sh.count(bands_light)]
            self._compile(gloss.fixed_light(fixed_light_matrix(square, bands, bands_out), self._lobe()))
            self._light = padded
        # compilers leave out the end of an array that nothing reads
        held = getattr(self.program.get("light", None), "array_length", 0)
        gl.put(self.program, light=padded[: 4 * held])

    def _check_light(self, light: Float[Array, "k 3"]) -> None:
        if len(light) not in self.light_counts:
            raise PrtnetError(f"light: found {len(light)} SH coefficients, expected {self.light_counts[-1]}")

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""
        self.raster.render(self.program, self.draws, camera, prepass=prepass)


class TextureMethod(Shaded):
    """Transfer from textures over the atlas (Dhawal, Aakash KT and Narayanan 2022), bilinear or, with mip levels,
    trilinear."""

    raster: Raster

    def __init__(
        self,
        raster: Raster,
        texture: Float[Array, "s s c"] | Sequence[Page],
        *,
        texels: str = "float32",
        level_of_detail: str = "derivative",
        material: Material = DIFFUSE,
        groups: int = 1,
        coefficients: int | None = None,
    ):
        # texture: an image, or the pages of the raster's atlas; texels: a format of data.quantise; coefficients: of
        # the first group, where there are channels that are no groups
        pages = [page_of(texture)] if isinstance(texture, Array) else texture
        channels = coefficients or pages[0].levels[0].shape[2] // groups
        # the direct group is for gloss alone
        first = 0 if material.glossy or groups == 1 else gl.layer_count(channels)
        if groups > 1:
            pages = [
                replace(page, levels=tuple(padded_groups(level, groups)[..., 4 * first :] for level in page.levels))
                for page in pages
            ]
        self.map = TransferMap(raster.atlas, pages, texels, level_of_detail, first=first)
        self.bytes = self.map.bytes
        counts = range(channels, channels + 1)
        super().__init__(raster, counts, self.map.declarations, self.map.statements, material, groups)

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""

        def before(group: Group) -> None:
            self.map.bind(self.program, group.page, camera, self.raster.size)

        self.raster.render(self.program, self.draws, camera, prepass=prepass, before=before)


class NetMethod(Shaded):
    """Transfer from an exported GLSL function `prt_transfer(position, normal, out vec4 t0, ...)` at every pixel.

    `grids`, `hashes` and `texels` are those of its net, `weights` the image of its weight texture, where it has them.
    One with texels takes `uv` after the normal. With `folding`, a diffuse material is drawn by the function text of
    `export.fold.irradiance` instead, and the net that belongs to it says what the light is folded into. `place` is
    what the function gets as its position.
    """

    def __init__(
        self,
        raster: Drawing,
        function: str,
        *,
        material: Material = DIFFUSE,
        groups: int = 1,
        grids: Sequence[Float[Array, "_ _ _ _"]] = (),
        hashes: Sequence[HashGrid] = (),
        texels: Sequence[Float[Array, "_ _ _"]] = (),
        weights: Float[Array, "h w 4"] | None = None,
        folding: tuple[NetSpec, str] | None = None,
        place: str = "position",
        portion: Portion = EVERYTHING,
    ):
        self._features = features.upload(grids, hashes, texels)
        if weights is not None:
            self._features[weight_texture.NAME] = gl.upload_table(weights)
        self._net, irradiance = (None, "") if folding is None or material.glossy else folding
        signature = re.search(r"void\s+prt_transfer\s*\(([^)]*)\)", function)
        outputs = signature.group(1).count("out vec4") if signature else 0
        if not outputs:
            raise PrtnetError(
                "net shader: expected a function void prt_transfer(vec3, vec3, out vec4 t0, ...), found none"
            )
        self._point = [place, "shading_normal()", *["atlas_uv"] * bool(texels)]
        transfer = f"prt_transfer({', '.join([*self._point, *(f't{layer}' for layer in range(outputs))])})"
        most = 4 * outputs // groups
        if irradiance:
            function, transfer = irradiance, ""
        source = ("in vec2 atlas_uv;\n" if texels else "") + function + "\n"
        super().__init__(raster, range(most - 3, most + 1), source, transfer, material, groups, portion)

    def _received(self, names: list[str]) -> str:
        """Irradiance as an expression of the vectors, or folded."""
        return super()._received(names) if self._net is None else f"prt_irradiance({', '.join(self._point)})"

    def set_light(self, light: Float[Array, "k 3"]) -> None:
        """Upload a light. Raises PrtnetError where its bands are not those of the transfer."""
        super().set_light(light)
        if self._net is not None:
            gl.put(self.program, **fold.uniforms(self._net, light))

    def bind(self) -> None:
        """Make its textures those of the program."""
        for unit, (name, texture) in enumerate(self._features.items(), GRID_UNIT):
            texture.use(unit)
            gl.put(self.program, **{name: unit})

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""
        self.bind()
        super().render(camera, prepass=prepass)


def irradiance_text(groups: list[list[str]]) -> str:
    """sum_i t_i L_i per colour as an expression of vectors: of one group, or of those that follow the first."""
    if len(groups) == 1:
        return " + ".join(f"light[{layer}] * {name}" for layer, name in enumerate(groups[0]))
    sums = []
    for colour, group in enumerate(groups[1:]):
        sums.append(" + ".join(f"dot(transpose(light[{layer}])[{colour}], {name})" for layer, name in enumerate(group)))
    return f"vec3({', '.join(sums)})"
