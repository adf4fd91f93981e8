"""Data-driven transfer on screen."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float64

from prtnet import PrtnetError, data_driven
from prtnet.data.texture import Page
from prtnet.data_driven import DataDriven, Measurement
from prtnet.render.camera import Camera
from prtnet.render.indirect import Indirect
from prtnet.render.material import DIFFUSE, Material
from prtnet.render.method import Shaded
from prtnet.render.raster import Group, Raster
from prtnet.render.transfer_map import TransferMap

Array = np.ndarray


def distant(measurement: Measurement, light: Float[Array, "k 3"]) -> Float64[Array, "m 3"]:
    """The direct vector of light from far away. Raises PrtnetError where the points do not know as much transfer."""
    known = measurement.transfer.shape[1]
    if known < len(light):
        raise PrtnetError(
            f"data-driven: found {known} coefficients of transfer at measurement points for a light of {len(light)},"
            " expected as many; learn from a data_driven.scenario with environment, with the bands of the light"
        )
    return np.einsum("mkc,kc->mc", measurement.transfer[:, : len(light)], light, dtype=np.float64)


class DataDrivenTexture(Shaded):
    """Light from far away alone: direct transfer from textures over the atlas, what bounces from the operator.

    `pages`: of the direct group alone. Gloss takes the direct transfer, as other methods with light between surfaces.
    """

    raster: Raster

    def __init__(
        self,
        raster: Raster,
        pages: Sequence[Page],
        spec: DataDriven,
        *,
        texels: str = "float16",
        level_of_detail: str = "derivative",
        material: Material = DIFFUSE,
        basis_texels: str = "float16",
    ):
        check(raster, spec)
        self.map = TransferMap(raster.atlas, pages, texels, level_of_detail)
        self.operator = Indirect(spec, texels=basis_texels)
        self.bytes = self.map.bytes + self.operator.bytes
        channels = pages[0].levels[0].shape[2]
        source = self.map.declarations + self.operator.text
        super().__init__(raster, range(channels, channels + 1), source, self.map.statements, material)

    def _received(self, names: list[str]) -> str:
        return f"{super()._received(names)} + prt_indirect(atlas_uv)"

    def set_light(self, light: Float[Array, "k 3"]) -> None:
        """Upload a light and the coefficients of what bounces of it."""
        super().set_light(light)
        spec = self.operator.spec
        self.operator.set(data_driven.coefficients(spec, distant(spec.measurements[0], light)))

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""

        def before(group: Group) -> None:
            self.map.bind(self.program, group.page, camera, self.raster.size)

        self.operator.bind(self.program)
        self.raster.render(self.program, self.draws, camera, prepass=prepass, before=before)


def check(raster: Raster, spec: DataDriven) -> None:
    """Raises PrtnetError where the atlas has several textures, or what the basis adds up to is no irradiance."""
    if raster.atlas.sides is not None:
        raise PrtnetError(
            "atlas.sets: found parts, expected one: the basis of data-driven transfer is one texture for the scene"
        )
