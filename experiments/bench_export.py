"""Speed of exported shaders on the software driver, for `bench.py`: one thread, frames of a full screen.

Each row is a process of its own, so that nothing is compiled yet; "from the cache" is the same process again on the
shader cache that the first has left. Times are CPU-seconds, as the machine may have other work.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bench_plants
import numpy as np

from prtnet import sh
from prtnet.encoding import encoded_size
from prtnet.netspec import NetSpec

BANDS, FREQUENCIES = 5, (6, 2)
Row = dict[str, str | float]


def export() -> list[Row]:
    """Literals against torch and against the folded light, first draws, weight textures; then trained nets on plants,
    and the page."""
    with tempfile.TemporaryDirectory() as cache:
        rows = _of("literals", "speed", 32, 2, cache)
        rows += _of("folded light", "folding", 32, 2, cache)
        for state in ("cold", "from the cache"):
            rows += _of(f"literals, {state}", "first", 64, 4, cache)
    for width in (64, 128, 256):
        with tempfile.TemporaryDirectory() as cache:
            rows += _of("weight texture, cold", "texture", width, 4, cache)
    return rows + bench_plants.decoders() + bench_plants.page()


def _of(what: str, part: str, width: int, depth: int, cache: str) -> list[Row]:
    """One of `PARTS` in a process with a shader cache and a thread of its own."""
    environment = os.environ | {"MESA_SHADER_CACHE_DIR": cache, "LP_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, __file__, part, str(width), str(depth)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    scene = f"{what}, k={width},l={depth}"
    return [{"scene": scene, "what": each, "value": value} for each, value in found.items()]


def _net(width: int, depth: int) -> NetSpec:
    """Of the default recipe's kind, without grids; what the weights are does not change the time."""
    rng = np.random.default_rng(0)
    sizes = [encoded_size(*FREQUENCIES), *[width] * depth, sh.count(BANDS)]
    pairs = list(zip(sizes[1:], sizes, strict=False))
    weights = tuple((rng.normal(size=pair) * np.sqrt(2 / pair[1])).astype(np.float32) for pair in pairs)
    biases = tuple((0.1 * rng.normal(size=rows)).astype(np.float32) for rows, _ in pairs)
    return NetSpec(weights, biases, *FREQUENCIES, activation="hard_gelu", output="linear", bands=BANDS)


def _points(size: int) -> tuple[np.ndarray, np.ndarray]:
    from prtnet.render import verify

    return verify.random_points(size * size, np.random.default_rng(1))


def _cpu(work: Callable[[], object], repeats: int) -> list[float]:
    """CPU-milliseconds of each of some runs after one to warm up."""
    from prtnet import gl

    work()
    taken = []
    for _ in range(repeats):
        gl.context().finish()
        started = time.process_time()
        work()
        gl.context().finish()
        taken.append(1000 * (time.process_time() - started))
    return taken


def _speed(net: NetSpec) -> dict[str, float]:
    """A frame of all coefficients by literals, and the same points by torch, in turns."""
    import torch

    from prtnet.export import glsl
    from prtnet.models.inference import Inference
    from prtnet.render import verify

    torch.set_num_threads(1)
    positions, normals = _points(512)
    (drawn,) = verify.passes(net, glsl.emit(net), verify.textures(net, positions, normals))
    module = Inference(net)
    pairs = [(*_cpu(drawn.draw, 1), *_cpu(lambda: module(positions, normals), 1)) for _ in range(5)]
    shader, ours = np.median(np.array(pairs), axis=0)
    ratio = float(np.median([there / here for here, there in pairs]))
    name = "512^2, CPU-ms"
    return {f"GLSL {name}": float(shader), f"torch {name}": float(ours), "torch / GLSL": ratio}


def _folding(net: NetSpec) -> dict[str, float]:
    """A frame of diffuse shading with the light folded into the last layer, and without, in turns."""
    from prtnet.export import bundle, fold, shading
    from prtnet.export.form import Form
    from prtnet.render import verify
    from prtnet.render.pixelwise import Pass

    made, light = bundle.bundle(net, Form()), np.random.default_rng(2).normal(size=(BANDS**2, 3))
    textures = verify.textures(net, *_points(512))
    known: dict[str, Any] = {"albedo": (1.0, 1.0, 1.0), "prt_light": light}
    plain = Pass(shading.around(net, made.transfer + made.shading), textures, known)
    assert made.irradiance
    folded = Pass(shading.around(net, made.irradiance), textures, known | fold.uniforms(net, light))
    pairs = [(*_cpu(plain.draw, 1), *_cpu(folded.draw, 1)) for _ in range(9)]
    ratio = float(np.median([first / second for first, second in pairs]))
    before, after = np.median(np.array(pairs), axis=0)
    return {"diffuse 512^2, CPU-ms": float(before), "the same, folded": float(after), "gain of folding": ratio}


def _first(net: NetSpec, storage: str = "literal") -> dict[str, float]:
    from prtnet.export import glsl, weight_texture
    from prtnet.render import verify

    weights = weight_texture.texels(net) if storage == "texture" else None
    textures = verify.textures(net, *_points(128), weights)
    (drawn,) = verify.passes(net, glsl.emit(net, storage=storage), textures)
    frame = float(np.median(_cpu(drawn.draw, 1 if weights is not None else 5)))
    return {"first draw, CPU-s": drawn.first_draw, "128^2, CPU-ms": frame}


PARTS: dict[str, Callable[[NetSpec], dict[str, float]]] = {
    "speed": _speed,
    "folding": _folding,
    "first": _first,
    "texture": lambda net: _first(net, "texture"),
}


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    print(json.dumps(PARTS[sys.argv[1]](_net(int(sys.argv[2]), int(sys.argv[3])))))
