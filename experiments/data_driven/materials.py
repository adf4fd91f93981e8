"""Data-driven transfer through translucent solids and hair, beside path-traced references, learned end to end.

    python -m experiments.data_driven.materials [--only subsurface|hair] [--size 192]

Wants the extra paths (Mitsuba 3). Under random directional lights: lightmaps, direct light at measurement points, basis
and operator; then two lights that it has not learned from, each as the path-traced view, as the path-traced lightmap
shows it, as what the operator makes of the direct light, and as near as its basis comes. Writes subsurface.png and
hair.png and a table of figures for each (*.md) into results/. About ten minutes on two cores.
"""

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from prtnet import data_driven, score
from prtnet.chart import sheet
from prtnet.data import atlas, measurement, surface, texture
from prtnet.data.bilinear import bilinear
from prtnet.data.implicit import builtin, mesh
from prtnet.data.lighting import direct, scenario
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.lightmap import hair, mitsuba, strands, subsurface
from prtnet.data.lightmap.rendered import Rendered
from prtnet.data.scene import Scene, assemble
from prtnet.data.tracer import Tracer
from prtnet.data_driven import DataDriven, Measurement
from prtnet.models.data_driven import Pairs, learn, projected
from prtnet.pipeline.data_driven.errors import errors
from prtnet.render.camera import Camera, look
from prtnet.render.data_driven import DataDrivenMethod
from prtnet.render.raster import Raster

Array = np.ndarray
RESULTS = Path(__file__).parent / "results"
KIND = "directional"
LEARNED, UNSEEN = 64, 16  # configurations
SHOWN = (0, 1)  # of the unseen ones
POINTS, SUPERSAMPLING, ELEMENTS, RIDGE = 128, 8, 16, 0.01
COLUMNS = ("path traced", "path traced lightmap", "learned", "nearest in the basis")
DENSITY, VOXELS, TEXELS = 20.0, 56, 96  # of the rabbit: extinction, mesh, lightmap
STRANDS = 400
# paths to a texel and to a pixel of the references
EFFORT = {"subsurface": (3072, 1024), "hair": (384, 256)}
HEAD = """    python -m experiments.data_driven.materials --only {name}

Errors on lights learned from and on unseen ones, RMS over texels, lights and colours, in percent of the lightmaps' own:
of the operator, of the nearest thing in its basis, and the standard error of the lightmaps, which is part of both. One
basis shared by all colours, or one for each. Seconds: both databases, on two cores.

| scene | channels | texels | training % | nearest % | noise % | unseen % | nearest % | noise % | seconds |
| :-- | :-- | --: | --: | --: | --: | --: | --: | --: | --: |
"""


@dataclass(frozen=True, eq=False)
class Study:
    """Two databases of one scene: lights, lightmaps, direct vectors."""

    lights: tuple[list[Lighting], list[Lighting]]
    made: tuple[Rendered, Rendered]
    direct: tuple[Array, Array]
    seconds: float


def drawn(scene: Scene) -> tuple[list[Lighting], list[Lighting]]:
    tracer = Tracer(scene)
    learned, unseen = (
        scenario.draw([KIND], count, scene, tracer, np.random.default_rng(seed))
        for seed, count in ((1, LEARNED), (2, UNSEEN))
    )
    return learned, unseen


def measured(scene: Scene, points: Measurement, lights: list[Lighting]) -> Array:
    """Direct vectors "c m 3", by shadow rays."""
    flat = [getattr(points, name).reshape(-1, 3) for name in ("positions", "normals", "geometric_normals")]
    found = direct.irradiances(lights, Tracer(scene), *flat).reshape(len(lights), *points.albedo.shape)
    return (found * points.albedo / np.pi).mean(axis=2, dtype=np.float64).astype(np.float32)


def fitted(scene: Scene, points: Measurement, texels: Array, size: int, study: Study) -> tuple[DataDriven, str]:
    """Basis and operator, one for each colour, and lines of the table: as shares of the lightmaps' RMS, in percent."""
    lines, spec = [], None
    for channels in ("shared", "separate"):
        learned = learn(Pairs(study.made[0].values, study.direct[0]), elements=ELEMENTS, ridge=RIDGE, channels=channels)
        spec = DataDriven(learned.basis, learned.matrices, (points,), texels, size, scene.digest(), quantity="radiance")
        figures = []
        for each, vectors in zip(study.made, study.direct, strict=True):
            found = errors(spec.basis, spec.matrices, each.values, vectors)
            noise = float(np.sqrt(np.mean(each.noise**2, dtype=np.float64) / np.mean(each.values**2, dtype=np.float64)))
            figures += [found.rmse / found.level, found.projection / found.level, noise]
        words = [scene.name, channels, str(len(texels)), *(f"{100 * each:.1f}" for each in figures)]
        lines.append(f"| {' | '.join(words)} | {study.seconds:.0f} |")
    assert spec is not None
    return spec, "\n".join(lines)


