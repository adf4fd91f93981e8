"""A net on a GPU by CUDA inside of OpenGL: what OpenGL draws is shaded by kernels, and nothing crosses to the host.

    G-buffer (OpenGL) -> map -> pack covered pixels -> network -> shade -> unpack -> map -> texture (OpenGL)

The network is the fused kernel of `prtnet.export.cuda`, or any function of packed points, such as
`prtnet.models.device_net.DeviceNet` in torch. The plain twin is `method.NetMethod`, which does it all in GLSL.
"""

from collections.abc import Callable
from statistics import median

import moderngl
import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError, gl, sh
from prtnet.export import cuda, cuda_build
from prtnet.netspec import NetSpec
from prtnet.render import reflectance
from prtnet.render.camera import Camera
from prtnet.render.cuda_device import Build, Device, DeviceArray, Kernels, SharedTexture
from prtnet.render.material import DIFFUSE, Material, fixed_light_matrix
from prtnet.render.raster import Raster

Array = np.ndarray

STAGES = ("map", "pack", "network", "shade", "unpack")
# (positions (pixels, 3), normals, transfer (pixels, c), how many of the rows are points, uv (pixels, 2) or
# None where the net has no texels): it writes `transfer`
Network = Callable[[DeviceArray, DeviceArray, DeviceArray, int, DeviceArray | None], None]


