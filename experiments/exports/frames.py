"""What a frame takes by the net and by the texture of one run, in CPU time and in turns.

    python experiments/exports/frames.py runs/exports [SIZE]

writes frames.json into every point of a sweep, for frames of its own size or of SIZE^2, which `report.py` then takes
into its table. Scores time frames by a clock, and are wrong where a machine has other work; the CPU time of the drawing
threads is not.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from omegaconf import OmegaConf

from prtnet import gl, store
from prtnet.config import Config
from prtnet.export import certificate
from prtnet.pipeline.bake import bake
from prtnet.pipeline.export import export
from prtnet.pipeline.job import open_job
from prtnet.pipeline.methods import make_all
from prtnet.pipeline.train import train
from prtnet.render import camera
from prtnet.render.method import Shaded
from prtnet.render.raster import Raster

NAME = "frames.json"
PAIRS = 5


def measure(point: Path, size: int | None = None) -> dict[str, float]:
    """CPU-milliseconds of the first view by `net` and by `texture`, medians, and the median of their ratio. `size`:
    pixels along one side, those of the run when left out. What the run has baked and trained is found in its cache."""
    options = yaml.safe_load((point / "config.yaml").read_text(encoding="utf-8")) | {"out": str(point.parent)}
    config = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(Config), options))
    assert isinstance(config, Config)
    job = open_job(config, "", point.name)
    baked = bake(job)
    assert baked.points is not None
    trained = train(job, baked.points)
    size = size or config.render.size
    methods = make_all(job, baked, trained, export(job, baked, trained), Raster(baked.texture.atlas, size))
    eye = camera.path(job.scene, job.tracer, config.render.views, kind=config.scene.camera)[0]
    bands, _ = job.material.orders(config.transfer.bands)
    light = job.light.coefficients(bands)
    pairs = [[_milliseconds(methods[name].shaded, eye, light) for name in ("net", "texture")] for _ in range(PAIRS + 1)]
    taken = np.array(pairs[1:])  # the first of each compiles
    net, texture = map(float, np.median(taken, axis=0))
    return {"size": size, "net": net, "texture": texture, "ratio": float(np.median(taken[:, 0] / taken[:, 1]))}


def _milliseconds(method: Shaded, eye: camera.Camera, light: Any) -> float:
    method.set_light(light)
    gl.context().finish()
    started = time.process_time()
    method.render(eye)
    gl.context().finish()
    return 1000 * (time.process_time() - started)


def main(sweep: Path, size: int | None = None) -> None:
    for path in sorted(sweep.glob(f"*/{certificate.NAME}")):
        found = measure(path.parent, size)
        store.write_text(path.parent / NAME, json.dumps(found) + "\n")
        print(path.parent.name, found, flush=True)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
