"""The emulated driver: built from tests/cuda/driver, and put in the place of NVIDIA's before pycuda is imported."""

import ctypes
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from prtnet.export import cuda_host
from prtnet.render.cuda_device import DeviceArray

HERE = Path(__file__).parent
PYCUDA = HERE.parents[1] / "build" / "pycuda"  # where ./run cuda-test has it built
NO_CALL = "CUresult {name}(void) {{ return CUDA_ERROR_NOT_SUPPORTED; }}"


def missing() -> str | None:
    """Why the emulated driver cannot be used, and what to do; None where it can."""
    if not list(PYCUDA.glob("pycuda/_driver*.so")):
        return f"no pycuda in {PYCUDA}: ./run cuda-test builds it, and says why where it cannot"
    if shutil.which("gcc") is None or shutil.which("nm") is None:
        return "no gcc or nm: apt-get install gcc binutils"
    return None


def install(folder: Path) -> None:
    """Build the driver, load it under its name, and let pycuda be found."""
    library = _build(folder)
    ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    sys.path.insert(0, str(PYCUDA))


def _build(folder: Path) -> Path:
    """What pycuda wants of the driver and the sources lack is there, too, and says that it is not supported."""
    toolkit = re.search(r"TOP=(\S+)", _run("nvcc", "--dryrun", "-x", "cu", "/dev/null", "-c", "-o", "/dev/null").stderr)
    assert toolkit, "nvcc does not say where it lives"
    sources = sorted(map(str, (HERE / "driver").glob("*.c")))
    library, rest = folder / "libcuda.so.1", folder / "rest.c"
    flags = ["-shared", "-fPIC", "-O1", "-Wall", "-Werror", f"-I{toolkit[1]}/include", "-Wl,-soname,libcuda.so.1"]
    flags += ["-o", str(library), "-ldl"]
    _run("gcc", *sources, *flags)
    (extension,) = PYCUDA.glob("pycuda/_driver*.so")
    lacking = sorted(_calls(extension, "undefined") - _calls(library, "defined"))
    lines = ["typedef int CUresult;", "#define CUDA_ERROR_NOT_SUPPORTED 801"]
    rest.write_text("\n".join(lines + [NO_CALL.format(name=name) for name in lacking]))
    _run("gcc", *sources, str(rest), *flags)
    return library


def _calls(library: Path, kind: str) -> set[str]:
    """The driver's functions among a library's symbols."""
    return set(re.findall(r" [TU] (cu[A-Z]\w+)", _run("nm", "-D", f"--{kind}-only", str(library)).stdout))


def _run(*command: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done


class HostBuild:
    """In the place of `cuda_build.cubin`: kernels for the processor, which the emulated driver loads."""

    def __init__(self, folder: Path):
        self.folder = folder

    def __call__(self, source: str, capability: tuple[int, int]) -> bytes:
        assert capability == (9, 0)
        return cuda_host.build(source, self.folder / "kernels.so").read_bytes()


def view(array: DeviceArray) -> np.ndarray:
    """The emulated device's memory, in place."""
    described = array.__cuda_array_interface__
    kind, shape = np.dtype(described["typestr"]), described["shape"]
    memory = (ctypes.c_char * array.bytes).from_address(described["data"][0])
    return np.frombuffer(memory, kind).reshape(shape)
