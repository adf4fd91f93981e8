"""A net in GLSL against CUDA inside of OpenGL, on a GPU: `./run gpu-check` prints it.

    python experiments/bench_interop.py [--size 1024]

Nets of the default recipe with weights at random, which take as long as trained ones; diffuse, five bands, `plants`.
GLSL has its weights as an export would, as literals in small nets, and in a texture above 20 000 multiply-adds.
"""

import argparse
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch

from prtnet import PrtnetError, gl, netspec
from prtnet.data import atlas, builtin, light
from prtnet.data.tracer import Tracer
from prtnet.export import cuda_build, glsl, limits, weight_texture
from prtnet.export.form import Form
from prtnet.models.device_net import DeviceNet
from prtnet.models.mlp import Mlp
from prtnet.models.recipe import ModelOptions, TrainOptions
from prtnet.netspec import NetSpec
from prtnet.render import camera
from prtnet.render.cuda_device import Build, Device
from prtnet.render.interop import STAGES, CudaNetMethod
from prtnet.render.method import NetMethod
from prtnet.render.raster import Raster

BANDS = 5


class Row(NamedTuple):
    """Milliseconds of a frame, and of the stages of the fused kernel's; None where it was refused or left out."""

    width: int
    macs: int
    storage: str  # of the weights in GLSL
    glsl: float | None
    kernel: float
    torch: float | None
    stages: dict[str, float]


def rows(
    device: Device,
    *,
    widths: Sequence[int] = (64, 128, 256, 512),
    depth: int = 4,
    size: int = 1024,
    build: Build = cuda_build.cubin,
    torch_too: bool = True,
) -> list[Row]:
    """One for each width, on the same view."""
    scene = builtin.make("plants")
    drawing = Raster(atlas.make(scene, size=256), size)
    view = camera.path(drawing.scene, Tracer(drawing.scene), 1)[0]
    sky = light.project(light.sky(), BANDS)
    made = []
    for width in widths:
        net, by_torch = _net(width, depth), None
        kernel = CudaNetMethod(drawing, net, device=device, build=build)
        whole, stages = kernel.milliseconds(view, sky), kernel.median_stages(view)
        if torch_too:
            method = CudaNetMethod(drawing, net, device=device, build=build, network=DeviceNet(net))
            by_torch = method.milliseconds(view, sky)
        form = Form().of(net)
        in_glsl = _in_glsl(drawing, net, form, view, sky)
        made.append(Row(width, netspec.macs(net), form.storage, in_glsl, whole, by_torch, stages))
    return made


def _net(width: int, depth: int) -> NetSpec:
    model = ModelOptions(width=width, depth=depth)
    return Mlp(model, TrainOptions(), BANDS, torch.Generator().manual_seed(0)).spec()


def _in_glsl(drawing: Raster, net: NetSpec, form: Form, view: camera.Camera, sky: np.ndarray) -> float | None:
    try:
        function = glsl.transfer(net, form, limits.of_driver(gl.context().info))
    except PrtnetError:
        return None
    weights = weight_texture.texels(net) if form.storage == "texture" else None
    return NetMethod(drawing, function, grids=net.grids, hashes=net.hashes, weights=weights).milliseconds(view, sky)


def table(made: Sequence[Row]) -> str:
    """Markdown."""
    lines = ["| k | multiply-adds | weights in GLSL | GLSL ms | CUDA ms | with torch ms | " + " | ".join(STAGES) + " |"]
    lines += ["|" + "---|" * (6 + len(STAGES))]
    for row in made:
        times = [row.kernel, row.torch, *row.stages.values()]
        cells = [_words(row.glsl, "refused"), *(_words(each, "-") for each in times)]
        lines.append(f"| {row.width} | {row.macs} | {row.storage} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _words(milliseconds: float | None, otherwise: str) -> str:
    return otherwise if milliseconds is None else f"{milliseconds:.3g}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=1024, help="pixels along a side")
    size = parser.parse_args().size
    try:
        device = Device()
        print(f"{device.name}, {size} x {size}, milliseconds of a frame and of the stages with the fused kernel:\n")
        print(table(rows(device, size=size)))
    except PrtnetError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
