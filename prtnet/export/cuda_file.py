"""The CUDA kernels of a net as files, for programs that are not prtnet (docs/cuda.md):

transfer.cu        the kernels of `prtnet.export.cuda` below the macros of this net
transfer_cuda.bin  their buffer of parameters: little-endian float32
"""

import numpy as np

from prtnet import netspec
from prtnet.export import cuda, form
from prtnet.netspec import NetSpec

SOURCE, PARAMETERS = "transfer.cu", "transfer_cuda.bin"
NAMES = (SOURCE, PARAMETERS)


def files(net: NetSpec) -> dict[str, bytes]:
    """By name. Raises PrtnetError for a net that has no room on a GPU's multiprocessor."""
    buffer = cuda.parameters(net)
    text = "\n".join([*_header(net, len(buffer)), cuda.source(net)])
    return {SOURCE: text.encode(), PARAMETERS: np.asarray(buffer, "<f4").tobytes()}


def _header(net: NetSpec, size: int) -> list[str]:
    sizes = " -> ".join(map(str, form.sizes_of(net)))
    centre = ", ".join(repr(float(value)) for value in net.centre)
    lines = [
        f"// Precomputed radiance transfer by a small network: {sizes}, {netspec.macs(net)} multiply-adds.",
        f"// position: centred, (file position - ({centre})) * {float(net.scale)!r} in float64",
        "// normal: unit, in world space" + ("; uv: in [0, 1]^2, in the atlas, v up" if net.texels else ""),
        f"// parameters: the {size} floats of {PARAMETERS}, on 16 bytes",
        "//",
        "// kernel, threads of a block, points (pixels of prt_pack) of a block; each takes the structure before it:",
    ]
    names = cuda.ARGUMENTS
    return lines + [f"//   {name:<13}{cuda.threads(name):>4}{cuda.points_per_block(net, name):>5}" for name in names]
