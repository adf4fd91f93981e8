"""Interreflection textures: transfer, and beside it the light from other surfaces under one fixed light.

Dhawal, Aakash KT and Narayanan 2022, *PRTT*. That light, J (`data.transfer.incident`), is a function of direction:
gloss mirrors it, which responses to any light (four groups of coefficients) cannot. Another light is another bake.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from prtnet import gl, sh
from prtnet.data.texture import Page
from prtnet.export import gloss
from prtnet.export.spelling import number
from prtnet.render.material import DIFFUSE, Material
from prtnet.render.method import TextureMethod
from prtnet.render.raster import Raster
from prtnet.render.transfer_map import padded_groups

IRRADIANCE = math.sqrt(4 * math.pi)  # times J_0


class LitTextureMethod(TextureMethod):
    """Four groups of coefficients in the pages: transfer, and J in red, green and blue.

    The light that is drawn must be the one that J was baked under. A diffuse material keeps of J only J_0.
    """

    def __init__(
        self,
        raster: Raster,
        pages: Sequence[Page],
        *,
        texels: str = "float32",
        level_of_detail: str = "derivative",
        material: Material = DIFFUSE,
    ):
        count = pages[0].levels[0].shape[2] // 4
        self._each = gl.layer_count(count)
        kept = list(range(16 * self._each))
        if not material.glossy:
            # J_0 of the three colours side by side behind the transfer
            kept = kept[: 4 * self._each] + [4 * self._each * (1 + colour) for colour in range(3)]
        chosen = [replace(page, levels=tuple(padded_groups(v, 4)[..., kept] for v in page.levels)) for page in pages]
        super().__init__(
            raster, chosen, texels=texels, level_of_detail=level_of_detail, material=material, coefficients=count
        )

    def _vectors(self) -> list[str]:
        return [f"t{layer}" for layer in range(self.map.layers)]

    def _groups(self, names: list[str]) -> list[list[str]]:
        return [names[first : first + self._each] for first in range(0, len(names), self._each)]

    def _received(self, names: list[str]) -> str:
        direct, *others = self._groups(names)
        zeroth = (
            f"vec3({', '.join(f'{group[0]}.x' for group in others)})" if len(others) == 3 else f"{others[0][0]}.rgb"
        )
        return f"{super()._received(direct)} + {number(IRRADIANCE)} * {zeroth}"

    def _seen(self, names: list[str]) -> str:
        direct, *others = self._groups(names)
        exponent = [] if self.material.one_exponent else ["exponent()"]
        arguments = ["mirrored()", *exponent, *(name for group in others for name in group)]
        return f"{super()._seen(direct)} + prt_incident({', '.join(arguments)})"

    def _compile(self, gloss_function: str) -> None:
        if gloss_function:
            gloss_function += gloss.incident(self._lobe(), sh.bands_of(self.coefficients[-1]))
        super()._compile(gloss_function)
