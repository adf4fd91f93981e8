"""Machine code for GPUs, which need not be there: `./run cuda-test`."""

import shutil

import pytest

from prtnet import PrtnetError
from prtnet.export import cuda, cuda_build
from tests.cuda.test_transfer import DEFAULT, NETS
from tests.nets import random_net

pytestmark = pytest.mark.cuda
needs_nvcc = pytest.mark.skipif(shutil.which("nvcc") is None, reason="no nvcc on the PATH: install the CUDA toolkit")
ARCHITECTURES = ["sm_75", "sm_86", "sm_90"]
KERNELS = {"prt_pack", "prt_transfer", "prt_diffuse", "prt_gloss", "prt_unpack"}


@needs_nvcc
@pytest.mark.parametrize("architecture", ARCHITECTURES)
@pytest.mark.parametrize("width", [32, 64, 128, 256, 512])
def test_kernels_keep_to_their_registers(width, architecture):
    _check(cuda.source(random_net(width=width, depth=4, **DEFAULT)), architecture)


@needs_nvcc
@pytest.mark.parametrize("name", NETS)
def test_every_net_compiles_without_spills(name):
    _check(cuda.source(random_net(**NETS[name])), "sm_75")


def _check(source: str, architecture: str) -> None:
    code, resources = cuda_build.nvcc(source, architecture)
    assert code.startswith(b"\x7fELF")
    assert resources.keys() == KERNELS
    for kernel, found in resources.items():
        print(architecture, kernel, found)
        assert (found.stack, found.spilled) == (0, 0), kernel
        assert found.registers <= 168, kernel  # three blocks of 128 threads for each multiprocessor
        assert found.shared <= cuda.SHARED_BYTES, kernel


@needs_nvcc
def test_a_spill_is_seen():
    """A block of 1024 threads leaves 64 registers to each."""
    source = cuda.source(random_net(width=128, **DEFAULT))
    _, resources = cuda_build.nvcc(source.replace("__launch_bounds__(threads)", "__launch_bounds__(1024)"), "sm_75")
    assert resources["prt_transfer"].spilled > 0


@needs_nvcc
def test_an_error_has_the_compilers_words():
    with pytest.raises(PrtnetError, match="sinecosine"):
        cuda_build.nvcc(cuda.source(random_net(width=4)).replace("sincospif(", "sinecosine("), "sm_75")


@pytest.mark.skipif(
    cuda_build.nvrtc_library() is None, reason="no NVRTC: torch for CUDA brings it, or pip install nvidia-cuda-nvrtc"
)
def test_without_nvcc_nvrtc_compiles_the_same_text(monkeypatch):
    monkeypatch.setenv("PATH", "")
    source = cuda.source(random_net(width=16, **DEFAULT))
    assert cuda_build.cubin(source, (8, 6)).startswith(b"\x7fELF")
    with pytest.raises(PrtnetError, match="sinecosine"):
        cuda_build.cubin(source.replace("sincospif(", "sinecosine("), (8, 6))


def test_without_either_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr(cuda_build, "nvrtc_library", lambda: None)
    with pytest.raises(PrtnetError, match=r"neither nvcc on the PATH nor NVRTC.*install the CUDA toolkit"):
        cuda_build.cubin(cuda.source(random_net(width=4)), (8, 6))
