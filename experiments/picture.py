"""The picture of README's section on materials and bounces: one view by every method and reference.

    python experiments/picture.py [--size 256]

Diffuse and glossy, without a bounce and with one; written to docs/images/methods.jpg. About ten minutes.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from prtnet.chart import sheet
from prtnet.config import Config
from prtnet.pipeline import run

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "images" / "methods.jpg"
COLUMNS = ("vertex", "texture", "lit_texture", "traced", "exact")
CUT = ["walls", "floor", "ceiling", "rug", "frames"]
GLOSS = {"vase": 40.0, "bowl": 40.0, "tables": 12.0, "sofa": 8.0, "sofa_cushions": 8.0, "globe": 40.0, "pot": 20.0}


def config(size: int, glossy: bool, bounces: int) -> Config:
    made = Config()
    made.scene.name, made.cache = "room", str(ROOT / "runs" / "cache")
    made.out = str(ROOT / "runs" / "picture" / f"{'glossy' if glossy else 'diffuse'}_{bounces}")
    made.methods = ["texture", "vertex"] + ["lit_texture"] * (bounces > 0)
    made.vertex.subdivide, made.vertex.level = CUT, 5
    made.transfer.transport, made.transfer.directions = "interreflected" if bounces else "shadowed", 1024
    made.render.size, made.render.views, made.render.pictures = size, 2, True
    made.render.exact_views, made.render.exact_samples = 1, 512
    if glossy:
        made.material.parts = {name: {"specular": [0.35] * 3, "exponent": value} for name, value in GLOSS.items()}
    return made


def shown(folder: Path) -> list[np.ndarray | None]:
    found = []
    for name in COLUMNS:
        path = folder / "pictures" / f"{name}.png"
        found.append(np.asarray(Image.open(path).convert("RGB"), np.float32) / 255 if path.exists() else None)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=256, help="pixels along one side of a picture")
    size = parser.parse_args().size
    rows = {}
    for glossy in (False, True):
        for bounces in (0, 1):
            made = config(size, glossy, bounces)
            run(made, "python experiments/picture.py")
            what = "glossy" if glossy else "diffuse"
            rows[f"{what}, {'one bounce' if bounces else 'no bounce'}"] = shown(Path(str(made.out)))
    sheet.grid(PICTURE, rows, COLUMNS, title="room: one view by every method and reference", cell=size)


if __name__ == "__main__":
    main()
