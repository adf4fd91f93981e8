"""Frames of data-driven transfer beside direct shading alone: `python -m experiments.bench_data_driven [TEXELS]`.

CPU time of all threads, so of use where the driver draws on processors (llvmpipe); the least of some frames drawn in
turns, so that a busy machine slows all alike. The basis is random: no value changes the cost.
"""

import sys
import time

import numpy as np

from prtnet import gl
from prtnet.data import atlas, builtin, measurement, texture
from prtnet.data.atlas import Atlas
from prtnet.data.lighting.lamp import Lamp, Lighting
from prtnet.data.scene import Scene
from prtnet.data_driven import DataDriven
from prtnet.render.camera import Camera
from prtnet.render.data_driven import DataDrivenMethod
from prtnet.render.lamps import LampMethod
from prtnet.render.raster import Raster
from prtnet.render.shadow_maps import ShadowMaps

SIZE, FRAMES = 512, 12
EYE = Camera((0.0, 0.0, 3.4), (0.0, 0.0, 0.0), fov_y=42.0, near=0.1, far=10.0)
LAMPS = {
    "spot": Lamp("spot", (1, 1, 1), (0.1, 0.7, 0.1), (0, -1, 0), 25, 40),
    "point": Lamp("point", (1, 1, 1), (0.1, 0.5, 0.1)),
    "sun": Lamp("directional", (1, 1, 1), aim=(0, -0.8, -0.6)),
}
KINDS = {
    "4 elements": (4, 1, "block"),
    "16 elements": (16, 1, "block"),
    "16, u as uniforms": (16, 1, "uniform"),
    "16, u fetched at each pixel": (16, 1, "texture"),
    "16, a bank for each colour": (16, 3, "block"),
    "32 elements": (32, 1, "block"),
    "64 elements": (64, 1, "block"),
}


def spec_of(scene: Scene, mapped: Atlas, texels: int, elements: int, banks: int) -> DataDriven:
    """Any basis and matrix for 256 points x 8."""
    rng = np.random.default_rng(0)
    points = measurement.on_surface(scene, 256, 8, rng)
    index = texture.gbuffer(mapped, texels).index.astype(np.int32)
    basis = rng.normal(size=(banks, elements, len(index))).astype(np.float32) / np.sqrt(len(index))
    matrices = rng.normal(size=(1, banks, elements, points.count)).astype(np.float32)
    return DataDriven(basis.astype(np.float32), matrices, (points,), index, texels, scene.digest())


def frame(method: LampMethod | DataDrivenMethod, light: Lighting, moving: bool) -> float:
    """CPU milliseconds."""
    method.set_lighting(light)
    gl.context().finish()
    start = time.process_time()
    if moving:
        method.shadows.draw(light, again=True)
        if isinstance(method, DataDrivenMethod):
            method.operator.reduce(_measured(method, light))
    method.render(EYE)
    gl.context().finish()
    return 1000 * (time.process_time() - start)


def _measured(method: DataDrivenMethod, light: Lighting):
    points = method.measure()
    points.draw(light)
    return points.texture


def main(texels: int) -> None:
    scene = builtin.make("cornell").centred()
    mapped = atlas.make(scene, size=texels)
    raster, shadows = Raster(mapped, SIZE), ShadowMaps(scene)
    methods: dict[str, LampMethod | DataDrivenMethod] = {"direct": LampMethod(raster, shadows=shadows)}
    for name, (elements, banks, held) in KINDS.items():
        spec = spec_of(scene, mapped, texels, elements, banks)
        methods[name] = DataDrivenMethod(raster, spec, shadows=shadows, held=held)
    best: dict[tuple[str, str, bool], float] = {}
    for _ in range(FRAMES + 1):
        for lamp, moving in ((lamp, moving) for lamp in LAMPS for moving in (False, True)):
            for name, method in methods.items():
                taken = frame(method, Lighting((LAMPS[lamp],)), moving)
                key = name, lamp, moving
                best[key] = min(best.get(key, np.inf), taken)
    columns = [(lamp, moving) for lamp in LAMPS for moving in (False, True)]
    print("| |", " | ".join(f"{lamp}, {'moving' if moving else 'still'}" for lamp, moving in columns), "|")
    print("|---" * (1 + len(columns)) + "|")
    for name in methods:
        found = [(best[name, *column], best["direct", *column]) for column in columns]
        cells = [f"{one:.1f} ms" if name == "direct" else f"{one / direct:.2f} x" for one, direct in found]
        print("|", " | ".join([name, *cells]), "|")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 256)
