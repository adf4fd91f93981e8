"""Transfer textures seen from far away, in bytes and in sets: the tables of experiments/texture.md, made again.

    python experiments/texture.py [distant] [kept]

References have 256 rays per pixel: `traced` at the pixel's centre, and `8 x 8`, the mean over 64 points of each pixel.
Only pixels all of whose points show one part are compared, for no texture can mend the outlines of triangles.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from prtnet import score
from prtnet.data import atlas, atlas_set, builtin, light, texture, transfer
from prtnet.data.atlas import Atlas
from prtnet.data.scene import Scene
from prtnet.data.texture import Page, Texels
from prtnet.data.tracer import Tracer
from prtnet.render import camera
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import shade
from prtnet.render.method import TextureMethod
from prtnet.render.raster import Raster
from prtnet.render.transfer_map import LEVELS_OF_DETAIL

PAGE = Path(__file__).with_name("texture.md")
BANDS, DIRECTIONS, VIEWS, SIZE, POINTS = 5, 256, 3, 64, 8
SCENES, DISTANCES, TEXTURE = ("plants", "tea_set", "room"), (1, 2), 1024
Array = np.ndarray
Baked = tuple[Atlas, list[Texels], list[Array]]


def baked(scene: Scene, tracer: Tracer, *, sets: str = "one", padding: int = 1, size: int = TEXTURE) -> Baked:
    options = {"single_chart": False, "unwrap_mode": "auto", "padding": padding}
    made = (atlas_set if sets == "parts" else atlas).make(scene, size=size, **options)
    texels = texture.gbuffers(made, size)
    points, rng = texture.points(texels), np.random.default_rng(0)
    values = transfer.bake(
        tracer, points.positions, points.normals, bands=BANDS, directions=DIRECTIONS, rng=rng,
        geometric_normals=points.geometric_normals,
    )  # fmt: skip
    return made, texels, np.split(values, np.cumsum([len(page.index) for page in texels])[:-1])


def pages_of(found: Baked, levels: int) -> list[Page]:
    return [texture.page(page, part, levels=levels) for page, part in zip(found[1], found[2], strict=True)]


def eyes(scene: Scene, tracer: Tracer, times: float) -> list[Camera]:
    """The scene's own path, `times` as far from what it looks at, but for rooms, which are seen from inside."""
    path = camera.path(scene, tracer, VIEWS)
    if scene.camera == "inside":
        return path
    moved = []
    for eye in path:
        away = np.array(eye.target) + times * (np.array(eye.eye) - np.array(eye.target))
        moved.append(replace(eye, eye=tuple(away.tolist()), far=eye.far * times))
    return moved


def references(scene: Scene, made: Atlas, tracer: Tracer, eye: Camera, sky: Array) -> tuple[Array, Array, Array]:
    """(traced at pixel centres, traced at 8 x 8 points of each pixel, pixels that show one part alone)."""
    images = []
    for size in (SIZE, SIZE * POINTS):
        found = Raster(made, size).gbuffer(eye)
        values = transfer.bake(
            tracer, found.positions.astype(np.float64), found.normals, bands=BANDS, directions=DIRECTIONS,
            rng=np.random.default_rng(1), geometric_normals=found.geometric_normals,
        )  # fmt: skip
        images.append(shade(found, values, sky))
    part = np.full((SIZE * POINTS) ** 2, -1)
    part[found.pixel] = made.scene.part[found.face]
    cells = part.reshape(SIZE, POINTS, SIZE, POINTS).swapaxes(1, 2).reshape(SIZE, SIZE, -1)
    alone = (cells[..., 0] >= 0) & (cells == cells[..., :1]).all(axis=-1)
    fine = images[1].reshape(SIZE, POINTS, SIZE, POINTS, 3).mean(axis=(1, 3))
    return images[0], fine, alone


