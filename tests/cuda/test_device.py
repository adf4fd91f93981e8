"""What is said where pycuda, its OpenGL part, the driver or a GPU is missing. No pycuda is needed."""

from types import SimpleNamespace

import pytest

from prtnet import PrtnetError
from prtnet.render import cuda_device


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("No module named 'pycuda'", "found no pycuda.*tools/install_pycuda"),
        ("PyCUDA was compiled without GL extension support", "without OpenGL.*tools/install_pycuda"),
        ("_driver.so: undefined symbol: cuCtxCreate_v4", "pycuda does not load.*tools/install_pycuda"),
        ("libcuda.so.1: cannot open shared object file", "found no NVIDIA driver.*expected a machine with a GPU"),
    ],
)
def test_what_cannot_be_imported_is_named(words, message, monkeypatch):
    def absent(name):
        raise ImportError(words)

    monkeypatch.setattr(cuda_device, "import_module", absent)
    with pytest.raises(PrtnetError, match=message):
        cuda_device.Device()


def test_a_driver_without_a_gpu_is_said(monkeypatch):
    class DriverError(Exception):
        pass

    def init():
        raise DriverError("cuInit failed: no CUDA-capable device is detected")

    driver = SimpleNamespace(Error=DriverError, init=init)
    monkeypatch.setattr(cuda_device, "import_module", lambda name: driver)
    with pytest.raises(PrtnetError, match=r"no GPU that it can use.*no CUDA-capable device.*nvidia-smi"):
        cuda_device.Device()
