"""Speed of the parts, each beside its plain form in the same run.

    python experiments/bench.py tracer [--points 1000000]
    python experiments/bench.py gloss [--sizes 256 1024]
    python experiments/bench.py texture
    python experiments/bench.py train
    python experiments/bench.py export
    python experiments/bench.py implicit

prints a table and writes experiments/results/bench_NAME.csv.
"""

import argparse
import csv
import os
import resource
import shlex
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import bench_export
import bench_implicit
import bench_train
import numpy as np

from prtnet.data import atlas, builtin, directions, light, samples, texture, transfer
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer, rays
from prtnet.render import camera
from prtnet.render.material import PRODUCTS, Material, OfPart
from prtnet.render.method import TextureMethod
from prtnet.render.raster import Raster

RESULTS = Path(__file__).resolve().parent / "results"
DIRECTIONS, BANDS = 512, 5
FRAMES = 21
Row = dict[str, str | float]


def tracer(points: int) -> list[Row]:
    """Mray per CPU-second, fused beside a bare EmbreeScene.run loop on the same rays; then whole bakes."""
    dense = builtin.make("plants", tessellation=4.0)
    rows = []
    for label, scene in (("room", builtin.make("room")), (f"plants, {len(dense.faces) // 1000}k triangles", dense)):
        # a tenth of the points where they cost ten times as much
        rows += _tracer_rows(label, scene, points if scene is not dense else points // 10)
    return rows


def _tracer_rows(label: str, scene: Scene, points: int) -> list[Row]:
    fused, plain = Tracer(scene, kind="fused"), Tracer(scene, kind="embreex")
    picked = samples.area_uniform(scene, points, np.random.default_rng(0))
    order = samples.morton_order(picked.positions)
    # runs of neighbours from all over the scene, as a bake sees them
    runs = samples.select(picked, np.concatenate([run[:1024] for run in np.array_split(order, 16)]))
    table = directions.Table(*directions.local_set("cosine_fibonacci", DIRECTIONS, np.random.default_rng(1)), BANDS)
    turns = directions.turns(runs.normals, np.random.default_rng(2).random(len(runs.normals)) * 2 * np.pi)
    origins = fused.origins(runs.positions, runs.geometric_normals)
    batches = [
        rays(origins[part], directions.frames(turns[part]), table.directions)
        for part in np.array_split(np.arange(len(origins)), 16)
    ]
    count = len(origins) * DIRECTIONS / 1e6
    bare, robust = (_bare_loop(fused, scene, batches, robust) for robust in (False, True))
    whole = _cpu_seconds(lambda: fused.gather(origins, turns, table))
    same = sum(int((fused.trace(o, d) != plain.trace(o, d)).sum()) for o, d in batches)
    common = {"scene": label, "triangles": len(scene.faces)}
    rows: list[Row] = [
        {**common, "what": "EmbreeScene().run OCCLUDED, Mray per CPU-s", "value": count / bare},
        {**common, "what": "EmbreeScene(robust=True).run, Mray per CPU-s", "value": count / robust},
        {**common, "what": "fused with SH sums, Mray per CPU-s", "value": count / whole},
        {**common, "what": "fused / plain", "value": bare / whole},
        {**common, "what": "fused / plain robust", "value": robust / whole},
        {**common, "what": f"occlusions that differ, of {count:.1f} M", "value": same},
    ]
    return rows + [{**common, **row} for row in _bake_rows(fused, picked)]


def _bare_loop(fused: Tracer, scene: Scene, batches: list[tuple[np.ndarray, np.ndarray]], robust: bool) -> float:
    """CPU-seconds of embreex by itself, without our own code around it. Our tracers are robust; its default is not."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    bare = EmbreeScene(robust=robust)
    TriangleMesh(bare, fused.frame.to_unit(scene.vertices).astype(np.float32), scene.faces)
    return _cpu_seconds(lambda: [bare.run(o, d, query="OCCLUDED") for o, d in batches])


def _bake_rows(fused: Tracer, picked: samples.Samples) -> list[Row]:
    rows: list[Row] = []
    walls = {}
    before = _peak_memory()
    for threads in (1, 2):
        wall, cpu = time.perf_counter(), time.process_time()
        baked = transfer.bake(
            fused, picked.positions, picked.normals, geometric_normals=picked.geometric_normals,
            bands=BANDS, directions=DIRECTIONS, rng=np.random.default_rng(0), threads=threads,
        )  # fmt: skip
        walls[threads], cpu = time.perf_counter() - wall, time.process_time() - cpu
        what = f"{len(baked)} points x {DIRECTIONS} x {BANDS**2}, {threads} threads"
        rows += [
            {"what": f"{what}: CPU-s", "value": cpu},
            {"what": f"{what}: wall s", "value": walls[threads]},
        ]
    rows.append({"what": "two threads against one, wall", "value": walls[1] / walls[2]})
    rows.append({"what": "growth of peak memory in the bakes, MB", "value": _peak_memory() - before})
    return rows


def _cpu_seconds(work: Callable[[], object], repeats: int = 3) -> float:
    """Least CPU time of a few runs, after one to warm up."""
    work()
    best = np.inf
    for _ in range(repeats):
        started = time.process_time()
        work()
        best = min(best, time.process_time() - started)
    return best


def _peak_memory() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def gloss(sizes: list[int]) -> list[Row]:
    """Frames of the transfer texture with gloss, fixed light and full, as ratios to its diffuse frame, in turns; `own`
    where one part has another exponent, so that every pixel finds its own lobe."""
    # cornell has hardly a triangle: its frames are nothing but fragments
    scenes = [builtin.make(name).centred() for name in ("tea_set", "room", "cornell")]
    return [row for scene in scenes for size in sizes for row in _gloss_rows(scene, size)]


def _gloss_rows(scene: Scene, size: int) -> list[Row]:
    drawing = Raster(atlas.make(scene, size=512), size)
    image = np.random.default_rng(0).normal(size=(512, 512, BANDS**2)).astype(np.float32)
    eye, sun = camera.path(scene, Tracer(scene), 8)[0], light.project(light.sky(), BANDS)
    common = {"scene": f"{scene.name}, {size}^2", "triangles": len(scene.faces)}
    rows: list[Row] = [
        {**common, "what": "covered share of the frame", "value": drawing.gbuffer(eye).pixel.size / size**2}
    ]
    methods = {}
    shadings = {"diffuse": Material()}
    for product in PRODUCTS:
        shadings[product] = Material(0.5, (0.5, 0.5, 0.5), 20.0, product)
        shadings[f"{product}, own"] = replace(shadings[product], parts={scene.materials[0].name: OfPart(exponent=5.0)})
    for name, shading in shadings.items():
        started = time.perf_counter()
        methods[name] = TextureMethod(drawing, image, material=shading)
        methods[name].draw(eye, sun)
        rows.append({**common, "what": f"{name}: compile and first frame, s", "value": time.perf_counter() - started})
    taken: dict[str, list[float]] = {name: [] for name in methods}
    for _ in range(FRAMES):
        for name, method in methods.items():
            taken[name].append(method.milliseconds(eye, sun, repeats=1))
    for name, values in taken.items():
        rows.append({**common, "what": f"{name}: ms per frame", "value": float(np.median(values))})
    for name in list(methods)[1:]:
        ratios = np.array(taken[name]) / taken["diffuse"]
        rows.append({**common, "what": f"{name} / diffuse", "value": float(np.median(ratios))})
    return rows


def textures() -> list[Row]:
    """A 1024^2 transfer texture of the room, whole, against the bare fused tracer on the very same rays; unwrapping
    is apart. Then what a bounce adds."""
    size, rays_each = 1024, 1024
    scene = builtin.make("room").centred()
    fused = Tracer(scene, kind="fused")
    started = time.perf_counter()
    unwrapped = atlas.make(scene, size=size)
    seconds = time.perf_counter() - started
    common = {"scene": f"room, {size}^2 x {BANDS**2}", "triangles": len(scene.faces)}
    rows: list[Row] = [{**common, "what": "unwrapping, s", "value": seconds}]
    texture.gbuffer(unwrapped, 64)  # the driver compiles
    ratios = []
    for repeat in range(3):
        whole, texels = _cpu(lambda: _texture_of(fused, unwrapped, size, rays_each))
        bare, _ = _cpu(lambda texels=texels: _bare_gather(fused, texels, rays_each))
        ratios.append(whole / bare)
        name = f"of {len(texels.index)} texels x {rays_each} rays, CPU-s ({repeat + 1})"
        rows += [
            {**common, "what": f"texture {name}", "value": whole},
            {**common, "what": f"bare {name}", "value": bare},
        ]
    rows.append({**common, "what": "texture / bare fused tracer, median", "value": float(np.median(ratios))})
    return rows


def _texture_of(fused: Tracer, unwrapped: atlas.Atlas, size: int, rays_each: int) -> texture.Texels:
    texels = texture.gbuffer(unwrapped, size)
    baked = transfer.bake(
        fused, texels.positions, texels.normals, geometric_normals=texels.geometric_normals,
        bands=BANDS, directions=rays_each, rng=np.random.default_rng(0),
    )  # fmt: skip
    texture.assemble(texels, baked)
    return texels


def _bare_gather(fused: Tracer, texels: texture.Texels, rays_each: int) -> None:
    """The kernel alone, on the same rays in the same order and in as many threads."""
    table = directions.Table(*directions.local_set("cosine_fibonacci", rays_each, np.random.default_rng(0)), BANDS)
    turns = directions.turns(texels.normals, np.random.default_rng(0).random(len(texels.index)) * 2 * np.pi)
    origins = fused.origins(texels.positions, texels.geometric_normals)
    order = samples.morton_order(texels.positions)
    with ThreadPoolExecutor(transfer.cores()) as pool:
        list(pool.map(lambda part: fused.gather(origins[part], turns[part], table), np.array_split(order, 64)))


def _cpu(work: Callable[[], texture.Texels | None]) -> tuple[float, Any]:
    started = time.process_time()
    found = work()
    return time.process_time() - started, found


BENCHES = {
    "tracer": lambda chosen: tracer(chosen.points),
    "gloss": lambda chosen: gloss(chosen.sizes),
    "texture": lambda chosen: textures(),
    "train": lambda chosen: bench_train.train(),
    "export": lambda chosen: bench_export.export(),
    "implicit": lambda chosen: bench_implicit.implicit(),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bench", choices=BENCHES)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--sizes", type=int, nargs="+", default=[256, 1024], help="pixels along one side of a frame")
    chosen = parser.parse_args()
    rows = BENCHES[chosen.bench](chosen)
    for row in rows:
        print(f"{row['scene']:36} {row['what']:48} {row['value']:12.3f}")
    RESULTS.mkdir(parents=True, exist_ok=True)
    load = f"{os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f} at the end"
    with (RESULTS / f"bench_{chosen.bench}.csv").open("w", newline="") as file:
        file.write(f"# python experiments/bench.py {shlex.join(sys.argv[1:])}; {load}\n")
        writer = csv.DictWriter(file, ["scene", "triangles", "what", "value"])
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