def distant(name: str) -> list[str]:
    """Rows of the first table: mip levels against none, by both rules."""
    scene = builtin.make(name).centred()
    tracer, sky, rows = Tracer(scene), light.by_name("sky").coefficients(BANDS), []
    near, wide, wider = (baked(scene, tracer, padding=padding) for padding in (1, 4, 8))
    for times in DISTANCES if scene.camera != "inside" else (1,):
        path = eyes(scene, tracer, times)
        views = [references(scene, near[0], tracer, eye, sky) for eye in path]
        choices = [("bilinear, padding 1", near, 1, "derivative")]
        choices += [(f"3 levels, padding 4, {rule}", wide, 3, rule) for rule in LEVELS_OF_DETAIL]
        choices += [(f"4 levels, padding 8, {rule}", wider, 4, rule) for rule in LEVELS_OF_DETAIL]
        choices += [(f"all levels, padding 1, {rule}", near, 11, rule) for rule in LEVELS_OF_DETAIL]
        for label, found, levels, rule in choices:
            drawing = Raster(found[0], SIZE)
            method = TextureMethod(drawing, pages_of(found, levels), level_of_detail=rule)
            images = [method.draw(eye, sky) for eye in path]
            figures = [measured(images, views, which) for which in (0, 1)]
            rows.append(f"| {name} | {times} | {label} | " + " | ".join(f"{x:.1f}" for x in figures) + " |")
        own = measured([view[0] for view in views], views, 1)
        rows.append(f"| {name} | {times} | `traced` itself | | {own:.1f} |")
    return rows


def measured(images: list[Array], views: list[tuple[Array, Array, Array]], which: int) -> float:
    """Mean PSNR of tone-mapped images on the chosen pixels of each view."""
    exposure = score.exposure([view[1] for view in views], [view[2] for view in views])
    shown = [score.tone_map(image, exposure) for image in images]
    wanted = [score.tone_map(view[which], exposure) for view in views]
    return float(np.mean([score.psnr(s, w, view[2]) for s, w, view in zip(shown, wanted, views, strict=True)]))


def kept(name: str) -> list[str]:
    """Rows of the second table: formats and sets at 256^2, against `traced` at pixel centres of 256^2 frames."""
    scene = builtin.make(name).centred()
    tracer, sky, rows = Tracer(scene), light.by_name("sky").coefficients(BANDS), []
    path, size = camera.path(scene, tracer, VIEWS), 256
    for sets in atlas_set.SETS:
        found = baked(scene, tracer, sets=sets, size=512)
        drawing, pages = Raster(found[0], size), pages_of(found, 1)
        views = []
        for eye in path:
            seen = drawing.gbuffer(eye)
            values = transfer.bake(
                tracer, seen.positions.astype(np.float64), seen.normals, bands=BANDS, directions=DIRECTIONS,
                rng=np.random.default_rng(1), geometric_normals=seen.geometric_normals,
            )  # fmt: skip
            covered = np.isin(np.arange(size * size), seen.pixel).reshape(size, size)
            views.append((shade(seen, values, sky), shade(seen, values, sky), covered))
        used = sum(len(page.index) for page in found[1]) / sum(page.size**2 for page in found[1])
        plain = [TextureMethod(drawing, pages).draw(eye, sky) for eye in path]
        for texels in ("float32", "float16", "uint8"):
            method = TextureMethod(drawing, pages, texels=texels)
            images = [method.draw(eye, sky) for eye in path]
            among = [(image, image, view[2]) for image, view in zip(plain, views, strict=True)]
            own = "" if texels == "float32" else f"{measured(images, among, 0):.1f}"
            against = f"{measured(images, views, 0):.2f}"
            rows.append(f"| {name} | {sets} | {texels} | {method.bytes / 1e6:.1f} | {used:.0%} | {against} | {own} |")
    return rows


def main() -> None:
    heads = {
        "distant": "| scene | distance | texture | against `traced` | against `8 x 8` |\n|---|---|---|---|---|\n",
        "kept": "| scene | `atlas.sets` | `atlas.format` | MB | texels in use | against `traced` | against float32 |\n"
        "|---|---|---|---|---|---|---|\n",
    }
    text = PAGE.read_text(encoding="utf-8")
    for name, rows in (("distant", distant), ("kept", kept)):
        if sys.argv[1:] and name not in sys.argv[1:]:
            continue
        table = heads[name] + "".join(f"{row}\n" for scene in SCENES for row in rows(scene))
        print(table)
        before, _, rest = text.partition(f"<!-- {name} -->\n")
        text = before + f"<!-- {name} -->\n" + table + "<!-- end -->\n" + rest.partition("<!-- end -->\n")[2]
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
