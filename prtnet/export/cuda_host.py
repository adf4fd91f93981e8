"""The CUDA kernels of a net compiled for the processor, from the same source: their test, and their use without a GPU.

cuda/host.h stands in for what CUDA's compiler brings. It checks barriers and the ends of shared memory as it goes.
"""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError
from prtnet.export import cuda
from prtnet.netspec import NetSpec, check_uv

Array = np.ndarray

FLAGS = ("-x", "c++", "-std=c++17", "-O2", "-fPIC", "-shared", "-w", "-DPRT_HOST", f"-I{cuda.SOURCES}")
WRONG = {
    1: "threads of a block do not meet at a barrier",
    2: "it writes outside of its shared memory",
    3: f"it wants more than {cuda.SHARED_BYTES} bytes of shared memory, or more threads than a block has",
}


def compiler() -> str | None:
    """The C++ compiler, or None where there is none."""
    return shutil.which("g++") or shutil.which("clang++")


def version() -> str | None:
    """What the compiler says that it is, or None where there is none."""
    found = compiler()
    if found is None:
        return None
    return subprocess.run([found, "--version"], capture_output=True, text=True, check=True).stdout.split("\n")[0]


def build(source: str, library: Path, *flags: str) -> Path:
    """Compile a text of kernels (`cuda.source`) to a shared library. Raises PrtnetError with the compiler's words."""
    found = compiler()
    if found is None:
        install = "apt-get install --no-install-recommends g++"
        raise PrtnetError(f"CUDA kernels on the processor: found no g++ or clang++, expected one: {install}")
    command = [found, *FLAGS, *flags, "-", "-o", str(library)]
    done = subprocess.run(command, input=source, capture_output=True, text=True, check=False)
    if done.returncode:
        raise PrtnetError(f"CUDA kernels on the processor: {found} found {done.stderr.strip()[-2000:]}")
    return library


class HostKernels:
    """The kernels of one net, from a library that `build` made. Arrays are the device's memory; `parameters` are
    those of `cuda.parameters` where left out."""

    def __init__(self, net: NetSpec, library: Path, parameters: Float32[Array, " n"] | None = None):
        self.net = net
        self._library = ctypes.CDLL(str(library))
        self._parameters = cuda.parameters(net) if parameters is None else parameters

    def launch(self, kernel: str, points: int, /, **values: Array | int | float | tuple[float, ...] | None) -> None:
        """Run a kernel on blocks for that many points, or pixels; arrays are passed by address, None as null.

        Raises PrtnetError where it breaks CUDA's rules.
        """
        given = {name: _address(value) for name, value in values.items()}
        packed = np.array(cuda.arguments(kernel, **given))
        blocks = -(-points // cuda.points_per_block(self.net, kernel))
        entry = getattr(self._library, f"{kernel}__on_host")
        wrong = entry(ctypes.c_uint(blocks), ctypes.c_void_p(packed.ctypes.data))
        if wrong:
            raise PrtnetError(f"CUDA kernel {kernel}: {WRONG[wrong]}")

    def transfer(
        self,
        positions: Float[Array, "n 3"],
        normals: Float[Array, "n 3"],
        uv: Float[Array, "n 2"] | None = None,
        *,
        launched: int | None = None,
    ) -> Float32[Array, "n c"]:
        """Transfer at centred positions, unit normals and, where the net has texels, places in the atlas, by
        prt_transfer over blocks for `launched` points. Raises PrtnetError where `uv` is missing."""
        check_uv(self.net, uv)
        count = np.array([len(positions)], np.int32)
        out = np.full((len(positions), len(self.net.biases[-1])), np.nan, np.float32)
        given = [None if each is None else np.ascontiguousarray(each, np.float32) for each in (positions, normals, uv)]
        named = dict(zip(("positions", "normals", "uv"), given, strict=True))
        self.launch(
            "prt_transfer",
            len(positions) if launched is None else launched,
            parameters=self._parameters,
            **named,
            points=count,
            transfer=out,
        )
        return out


def _address(value: Array | int | float | tuple[float, ...] | None) -> object:
    if value is None:
        return 0
    return value.ctypes.data if isinstance(value, Array) else value