class CudaNetMethod:
    """A material on the transfer of a net, shaded by CUDA. Buffers are made once and stay."""

    def __init__(
        self,
        raster: Raster,
        net: NetSpec,
        *,
        material: Material = DIFFUSE,
        network: Network | None = None,
        build: Build = cuda_build.cubin,
        device: Device | None = None,
    ):
        self.raster, self.net, self.material, self.network = raster, net, material, network
        self.pixels = raster.size * raster.size
        self._attributes = reflectance.attributes(material, raster.scene)
        self._program = _gbuffer_program(raster, material, own=bool(self._attributes))
        self._draws = raster.draws(self._program, self._attributes)
        self._gbuffer = gl.target(raster.size, raster.size, 4 if self._attributes else 3, depth=True)
        self._picture = gl.target(raster.size, raster.size)
        self.device = device or Device()
        with self.device.active():
            _, self.bands_out = material.orders(net.bands)
            self._kernels = Kernels(self.device, net, self.bands_out, build)
            self._allocate()
        light_bands = material.light_bands or net.bands
        self.light_count, self._light = sh.count(light_bands), None

    def _allocate(self) -> None:
        device, pixels = self.device, self.pixels
        textures = self._gbuffer.framebuffer.color_attachments
        shared = [SharedTexture(device, texture) for texture in textures if isinstance(texture, moderngl.Texture)]
        self._shared = dict(zip(("positions", "normals", "albedo", "reflectance"), shared, strict=False))
        (picture,) = self._picture.framebuffer.color_attachments
        assert isinstance(picture, moderngl.Texture)
        self._out = SharedTexture(device, picture, written=True)
        self.points, self._pixel = device.array(1, kind="int32"), device.array(pixels, kind="int32")
        self.positions, self.normals = device.array(pixels, 3), device.array(pixels, 3)
        self.uv = device.array(pixels, 2) if self.net.texels else None
        self.transfer = device.array(pixels, len(self.net.biases[-1]))
        self._radiance = device.array(pixels, 4)
        self._parameters = device.upload(cuda.parameters(self.net))
        count = sh.count(self.net.bands)
        self._coefficients = device.array(max(count, sh.count(self.material.light_bands or self.net.bands)), 4)
        self._matrix = device.array(count * sh.count(self.bands_out), 4) if self.material.glossy else None
        self._events = [device.driver.Event() for _ in range(len(STAGES) + 1)]

    @property
    def texture(self) -> moderngl.Texture:
        """The picture: linear RGB, and 1 where a surface is; 0 elsewhere."""
        (picture,) = self._picture.framebuffer.color_attachments
        assert isinstance(picture, moderngl.Texture)
        return picture

    def set_light(self, light: Float[Array, "k 3"]) -> None:
        """Upload a light. Raises PrtnetError where its bands are not the transfer's, or `material.light_bands`."""
        if len(light) != self.light_count:
            raise PrtnetError(f"light: found {len(light)} SH coefficients, expected {self.light_count}")
        if self._light is not None and np.array_equal(light, self._light):
            return
        with self.device.active():
            self._coefficients.write(_padded(light, self._coefficients.shape[0]))
            if self._matrix:
                matrix = fixed_light_matrix(light, self.net.bands, self.bands_out)
                self._matrix.write(_padded(matrix.transpose(1, 2, 0).reshape(-1, 3), self._matrix.shape[0]))
        self._light = np.array(light)

    def draw(self, camera: Camera, light: Float[Array, "k 3"]) -> Float32[Array, "h w 3"]:
        """The image under a light's SH coefficients, read back."""
        self.set_light(light)
        self.render(camera)
        return self._picture.read()[..., :3]

    def render(self, camera: Camera) -> None:
        """Draw into `texture`, under the light of `set_light`."""
        self.raster.render(self._program, self._draws, camera, target=self._gbuffer)
        with self.device.active():
            steps = (self._map, self._pack, self._transfer, lambda: self._shade(camera), self._unpack)
            self._events[0].record()
            for step, event in zip(steps, self._events[1:], strict=True):
                step()
                event.record()

    def _map(self) -> None:
        for texture in self._shared.values():
            texture.load()

    def _pack(self) -> None:
        self.points.clear()
        self._launch(
            "prt_pack",
            positions=self._shared["positions"].linear,
            normals=self._shared["normals"].linear,
            albedo=self._shared["albedo"].linear,
            pixel=self._pixel,
            packed_positions=self.positions,
            packed_normals=self.normals,
            packed_uv=self.uv,
            pixels=self.pixels,
        )

    def _transfer(self) -> None:
        if self.network:
            self.network(self.positions, self.normals, self.transfer, int(self.points.read()[0]), self.uv)
            return
        points = {"positions": self.positions, "normals": self.normals, "uv": self.uv, "transfer": self.transfer}
        self._launch("prt_transfer", parameters=self._parameters, **points)

    def _shade(self, camera: Camera) -> None:
        own = self._shared["reflectance"].linear if self._attributes else None
        common = {"transfer": self.transfer, "pixel": self._pixel, "reflectance": own, "radiance": self._radiance}
        self._launch(
            "prt_diffuse",
            albedo=self._shared["albedo"].linear,
            light=self._coefficients,
            coefficients=min(self.light_count, sh.count(self.net.bands)),
            weight=self.material.diffuse,
            **common,
        )
        if self._matrix:
            self._launch(
                "prt_gloss",
                positions=self._shared["positions"].linear,
                normals=self._shared["normals"].linear,
                matrix=self._matrix,
                eye=camera.eye,
                specular=self.material.specular,
                exponent=self.material.exponent,
                **common,
            )

    def _unpack(self) -> None:
        self._out.linear.clear()
        self._launch("prt_unpack", radiance=self._radiance, pixel=self._pixel, picture=self._out.linear)
        self._out.store()

    def _launch(self, kernel: str, **values: DeviceArray | float | tuple[float, ...] | None) -> None:
        self._kernels.launch(kernel, self.pixels, points=self.points, **values)

    def stages(self) -> dict[str, float]:
        """Milliseconds of each stage of the last frame, by CUDA events. The network's includes its wait for the host
        where it is not the kernel."""
        with self.device.active():
            self._events[-1].synchronize()
            pairs = zip(self._events, self._events[1:], strict=False)
            return {name: after.time_since(before) for name, (before, after) in zip(STAGES, pairs, strict=True)}

    def milliseconds(self, camera: Camera, light: Float[Array, "k 3"], repeats: int = 5) -> float:
        """Time of one frame, OpenGL's part and CUDA's, without reading it back: median after warm-up."""
        self.set_light(light)

        def frame() -> None:
            self.render(camera)
            with self.device.active():
                self.device.synchronise()

        return gl.milliseconds(frame, repeats)

    def median_stages(self, camera: Camera, repeats: int = 5) -> dict[str, float]:
        """Medians of `stages` over frames, after a warm-up."""
        taken = []
        for _ in range(repeats + 1):
            self.render(camera)
            taken.append(self.stages())
        return {name: median(each[name] for each in taken[1:]) for name in STAGES}


def _gbuffer_program(raster: Raster, material: Material, *, own: bool) -> moderngl.Program:
    texts = ["surface.glsl", "albedo.glsl", "shading_normal.glsl", *["reflectance.frag.glsl"] * own]
    defines = {"AT_VERTEX": "hand_on_reflectance()", "OWN": 1} if own else {}
    defines |= {"ROUGHNESS": 1} if material.roughness == "file" else {}
    return raster.program(
        "".join(gl.shader(name) for name in [*texts, "gbuffer.frag.glsl"]),
        gl.shader("reflectance.vert.glsl") if own else "",
        LAYERS=1,
        **defines,
    )


def _padded(values: Float[Array, "n 3"], rows: int) -> Float32[Array, "rows 4"]:
    filled = np.zeros((rows, 4), np.float32)
    filled[: len(values), :3] = values
    return filled
