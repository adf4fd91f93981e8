"""A diffuse scene under lamps with shadow maps, and under light from far away where its transfer is in textures."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float32

from prtnet import PrtnetError, gl
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.texture import Page
from prtnet.export import lamps
from prtnet.export.spelling import number
from prtnet.render.camera import Camera
from prtnet.render.method import irradiance_text
from prtnet.render.raster import Group, Raster
from prtnet.render.shadow_maps import ShadowMaps
from prtnet.render.transfer_map import TransferMap

Array = np.ndarray

# texture units from here on are for `textures`; before them stand albedo, transfer, normals, shadow maps
TEXTURE_UNIT = 7


class LampMethod:
    """Radiance albedo / pi (E_lamps + transfer . environment), and what the caller adds.

    `received` is a GLSL expression of further irradiance, `leaving` one of further radiance; `source` has the functions
    they take, and may use `position`, `atlas_uv`, `shading_normal()` and `geometric_normal()`. `textures` are bound
    to its samplers by name. Without `direct` nothing but these is drawn.
    """

    def __init__(
        self,
        raster: Raster,
        *,
        shadows: ShadowMaps | None = None,
        pages: Sequence[Page] | None = None,
        groups: int = 1,
        texels: str = "float32",
        source: str = "",
        received: str = "",
        leaving: str = "",
        textures: Mapping[str, Any] | None = None,
        direct: bool = True,
    ):
        # pages: transfer of the raster's atlas, k channels in each of its groups, the first of which is direct
        self.raster, self.textures = raster, dict(textures or {})
        self.shadows = shadows or ShadowMaps(raster.scene)
        self.coefficients = 0 if pages is None else pages[0].levels[0].shape[2] // groups
        chosen = [] if pages is None else [_first(page, self.coefficients) for page in pages]
        self.map = TransferMap(raster.atlas, chosen, texels, "derivative") if chosen else None
        vectors = [f"t{layer}" for layer in range(gl.layer_count(self.coefficients))]
        terms = ["prt_direct(position, shading_normal(), geometric_normal())"] * direct
        terms += [irradiance_text([vectors])] * bool(vectors and direct) + [received] * bool(received)
        names = ["surface.glsl", "shading_normal.glsl", "geometric_normal.glsl", "albedo.glsl"]
        surface, normals, geometric, albedo = (gl.shader(name) for name in names)
        texts = [surface, self.map.declarations if self.map else "in vec2 atlas_uv;\n", albedo, normals, geometric]
        texts += [lamps.functions(self.shadows.room) if direct else "", source, "\n", gl.shader("shading.frag.glsl")]
        self.program = raster.program(
            "".join(texts),
            LAYERS=max(len(vectors), 1),
            DECLARE=f"vec4 {', '.join(vectors)}" if vectors else "",
            TRANSFER=self.map.statements if self.map else "",
            SUM=" + ".join(terms) or "vec3(0.0)",
            DIFFUSE=number(1 / math.pi),
            **({"GLOSS": leaving} if leaving else {}),
        )
        self.draws, self._lighting = raster.draws(self.program), Lighting()

    def draw(self, camera: Camera, lighting: Lighting) -> Float32[Array, "h w 3"]:
        """The image under a lighting."""
        self.set_lighting(lighting)
        self.render(camera)
        return self.raster.target.read()[..., :3]

    def milliseconds(self, camera: Camera, lighting: Lighting, repeats: int = 5, *, moving: bool = False) -> float:
        """Time of one frame without reading it back: median after warm-up. `moving`: with its shadow maps."""
        self.set_lighting(lighting)

        def frame() -> None:
            if moving:
                self.shadows.draw(lighting, again=True)
            self.render(camera)

        return gl.milliseconds(frame, repeats)

    def set_lighting(self, lighting: Lighting) -> None:
        """Draw the shadow maps of a lighting and upload its light from far away.

        Raises PrtnetError for more lamps than there is room for, and for an environment without transfer pages, or of
        more coefficients than they have.
        """
        distant = np.zeros((0, 3), np.float32) if lighting.environment is None else lighting.environment
        if len(distant) > self.coefficients:
            raise PrtnetError(
                f"lighting: found an environment of {len(distant)} SH coefficients, expected at most"
                f" {self.coefficients}, which is what the transfer textures have"
            )
        self.shadows.draw(lighting)
        self._lighting = lighting
        held = getattr(self.program.get("light", None), "array_length", 0)
        padded = np.zeros((4 * held, 3), np.float32)
        padded[: len(distant)] = distant[: len(padded)]
        gl.put(self.program, light=padded)

    def bind(self) -> None:
        """Make maps and textures those of the program."""
        self.shadows.bind(self.program)
        for unit, (name, texture) in enumerate(self.textures.items(), TEXTURE_UNIT):
            texture.use(unit)
            gl.put(self.program, **{name: unit})

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""

        def before(group: Group) -> None:
            if self.map:
                self.map.bind(self.program, group.page, camera, self.raster.size)

        # others may have drawn the same maps for another light since
        self.shadows.draw(self._lighting)
        self.bind()
        self.raster.render(self.program, self.draws, camera, prepass=prepass, before=before)


def _first(page: Page, channels: int) -> Page:
    return replace(page, levels=tuple(level[..., :channels] for level in page.levels))
