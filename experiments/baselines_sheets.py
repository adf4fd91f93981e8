"""Contact sheets of what the baselines can do: one JPEG per feature in experiments/results/baselines/.

    python experiments/baselines_sheets.py [runs/baselines_sheets]

Small runs of the ordinary pipeline, whose pictures are laid side by side. Each picture has the exposure of its own run.
With PRTNET_ASSETS the sheet of lights has a light probe, too.
"""

import os
import sys
from pathlib import Path

import numpy as np
import trimesh
from hydra import compose, initialize_config_dir
from matplotlib import get_data_path
from omegaconf import OmegaConf
from PIL import Image, ImageDraw, ImageFont

from prtnet import cli, config, pipeline

RESULTS = Path(__file__).parent / "results" / "baselines"
CELL, CAPTION = 288, 26
SMALL = [
    "methods=[texture,vertex]",
    "transfer.directions=256",
    "atlas.size=512",
    "render.size=288",
    "render.views=2",
    "render.traced_directions=1024",
    "render.pictures=true",
]
# a caption, the keys of a run, and the method that is shown
Cell = tuple[str, str, str]

SHEETS: dict[str, list[Cell]] = {
    "gloss": [
        ("diffuse, texture", "scene=tea_set", "texture"),
        ("fixed light (TPFL), texture", "scene=tea_set material=glossy", "texture"),
        ("triple product (TP), texture", "scene=tea_set material=glossy_full", "texture"),
        ("TP, vertex", "scene=tea_set_fine material=glossy_full", "vertex"),
        ("glossy, traced", "scene=tea_set material=glossy", "traced"),
    ],
    "vertex": [
        ("vertex, the ground two triangles", "scene=plants", "vertex"),
        ("vertex, ground cut 4 times", "scene=plants vertex.subdivide=[ground] vertex.level=4", "vertex"),
        ("vertex, ground cut 7 times", "scene=plants vertex.subdivide=[ground] vertex.level=7", "vertex"),
        ("texture", "scene=plants", "texture"),
        ("traced", "scene=plants", "traced"),
    ],
    "bounces": [
        ("no bounce, texture", "scene=room_fine", "texture"),
        ("one, texture", "scene=room_fine transfer.transport=interreflected", "texture"),
        ("one, vertex", "scene=room_fine transfer.transport=interreflected", "vertex"),
        ("one, traced", "scene=room_fine transfer.transport=interreflected", "traced"),
        ("three, texture", "scene=room_fine transfer.transport=interreflected transfer.bounces=3", "texture"),
    ],
    "mipmaps": [
        ("far away: no levels", "scene=tea_set render.size=48 atlas.size=1024 atlas.padding=4", "texture"),
        ("mip levels", "scene=tea_set render.size=48 atlas.size=1024 atlas.mipmaps=true", "texture"),
        (
            "mip levels, by distance",
            "scene=tea_set render.size=48 atlas.size=1024 atlas.mipmaps=true atlas.level_of_detail=distance",
            "texture",
        ),
        ("traced at pixel centres", "scene=tea_set render.size=48 atlas.size=1024", "traced"),
    ],
    "normal_map": [
        ("without, texture", "scene.path={tile} material=glossy light=sun light.window=hann", "texture"),
        ("normal map, texture", "scene.path={studs} material=glossy light=sun light.window=hann", "texture"),
        ("normal map, traced", "scene.path={studs} material=glossy light=sun light.window=hann", "traced"),
    ],
    "lights": [
        ("sky", "scene=plants", "texture"),
        ("green", "scene=plants light=green", "texture"),
        ("sun, Hann window", "scene=plants light=sun light.window=hann", "texture"),
        ("gradient", "scene=plants light=gradient", "texture"),
    ],
}


