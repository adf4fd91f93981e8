"""The direct vector of a lighting, found by the very shader that draws direct light.

The s surface points of each of m measurement points are the pixels of a fake G-buffer, shaded in one pass and averaged
in another. The result stays on the graphics card, m pixels in a row.
"""

import math

import moderngl
import numpy as np
from jaxtyping import Float32

from prtnet import PrtnetError, gl
from prtnet.data.lighting.lamp import Lighting
from prtnet.data_driven import Measurement
from prtnet.export import lamps
from prtnet.render.shadow_maps import ShadowMaps

Array = np.ndarray


class Measure:
    """Measurement points, uploaded. `target` has the direct vector, m x 1 pixels, after `draw`."""

    def __init__(self, measurement: Measurement, shadows: ShadowMaps):
        self.measurement, self.shadows = measurement, shadows
        count, each = measurement.positions.shape[:2]
        vertex, share = gl.shader("fullscreen.vert.glsl"), measurement.albedo / math.pi
        self._shade = gl.program(vertex, lamps.measured(shadows.room))
        self._average = gl.program(vertex, lamps.AVERAGED)
        surface = measurement.positions, measurement.normals, measurement.geometric_normals
        names = "measured_positions", "measured_normals", "measured_geometric"
        self._points = {
            name: gl.upload(_rows(values, share[..., colour]))
            for colour, (name, values) in enumerate(zip(names, surface, strict=True))
        }
        self._pixels, self.target = gl.target(count, each), gl.target(count, 1)
        self._distant = gl.upload(np.zeros((1, count, 4), np.float32))

    def draw(self, lighting: Lighting) -> None:
        """Find the direct vector, and the shadow maps it takes.

        Raises PrtnetError for more lamps than there is room for, and for light from far away with other coefficients
        than the measurement has.
        """
        distant = self._from_far(lighting)
        self.shadows.draw(lighting)
        for unit, (name, texture) in enumerate(self._points.items()):
            texture.use(unit)
            gl.put(self._shade, **{name: unit})
        self.shadows.bind(self._shade)
        gl.fullscreen(self._shade, self._pixels)
        self._distant.write(np.ascontiguousarray(distant).tobytes())
        pixels = self._pixels.framebuffer.color_attachments[0]
        assert isinstance(pixels, moderngl.Texture)
        pixels.use(0)
        self._distant.use(1)
        gl.put(self._average, measured=0, distant=1)
        gl.fullscreen(self._average, self.target)

    def read(self) -> Float32[Array, "m 3"]:
        """The direct vector that was found last."""
        return self.target.read()[0, :, :3]

    @property
    def texture(self) -> moderngl.Texture:
        """The direct vector on the graphics card, m x 1 texels."""
        found = self.target.framebuffer.color_attachments[0]
        assert isinstance(found, moderngl.Texture)
        return found

    def _from_far(self, lighting: Lighting) -> Float32[Array, "m 4"]:
        made = np.zeros((self.measurement.count, 4), np.float32)
        distant, known = lighting.environment, self.measurement.transfer.shape[1]
        if distant is None:
            return made
        if len(distant) > known:
            raise PrtnetError(
                f"lighting: found an environment of {len(distant)} SH coefficients, expected at most {known}, which is"
                " what the measurement points know their transfer for"
            )
        transfer = self.measurement.transfer[:, : len(distant)]
        made[:, :3] = np.einsum("mkc,kc->mc", transfer, distant, dtype=np.float64)
        return made


def _rows(values: Float32[Array, "m s 3"], last: Float32[Array, "m s"]) -> Float32[Array, "s m 4"]:
    """A column for each point."""
    return np.ascontiguousarray(np.concatenate([values, last[..., None]], axis=2).swapaxes(0, 1), np.float32)
