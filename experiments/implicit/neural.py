"""Signed distances of meshes in small networks: the error of the surface, and pictures of both side by side.

    python experiments/implicit/neural.py FOLDER MESH...

writes FOLDER/neural_sdf.csv and, per mesh, FOLDER/neural_NAME.png: the mesh, then each network.
"""

import csv
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from prtnet.config import SdfOptions
from prtnet.data import scene
from prtnet.data.implicit import march
from prtnet.data.implicit.field import Field
from prtnet.data.tracer import Tracer
from prtnet.pipeline.neural_sdf import implicit_of_mesh
from prtnet.store import Store

WIDTHS = (32, 64)
SIZE = 384
LIGHT = np.array([0.5, 0.7, 0.5]) / np.linalg.norm([0.5, 0.7, 0.5])
COLUMNS = (
    "mesh", "width", "depth", "parameters", "chamfer", "worst", "to_mesh", "from_mesh", "to_mesh_worst",
    "from_mesh_worst", "deviation", "deviating", "wrong_sign", "lipschitz", "cpu_seconds",
)  # fmt: skip


def rays() -> tuple[np.ndarray, np.ndarray]:
    """A parallel view from the front right, above."""
    forward = -np.array([0.75, 0.4, 1.0]) / np.linalg.norm([0.75, 0.4, 1.0])
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    x, y = np.meshgrid(*[(np.arange(SIZE) + 0.5) / SIZE * 2.7 - 1.35] * 2)
    origins = x[..., None] * right - y[..., None] * np.cross(right, forward) - 3 * forward
    return origins.reshape(-1, 3), np.broadcast_to(forward, (SIZE * SIZE, 3))


def shaded(normals: np.ndarray) -> np.ndarray:
    """Grey by the angle to the light, white where there is nothing."""
    value = 0.15 + 0.75 * np.maximum(normals @ LIGHT, 0)
    value[~normals.any(axis=1)] = 1
    return (255 * value.reshape(SIZE, SIZE) ** (1 / 2.2)).astype(np.uint8)


def of_mesh(mesh: scene.Scene) -> np.ndarray:
    face, _, _ = Tracer(mesh).hits(*rays())
    return shaded(np.where(face[:, None] < 0, 0, mesh.face_normals[face]))


def of_field(field: Field) -> np.ndarray:
    _, normals, _ = march.MarchTracer(field).hits(*rays())
    return shaded(normals.astype(np.float64))


def main() -> None:
    folder, files = Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]]
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for file in files:
        mesh = scene.load(file)
        shown = [of_mesh(mesh.centred())]
        for width in WIDTHS:
            made = implicit_of_mesh(mesh, SdfOptions(width=width), Store(folder / "cache"))
            count = sum(array.size for array in (*made.implicit.field.weights, *made.implicit.field.biases))  # pyright: ignore
            rows.append({"mesh": mesh.name, "width": width, "depth": 2, "parameters": count, **made.facts})
            print(rows[-1], flush=True)
            shown.append(of_field(made.implicit.field))
        Image.fromarray(np.concatenate(shown, axis=1)).save(folder / f"neural_{mesh.name}.png")
    with (folder / "neural_sdf.csv").open("w", newline="") as out:
        writer = csv.DictWriter(out, COLUMNS)
        writer.writeheader()
        for row in rows:
            writer.writerow({key: f"{value:.4g}" if isinstance(value, float) else value for key, value in row.items()})


if __name__ == "__main__":
    main()
