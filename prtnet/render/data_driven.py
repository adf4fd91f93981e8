"""Data-driven transfer on screen: what lamps light directly, by shadow maps, and what bounces of it, by the operator.

A lamp that moves costs its shadow maps, the direct light at the measurement points by the very same shader, and u =
M x. Each pixel then blends the basis textures. Nothing of that leaves the graphics card.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float32, Float64

from prtnet import PrtnetError, data_driven, gl
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.texture import Page
from prtnet.data_driven import DataDriven, Measurement
from prtnet.render.camera import Camera
from prtnet.render.indirect import Indirect
from prtnet.render.lamps import LampMethod
from prtnet.render.material import DIFFUSE, Material
from prtnet.render.measure import Measure
from prtnet.render.method import Shaded
from prtnet.render.raster import Group, Raster
from prtnet.render.shadow_maps import ShadowMaps
from prtnet.render.transfer_map import TransferMap

Array = np.ndarray

INDIRECT = "prt_indirect(atlas_uv)"


class DataDrivenMethod:
    """Lamps and light from far away. Basis textures of "irradiance" are shown as albedo / pi times it beside what is
    lit directly; those of "radiance" as they are, with nothing beside them.

    `raster` and `shadows` are of the scene in the pose of the keyframe that is drawn. `pages`: direct transfer, where
    there is light from far away.
    """

    def __init__(
        self,
        raster: Raster,
        spec: DataDriven,
        *,
        shadows: ShadowMaps | None = None,
        pages: Sequence[Page] | None = None,
        texels: str = "float16",
        page_texels: str = "float32",
        held: str = "block",
    ):
        # texels: of the basis textures; held: where shaders find u (`render.indirect`)
        check(raster)
        self.raster, self.spec = raster, spec
        self.shadows = shadows or ShadowMaps(raster.scene)
        self.operator = Indirect(spec, texels=texels, held=held)
        self._measures: dict[int, Measure] = {}
        self._alone = spec.quantity == "radiance"
        self.shading = LampMethod(
            raster,
            shadows=self.shadows,
            pages=None if self._alone else pages,
            texels=page_texels,
            source=self.operator.text,
            received="" if self._alone else INDIRECT,
            leaving=INDIRECT if self._alone else "",
            direct=not self._alone,
        )
        # bytes on the graphics card, but for the frame and shadow maps
        self.bytes = (
            self.operator.bytes + data_driven.point_bytes(spec) + (self.shading.map.bytes if self.shading.map else 0)
        )

    def draw(self, camera: Camera, lighting: Lighting, keyframe: int = 0) -> Float32[Array, "h w 3"]:
        """The image under a lighting."""
        self.set_lighting(lighting, keyframe)
        self.render(camera)
        return self.raster.target.read()[..., :3]

    def set_lighting(self, lighting: Lighting, keyframe: int = 0) -> None:
        """Draw the shadow maps of a lighting, measure its direct light and find u."""
        if not self._alone:
            self.shading.set_lighting(lighting)
        self._respond(lighting, keyframe)

    def _respond(self, lighting: Lighting, keyframe: int) -> None:
        measure = self.measure(keyframe)
        measure.draw(lighting)
        self.operator.reduce(measure.texture, keyframe)

    def measure(self, keyframe: int = 0) -> Measure:
        """The measurement points of a keyframe, uploaded."""
        if not 0 <= keyframe < len(self.spec.measurements):
            found = f"found keyframe {keyframe}, expected 0 to {len(self.spec.measurements) - 1}"
            raise PrtnetError(f"data-driven: {found}")
        if keyframe not in self._measures:
            self._measures[keyframe] = Measure(self.spec.measurements[keyframe], self.shadows)
        return self._measures[keyframe]

    def coefficients(self) -> Float32[Array, "n 3"]:
        """u of the last lighting, read back."""
        return self.operator.coefficients()

    def milliseconds(
        self, camera: Camera, lighting: Lighting, repeats: int = 5, *, moving: bool = False, keyframe: int = 0
    ) -> float:
        """Time of one frame without reading it back: median after warm-up. `moving`: with shadow maps, measurement and
        u."""
        self.set_lighting(lighting, keyframe)

        def frame() -> None:
            if moving:
                self.shadows.draw(lighting, again=True)
                self._respond(lighting, keyframe)
            self.render(camera)

        return gl.milliseconds(frame, repeats)

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""
        self.operator.bind(self.shading.program)
        self.shading.render(camera, prepass=prepass)


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

    `pages`: direct transfer, which is also what gloss takes.
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
        check(raster)
        if spec.quantity != "irradiance":
            raise PrtnetError(
                f"data-driven: found a basis of {spec.quantity}, expected one of irradiance beside a transfer texture"
            )
        channels = pages[0].levels[0].shape[2]
        self.map = TransferMap(raster.atlas, pages, texels, level_of_detail)
        self.operator = Indirect(spec, texels=basis_texels)
        self.bytes = self.map.bytes + self.operator.bytes
        source = self.map.declarations + self.operator.text
        super().__init__(raster, range(channels, channels + 1), source, self.map.statements, material)

    def _received(self, names: list[str]) -> str:
        return f"{super()._received(names)} + {INDIRECT}"

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


def check(raster: Raster) -> None:
    """Raises PrtnetError where the atlas has several textures."""
    if raster.atlas.sides is not None:
        raise PrtnetError(
            "atlas.sets: found parts, expected one: the basis of data-driven transfer is one texture for the scene"
        )
