"""The kernels of a net on the processor, and what they should give."""

import faulthandler
import os
import signal
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from prtnet import PrtnetError, netspec
from prtnet.export import cuda, cuda_host
from prtnet.export.cuda_host import HostKernels
from prtnet.netspec import NetSpec
from tests.nets import random_points, random_uv

TOLERANCE = 1e-5  # of each coefficient, as for every exported form
needs_compiler = pytest.mark.skipif(
    cuda_host.compiler() is None, reason="no g++ or clang++: apt-get install --no-install-recommends g++"
)


def compiled(net: NetSpec, folder: Path, **more: int) -> HostKernels:
    """The kernels of `cuda.source(net, **more)`."""
    return HostKernels(net, cuda_host.build(cuda.source(net, **more), folder / "kernels.so"))


def worst(kernels: HostKernels, count: int, seed: int = 3, **more: int) -> float:
    """The largest error of a coefficient at random points; infinite for one that is missing or no number."""
    positions, normals = random_points(count, seed)
    # corners of the cube, and places on corners of cells
    positions[: min(count, 8)] = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3)[:count]
    positions[8 : count // 4] = np.round(positions[8 : count // 4] * 8) / 8
    uv = random_uv(count, seed)
    # likewise of the atlas
    uv[: count // 4] = np.round(uv[: count // 4] * 7) / 7
    found = kernels.transfer(positions, normals, uv, **more)
    error = np.abs(found - netspec.evaluate_unit(kernels.net, positions.astype(np.float64), normals, uv=uv))
    return float(np.nan_to_num(error, nan=np.inf).max(initial=0))


def survives(check: Callable[[], bool]) -> bool:
    """Whether a check of kernels with a mistake in them passes, in a child process: some read wherever NaN leads."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # this process has threads; the child starts none and only leaves
        child = os.fork()
    if child == 0:
        faulthandler.disable()
        signal.alarm(30)
        try:
            passed = check()
        except (PrtnetError, AssertionError):
            passed = False
        os._exit(0 if passed else 1)
    return os.waitpid(child, 0)[1] == 0
