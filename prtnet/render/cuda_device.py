"""A GPU by pycuda: its primary context, which torch shares, memory, kernels of a net, and textures of OpenGL.

Calls stand within `with device.active()`. All work goes to the default stream, in order.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import moderngl
import numpy as np

from prtnet import PrtnetError
from prtnet.export import cuda
from prtnet.netspec import NetSpec

Array = np.ndarray
GL_TEXTURE_2D = 0x0DE1
# source of the kernels, compute capability -> their machine code
Build = Callable[[str, tuple[int, int]], bytes]


class DeviceArray:
    """Memory of the GPU that torch, CuPy and numba read and write in place, by `__cuda_array_interface__`."""

    def __init__(self, device: "Device", shape: tuple[int, ...], kind: str):
        self.shape, self.kind, self._device = shape, np.dtype(kind), device
        self.bytes = int(np.prod(shape)) * self.kind.itemsize
        try:
            self._allocation = device.driver.mem_alloc(max(self.bytes, 16))
        except device.driver.Error as error:
            raise PrtnetError(
                f"CUDA: {device.name} has no room for {self.bytes} bytes ({error}); choose a smaller render.size, or "
                "end what else runs there"
            ) from error
        self.address = int(self._allocation)

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        data = self.address, False
        return {"shape": self.shape, "typestr": self.kind.str, "data": data, "strides": None, "version": 3, "stream": 1}

    def write(self, values: Array) -> None:
        """From the host, converted. Inverse of `read`."""
        assert values.shape == self.shape, f"found {values.shape}, expected {self.shape}"
        self._device.driver.memcpy_htod(self.address, np.ascontiguousarray(values, self.kind))

    def read(self) -> Array:
        """To the host, once all work before is done."""
        found = np.empty(self.shape, self.kind)
        self._device.driver.memcpy_dtoh(found, self.address)
        return found

    def clear(self) -> None:
        """All 0."""
        self._device.driver.memset_d32_async(self.address, 0, self.bytes // 4)


class Device:
    """The first GPU. Raises PrtnetError where pycuda, its OpenGL part, the driver or a GPU is missing."""

    def __init__(self) -> None:
        self.driver, self.gl = _pycuda()
        try:
            self.driver.init()
            gpu = self.driver.Device(0)
            self._context = gpu.retain_primary_context()
        except self.driver.Error as error:
            raise PrtnetError(
                f"CUDA: the driver found no GPU that it can use ({error}), expected one: nvidia-smi lists them, and "
                "CUDA_VISIBLE_DEVICES may hide them"
            ) from error
        self.name, self.capability = gpu.name(), gpu.compute_capability()

    @contextmanager
    def active(self) -> Iterator[None]:
        """The context is this thread's as long as this lasts."""
        self._context.push()
        try:
            yield
        finally:
            self._context.pop()

    def array(self, *shape: int, kind: str = "float32") -> DeviceArray:
        """Memory that holds anything."""
        return DeviceArray(self, shape, kind)

    def upload(self, values: Array) -> DeviceArray:
        """Memory that holds these numbers."""
        made = self.array(*values.shape, kind=values.dtype.name)
        made.write(values)
        return made

    def synchronise(self) -> None:
        """Wait until all work is done."""
        self._context.synchronize()


class Kernels:
    """The kernels of a net on a device."""

    def __init__(self, device: Device, net: NetSpec, radiance_bands: int, build: Build):
        self._net = net
        code = build(cuda.source(net, radiance_bands), device.capability)
        self._module = device.driver.module_from_buffer(code)
        self._functions = {name: self._module.get_function(name) for name in cuda.ARGUMENTS}

    def launch(self, kernel: str, points: int, /, **values: DeviceArray | float | tuple[float, ...] | None) -> None:
        """Run a kernel on blocks for that many points, or pixels; None is a null pointer."""
        given = {name: _address(value) for name, value in values.items()}
        blocks = -(-points // cuda.points_per_block(self._net, kernel))
        packed = cuda.arguments(kernel, **given)
        self._functions[kernel](packed, block=(cuda.threads(kernel), 1, 1), grid=(blocks, 1))


class SharedTexture:
    """An RGBA32F texture of OpenGL beside its copy in linear memory."""

    def __init__(self, device: Device, texture: moderngl.Texture, *, written: bool = False):
        # written: by CUDA; otherwise it reads
        if (texture.components, texture.dtype) != (4, "f4"):
            found = f"{texture.components} channels of {texture.dtype}"
            raise PrtnetError(f"CUDA: found a texture of {found}, expected 4 of f4: it shares none of three channels")
        self._device, (self._width, self._height) = device, texture.size
        self.linear = device.array(self._width * self._height, 4)
        flags = device.gl.graphics_map_flags
        try:
            flag = flags.WRITE_DISCARD if written else flags.READ_ONLY
            self._registered = device.gl.RegisteredImage(texture.glo, GL_TEXTURE_2D, flag)
        except device.driver.Error as error:
            renderer = texture.ctx.info["GL_RENDERER"]
            raise PrtnetError(
                f"CUDA: {device.name} cannot share a texture with OpenGL on {renderer} ({error}), expected OpenGL on "
                "that GPU: install NVIDIA's EGL, or point __EGL_VENDOR_LIBRARY_FILENAMES at its 10_nvidia.json"
            ) from error

    def load(self) -> None:
        """OpenGL's texels to linear memory, row by row as OpenGL keeps them. Inverse of `store`."""
        self._copy(lambda copy, image: (copy.set_src_array(image), copy.set_dst_device(self.linear.address)))

    def store(self) -> None:
        """Linear memory to OpenGL's texels. Inverse of `load`."""
        self._copy(lambda copy, image: (copy.set_src_device(self.linear.address), copy.set_dst_array(image)))

    def _copy(self, ends: Callable[[Any, Any], object]) -> None:
        mapping = self._registered.map()
        try:
            copy = self._device.driver.Memcpy2D()
            ends(copy, mapping.array(0, 0))
            copy.width_in_bytes = copy.src_pitch = copy.dst_pitch = 16 * self._width
            copy.height = self._height
            copy(aligned=True)
        finally:
            mapping.unmap()


def _address(value: DeviceArray | float | tuple[float, ...] | None) -> object:
    if value is None:
        return 0
    return value.address if isinstance(value, DeviceArray) else value


def _pycuda() -> tuple[Any, Any]:
    """(pycuda.driver, pycuda.gl)"""
    try:
        return import_module("pycuda.driver"), import_module("pycuda.gl")
    except ImportError as error:
        found = str(error)
    if "libcuda" in found:
        raise PrtnetError(f"CUDA: found no NVIDIA driver ({found}), expected a machine with a GPU and its driver")
    if "GL extension" in found:
        raise PrtnetError(f"CUDA: pycuda is there without OpenGL ({found}), expected it with; run tools/install_pycuda")
    if "undefined symbol" in found:
        raise PrtnetError(
            f"CUDA: pycuda does not load ({found}), expected one for this driver; run tools/install_pycuda"
        )
    where = f" in {os.environ['PYTHONPATH']}" if os.environ.get("PYTHONPATH") else ""
    raise PrtnetError(f"CUDA: found no pycuda{where} ({found}), expected it with OpenGL; run tools/install_pycuda")
