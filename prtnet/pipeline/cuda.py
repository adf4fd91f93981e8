"""The net of a job as CUDA kernels: part of stage `export` with `export.cuda=true`.

What is written is compiled for the processor, where there is a C++ compiler, and run beside the net in NumPy.
"""

import hashlib
import logging
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from prtnet import PrtnetError
from prtnet.export import cuda_build, cuda_file, cuda_host
from prtnet.netspec import NetSpec
from prtnet.pipeline.job import Job
from prtnet.pipeline.train import Trained
from prtnet.render import verify
from prtnet.render.certify import Points, error_of

log = logging.getLogger(__name__)
Array = np.ndarray

ARCHITECTURE = "sm_75"  # that nvcc validates for: the oldest one that the kernels are meant for


@dataclass(frozen=True)
class Kernels:
    """Files by name, and the certificate's entry `cuda`; both empty where none are wanted."""

    files: dict[str, bytes] = field(default_factory=dict)
    facts: Mapping[str, Any] = field(default_factory=dict)


def kernels(job: Job, trained: Trained, count: int, points: Callable[[], Points]) -> Kernels:
    """The kernels, measured at `points`, which follow from the job and their count.

    Raises PrtnetError where a compiler does not take them, or their error is above its bound.
    """
    if not job.config.export.cuda:
        return Kernels()
    facts, files = measured(job, trained.net, trained.key, count, points)
    words = f"{facts['errors']['coefficients']['max']:.1e}" if facts["executed"] else facts["reason"]
    log.info("export: %s; error at most: %s", job.out / cuda_file.SOURCE, words)
    return Kernels(files, {"cuda": facts})


def measured(
    job: Job, net: NetSpec, key: str, count: int, points: Callable[[], Points]
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The entry of a net with that key, and its files. Raises PrtnetError as `kernels` does."""
    files = cuda_file.files(net)
    digest = hashlib.sha256(b"".join(files[name] for name in cuda_file.NAMES)).hexdigest()
    compiler, nvcc = cuda_host.version(), shutil.which("nvcc") is not None
    inputs = {"net": key, "files": digest, "points": count, "compiler": compiler, "nvcc": nvcc}

    def make() -> tuple[dict[str, Array], dict[str, Any]]:
        if nvcc:
            cuda_build.nvcc(files[cuda_file.SOURCE].decode(), ARCHITECTURE)
        facts: dict[str, Any] = {"validated": f"by nvcc for {ARCHITECTURE}" if nvcc else False}
        if compiler is None:
            return {}, facts | {"executed": False, "reason": "not run: found no g++ or clang++"}
        ran = {"executed": True, "device": "the processor", "compiler": compiler}
        return {}, facts | ran | {"errors": {"coefficients": _error(net, files, points())}}

    facts = dict(job.store.make("cuda", inputs, make).facts)
    if facts["executed"]:
        error = facts["errors"]["coefficients"] | {"bound": verify.TOLERANCE}
        facts["errors"] = {"coefficients": error}
        _refuse(error, facts["compiler"])
    return facts, files


def _error(net: NetSpec, files: Mapping[str, bytes], points: Points) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        library = cuda_host.build(files[cuda_file.SOURCE].decode(), Path(folder) / "kernels.so")
        buffer = np.frombuffer(files[cuda_file.PARAMETERS], "<f4").astype(np.float32)
        run = cuda_host.HostKernels(net, library, buffer)
        found = run.transfer(points.positions, points.normals, points.uv)
    return error_of(found - points.evaluated(net))


def _refuse(error: Mapping[str, float], compiler: str) -> None:
    if not error["max"] <= error["bound"]:
        raise PrtnetError(
            f"export: the CUDA kernel, compiled by {compiler}: found an error of {error['max']:.2g} in a coefficient, "
            f"expected at most {error['bound']:.2g}; nothing was exported. Try another compiler, or export.cuda=false"
        )
