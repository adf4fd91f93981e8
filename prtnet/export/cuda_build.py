"""Kernels for a GPU: by nvcc where it is installed, otherwise by NVRTC, which comes with torch for CUDA."""

import ctypes
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from prtnet import PrtnetError

STANDARD = "-std=c++17"


class Resources(NamedTuple):
    """What a kernel takes of a multiprocessor."""

    registers: int  # of each thread
    shared: int  # bytes of a block
    stack: int  # bytes of each thread in memory
    spilled: int  # bytes of registers that went to memory


def cubin(source: str, capability: tuple[int, int]) -> bytes:
    """Machine code for a compute capability. Raises PrtnetError with the compiler's words, or where there is none."""
    architecture = f"sm_{capability[0]}{capability[1]}"
    if shutil.which("nvcc"):
        return nvcc(source, architecture)[0]
    library = nvrtc_library()
    if library is None:
        raise PrtnetError(
            "CUDA: found neither nvcc on the PATH nor NVRTC, expected one of them: install the CUDA toolkit, or torch "
            "for CUDA, which brings NVRTC"
        )
    return nvrtc(library, source, architecture)


def nvcc(source: str, architecture: str) -> tuple[bytes, dict[str, Resources]]:
    """Machine code, and what each kernel takes."""
    with tempfile.TemporaryDirectory() as folder:
        text, code = Path(folder) / "kernels.cu", Path(folder) / "kernels.cubin"
        text.write_text(source, encoding="utf-8")
        command = ["nvcc", f"-arch={architecture}", STANDARD, "-cubin", "-Xptxas", "-v", "-o", str(code), str(text)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise PrtnetError(f"CUDA kernels for {architecture}: nvcc found {done.stderr.strip()[-2000:]}")
        return code.read_bytes(), _resources(done.stderr)


def _resources(words: str) -> dict[str, Resources]:
    """Reads what ptxas says of each kernel."""
    found = {}
    for part in words.split("Compiling entry function '")[1:]:
        name = part.split("'")[0]
        numbers = [re.search(pattern, part) for pattern in (r"Used (\d+) reg", r"(\d+) bytes smem")]
        registers, shared = (int(number.group(1)) if number else 0 for number in numbers)
        frames = re.findall(r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads", part)
        stack = sum(int(frame) for frame, _, _ in frames)
        found[name] = Resources(registers, shared, stack, sum(int(out) + int(back) for _, out, back in frames))
    return found


def nvrtc(library: str, source: str, architecture: str) -> bytes:
    """Machine code by NVRTC's C interface: create, compile, take the code or the log."""
    api, program = ctypes.CDLL(library), ctypes.c_void_p()
    options = [f"-arch={architecture}".encode(), STANDARD.encode()]
    api.nvrtcCreateProgram(ctypes.byref(program), source.encode(), b"kernels.cu", 0, None, None)
    try:
        if api.nvrtcCompileProgram(program, len(options), (ctypes.c_char_p * len(options))(*options)):
            log = _text(api.nvrtcGetProgramLogSize, api.nvrtcGetProgramLog, program).decode(errors="replace")
            raise PrtnetError(f"CUDA kernels for {architecture}: NVRTC found {log.strip()[-2000:]}")
        return _text(api.nvrtcGetCUBINSize, api.nvrtcGetCUBIN, program)
    finally:
        api.nvrtcDestroyProgram(ctypes.byref(program))


def _text(size: Any, get: Any, program: ctypes.c_void_p) -> bytes:
    length = ctypes.c_size_t()
    size(program, ctypes.byref(length))
    buffer = ctypes.create_string_buffer(length.value)
    get(program, buffer)
    return buffer.raw


def nvrtc_library() -> str | None:
    """NVRTC on the loader's path, or in the packages that torch depends on."""
    for name in ("libnvrtc.so.13", "libnvrtc.so.12", "libnvrtc.so"):
        try:
            ctypes.CDLL(name)
            return name
        except OSError:
            continue
    folders = [Path(entry) / "nvidia" for entry in sys.path if entry]
    found = sorted(file for folder in folders if folder.is_dir() for file in folder.glob("*/lib/libnvrtc.so.*"))
    return str(found[-1]) if found else None
