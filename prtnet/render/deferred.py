"""A net of any size on screen without a shader of its own: its evaluation and the shading are left to the CPU.

The view's G-buffer (Deering et al. 1988, *The Triangle Processor and Normal Vector Shader*) is read back, the net is
evaluated at the covered pixels alone, these are shaded by the plain twin of the shaders, and the picture goes into the
frame that other methods draw into. No compiler sees the weights, so no net is too large.
"""

import numpy as np
from jaxtyping import Float

from prtnet import gl, sh
from prtnet.models.inference import Inference
from prtnet.netspec import NetSpec
from prtnet.render import gbuffer as gbuffers
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import GBuffer
from prtnet.render.marched import Drawing
from prtnet.render.material import DIFFUSE, Material
from prtnet.render.method import Shaded

Array = np.ndarray


class DeferredMethod(Shaded):
    """Transfer from a net in torch at every covered pixel. The time of a frame has both ways of the pixels in it."""

    def __init__(self, raster: Drawing, net: NetSpec, *, material: Material = DIFFUSE):
        count = sh.count(net.bands)
        self.raster, self.material, self.groups = raster, material, net.groups
        self.coefficients, self.layers = range(count, count + 1), gl.layer_count(count)
        self._infer, self._lit = Inference(net), np.zeros((count, 3), np.float32)
        self._count_light()

    def set_material(self, material: Material) -> None:
        """Another material."""
        self.material = material

    def set_light(self, light: Float[Array, "k 3"]) -> None:
        """Keep a light. Raises PrtnetError where its bands are not those of the transfer."""
        self._check_light(light)
        self._lit = light

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""
        gbuffer = self.raster.gbuffer(camera)
        colours = gbuffers.colours(gbuffer, self._transfer(gbuffer), self._lit, self.material, groups=self.groups)
        width, height = self.raster.target.size
        image = np.zeros((height * width, 4), np.float32)
        image[gbuffer.pixel, :3], image[gbuffer.pixel, 3] = colours, 1
        self.raster.target.write(image.reshape(height, width, 4))

    def _transfer(self, gbuffer: GBuffer) -> Float[Array, "n c"]:
        return self._infer(gbuffer.positions, gbuffer.normals, gbuffer.uv)