def of_rabbit(size: int, samples: int, paths: int) -> str:
    """The built-in rabbit as wax: every part is a medium of its own colour, on one boundary."""
    started = time.perf_counter()
    scene = replace(mesh.scene_of(mesh.implicit_of(builtin.make("sdf_rabbit")), VOXELS).centred(), name="rabbit")
    unwrapped = atlas.make(scene, size=TEXELS)
    pages = texture.gbuffers(unwrapped, TEXELS)
    where, colours = texture.points(pages), surface.texel_albedo(unwrapped, pages)
    points = measurement.on_surface(scene, POINTS, SUPERSAMPLING, np.random.default_rng(0))
    lights = drawn(scene)
    made = tuple(
        subsurface.lightmaps(scene, where, each, samples=samples, density=DENSITY, seed=seed, albedo=colours)
        for seed, each in enumerate(lights)
    )
    study = Study(lights, made, tuple(measured(scene, points, each) for each in lights), time.perf_counter() - started)
    spec, line = fitted(scene, points, pages[0].index, TEXELS, study)
    camera = look(np.array([1.9, 1.0, 2.3]), np.array([0.0, -0.12, 0.0]), 44.0)
    method, rows = DataDrivenMethod(Raster(unwrapped, size), spec), {}
    gbuffer = method.raster.gbuffer(camera)
    for number in SHOWN:
        light = lights[1][number]
        views = [subsurface.view(scene, eye_of(camera), light, size=size, samples=paths, density=DENSITY, seed=9)]
        truth = made[1].values[number]
        for values in (truth, None, nearest(spec, truth)):
            if values is None:
                views.append(method.draw(camera, light))
                continue
            image = np.zeros((size * size, 3), np.float32)
            image[gbuffer.pixel] = bilinear(texture.assemble(pages[0], values), gbuffer.uv)
            views.append(image.reshape(size, size, 3))
        rows[f"unseen light {number + 1}"] = views
    write("subsurface", "translucent: a rough boundary, a medium inside; 16 elements, lit from one direction", rows)
    return line


def of_hair(size: int, samples: int, paths: int) -> str:
    """Strands of the built-in hair on a black skull, measured on a hull."""
    started = time.perf_counter()
    curves, body = strands.of_builtin(STRANDS)
    scene = replace(assemble("hair", [strands.ribbons(curves), body]).centred(), name="hair")
    points = measurement.on_hull(scene, POINTS, SUPERSAMPLING, np.random.default_rng(0))
    lights = drawn(scene)
    made = tuple(
        hair.lightmaps(curves, each, samples=samples, seed=seed, body=body) for seed, each in enumerate(lights)
    )
    study = Study(lights, made, tuple(measured(scene, points, each) for each in lights), time.perf_counter() - started)
    index, texels = strands.layout(curves.count)
    spec, line = fitted(scene, points, index, texels, study)
    camera = look(np.array([-1.7, 0.7, -2.5]), np.array([0.0, 0.05, 0.0]), 38.0)
    seen, rows = hair.seen(curves, eye_of(camera), size=size, rays=16, seed=8, body=body), {}
    for number in SHOWN:
        light, truth = lights[1][number], made[1].values[number]
        found = data_driven.indirect(spec, study.direct[1][number]).astype(np.float32)
        views = [hair.view(curves, eye_of(camera), light, size=size, samples=paths, seed=9, body=body)]
        rows[f"unseen light {number + 1}"] = views + [
            seen.shown(np.maximum(values, 0)) for values in (truth, found, nearest(spec, truth))
        ]
    write("hair", "hair: ten texels to a strand; 16 elements, lit from one direction", rows)
    return line


def nearest(spec: DataDriven, truth: Array) -> Array:
    return projected(spec.basis, truth[None], spec.gamma)[0].astype(np.float32)


def eye_of(camera: Camera) -> tuple[Array, Array, Array, float]:
    return np.asarray(camera.eye), np.asarray(camera.target), np.asarray(camera.up), camera.fov_y


def write(name: str, title: str, rows: dict[str, list[Array]]) -> None:
    """One exposure to a row: that of its reference."""
    toned = {}
    for word, views in rows.items():
        exposure = 0.9 / max(float(np.percentile(views[0].max(axis=2)[views[0].max(axis=2) > 0], 99)), 1e-9)
        toned[word] = [score.tone_map(np.maximum(view, 0), exposure) for view in views]
    RESULTS.mkdir(exist_ok=True)
    sheet.grid(RESULTS / f"{name}.png", toned, COLUMNS, title=title, cell=384)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("subsurface", "hair"))
    parser.add_argument("--size", type=int, default=192, help="pixels along one side of a picture")
    parser.add_argument("--samples", type=int, help="paths to a texel")
    parser.add_argument("--paths", type=int, help="paths to a pixel of the references")
    chosen = parser.parse_args()
    mitsuba.check()
    for name, study in (("subsurface", of_rabbit), ("hair", of_hair)):
        if chosen.only in (None, name):
            samples, paths = EFFORT[name]
            line = study(chosen.size, chosen.samples or samples, chosen.paths or paths)
            print(line)
            (RESULTS / f"{name}.md").write_text(f"{HEAD.format(name=name)}{line}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
