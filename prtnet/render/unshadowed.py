"""The cosine lobe about the normal in a fragment shader: what a frame costs without precomputed transfer."""

from prtnet import gl, sh
from prtnet.export import unshadowed
from prtnet.render.marched import Drawing
from prtnet.render.material import DIFFUSE, Material
from prtnet.render.method import Shaded


class UnshadowedMethod(Shaded):
    """Transfer of open points in `bands` bands: no network, no shadows, no bytes.

    `macs` are those of the lobe, which the shading at a pixel comes on top of.
    """

    bytes = 0

    def __init__(self, raster: Drawing, bands: int, *, material: Material = DIFFUSE):
        self.macs, count = unshadowed.macs(bands), sh.count(bands)
        names = ", ".join(f"t{layer}" for layer in range(gl.layer_count(count)))
        call = f"prt_transfer(position, shading_normal(), {names})"
        super().__init__(raster, range(count, count + 1), unshadowed.transfer(bands), call, material)
