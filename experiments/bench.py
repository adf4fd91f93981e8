"""Speed of the parts, each beside its plain form in the same run.

    python experiments/bench.py tracer [--points 1000000]

prints a table and writes experiments/results/bench_tracer.csv.
"""

import argparse
import csv
import os
import resource
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from prtnet.data import builtin, directions, samples, transfer
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer, rays

RESULTS = Path(__file__).resolve().parent / "results"
DIRECTIONS, BANDS = 512, 5
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


BENCHES = {"tracer": tracer}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bench", choices=BENCHES)
    parser.add_argument("--points", type=int, default=1_000_000)
    chosen = parser.parse_args()
    rows = BENCHES[chosen.bench](chosen.points)
    for row in rows:
        print(f"{row['scene']:28} {row['what']:48} {row['value']:12.3f}")
    RESULTS.mkdir(parents=True, exist_ok=True)
    load = f"{os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f} at the end"
    with (RESULTS / f"bench_{chosen.bench}.csv").open("w", newline="") as file:
        file.write(f"# python experiments/bench.py {chosen.bench} --points {chosen.points}; {load}\n")
        writer = csv.DictWriter(file, ["scene", "triangles", "what", "value"])
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