def tile(folder: Path, name: str, studs: bool) -> Path:
    """A slab with a box on it, as GLB with texture coordinates; its top carries a normal map of studs, or none."""
    parts = trimesh.Scene()
    for part, size, height in (("slab", (2.0, 0.2, 2.0), -0.1), ("box", (0.5, 0.6, 0.5), 0.3)):
        box = trimesh.creation.box(size).process()
        corners = box.triangles.reshape(-1, 3) + np.array([0, height, 0])
        mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
        # each face of the box lies in a cell of its own
        axis = np.abs(mesh.face_normals).argmax(axis=1)
        cell = 2 * axis + (mesh.face_normals[np.arange(12), axis] > 0)
        flat = np.stack([np.delete(t, a, axis=1) for t, a in zip(box.triangles / max(size) + 0.5, axis, strict=True)])
        uv = (flat * 0.9 + 0.05 + np.stack([cell % 3, cell // 3], axis=1)[:, None]) / 3
        material = trimesh.visual.material.PBRMaterial(name=part, baseColorFactor=[200, 190, 170, 255])
        if studs and part == "slab":
            material.normalTexture = Image.fromarray(_studs(768))
        mesh.visual = trimesh.visual.TextureVisuals(uv=uv.reshape(-1, 2), material=material)
        parts.add_geometry(mesh, node_name=part, geom_name=part)
    path = folder / f"{name}.glb"
    parts.export(path)
    return path


def _studs(size: int, across: int = 24) -> np.ndarray:
    """A tangent-space normal map of round studs, green up the image."""
    place = (np.arange(size) + 0.5) / size * across % 1 * 2 - 1
    x, y = np.meshgrid(place, -place)
    inside = x * x + y * y < 0.6
    normal = np.stack([np.where(inside, 0.9 * x, 0), np.where(inside, 0.9 * y, 0)], axis=-1)
    up = np.sqrt(1 - np.sum(normal**2, axis=-1, keepdims=True))
    return np.rint(255 * (np.concatenate([normal, up], axis=-1) + 1) / 2).astype(np.uint8)


def picture(base: Path, keys: str, method: str) -> Image.Image:
    """The first view of a method in a run of these keys, made where it is missing."""
    name = "".join(letter if letter.isalnum() else "_" for letter in keys.replace(str(base), ""))
    out = base / name
    arguments = [*SMALL, *keys.split(), f"out={out}", f"cache={base / 'cache'}"]
    made = OmegaConf.to_object(compose("config", overrides=arguments))
    assert isinstance(made, config.Config)
    pipeline.run(made, f"prtnet {keys}")
    with Image.open(out / "pictures" / f"{method}.png") as found:
        return found.convert("RGB").resize((CELL, CELL), Image.Resampling.NEAREST)


def sheet(name: str, cells: list[Cell], base: Path) -> None:
    """Write one JPEG of pictures with their captions."""
    font = ImageFont.truetype(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", 14)
    whole = Image.new("RGB", (len(cells) * (CELL + 6) + 6, CELL + CAPTION + 6), (22, 24, 29))
    pen = ImageDraw.Draw(whole)
    for index, (caption, keys, method) in enumerate(cells):
        left = 6 + index * (CELL + 6)
        whole.paste(picture(base, keys, method), (left, 6))
        pen.text((left, CELL + 10), caption, (236, 238, 242), font)
    whole.save(RESULTS / f"{name}.jpg", quality=85)
    print(RESULTS / f"{name}.jpg", flush=True)


def main(base: Path) -> None:
    RESULTS.mkdir(parents=True, exist_ok=True)
    assets = os.environ.get("PRTNET_ASSETS")
    if assets:
        probe = Path(assets) / "envmaps" / "venice.exr"
        SHEETS["lights"].append(("Poly Haven's venice", f"scene=plants light.path={probe.absolute()}", "texture"))
    config.register()
    base.mkdir(parents=True, exist_ok=True)
    files = {name: str(tile(base, name, name == "studs")) for name in ("tile", "studs")}
    with initialize_config_dir(str(cli.config_folder()), version_base="1.3"):
        for name, cells in SHEETS.items():
            sheet(name, [(caption, keys.format(**files), method) for caption, keys, method in cells], base)


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "runs/baselines_sheets"))
