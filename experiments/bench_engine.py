"""Scaling of a bake over the cores, and what a job costs: experiments/results/bench_engine.csv.

    python experiments/bench_engine.py [pairs]

The same bake of `room`, tessellation 4, by one worker with one thread and by two workers with one thread each, in
turns, each in a process and a store of its own. `efficiency` is t1 / (2 t2). Wall times say little on a machine that
has other work, so it stands there in CPU time as well: t1 is that of the one process, t2 that of the process that asks
(which hands the points over and joins the shards) and half of that of both workers, which make equally many shards.
Medians of the pairs.
"""

import csv
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

RESULTS = Path(__file__).parent / "results" / "bench_engine.csv"
POINTS, DIRECTIONS = 2_000_000, 1024


def bake(workers: int) -> dict[str, float]:
    """Seconds of one bake; the pool's start and its loading of the scene are in them."""
    from prtnet.config import Config
    from prtnet.data import samples
    from prtnet.pipeline.job import open_job
    from prtnet.pipeline.transport import traced

    with tempfile.TemporaryDirectory() as folder:
        config = Config(out=folder, threads=1, methods=["texture"])
        config.scene.name, config.scene.tessellation = "room", 4.0
        config.cluster.engine, config.cluster.workers = ("process", -1) if workers == 1 else ("cores", workers)
        config.cluster.folder = f"{folder}/jobs"
        job = open_job(config, "", None)
        points = samples.area_uniform(job.scene, POINTS, job.rng("bench"))
        # compiled and warm before the clock starts, in either way
        job.tracer.measure(points.positions, points.normals)
        before, start = time.process_time(), time.perf_counter()
        traced(job, "bench", {}, points, DIRECTIONS)
        own = time.process_time() - before
        return {"wall": time.perf_counter() - start, "before": before, "own": own}


def jobs() -> dict[str, float]:
    """Seconds of two jobs with nothing to do but open the run: the first, and then, on processes that are there."""
    from prtnet.config import Config
    from prtnet.pipeline import engine
    from prtnet.pipeline.engine import Task
    from prtnet.pipeline.job import open_job

    with tempfile.TemporaryDirectory() as folder:
        config = Config(out=folder, methods=["texture"])
        config.scene.name, config.scene.tessellation = "room", 4.0
        config.cluster.engine, config.cluster.workers, config.cluster.folder = "cores", 2, f"{folder}/jobs"
        job, found = open_job(config, "", None), {}
        for what in ("first", "later"):
            start = time.perf_counter()
            engine.spread(job, what, [Task(f"{what}-{number}", abs_of, {"number": number}) for number in range(2)])
            found[what] = time.perf_counter() - start
        return found


def abs_of(job: object, *, number: int) -> None:
    abs(number)


def measured(*words: str) -> dict[str, float]:
    """What one of the above finds in a process of its own, with the CPU time of it and its workers."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, __file__, *words], capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads(done.stdout.splitlines()[-1]) | {"cpu": spent}


def main(pairs: int) -> None:
    turns: dict[int, list[dict[str, float]]] = {1: [], 2: []}
    for _ in range(pairs):
        for workers, made in turns.items():
            made.append(measured("bake", str(workers)))
            print(workers, made[-1], flush=True)
    one, two = turns[1], turns[2]
    for each in two:
        # rusage has the workers only when they have ended, so theirs is what is left
        each["workers"] = each["cpu"] - each["before"] - each["own"]
        each["alone"] = each["own"] + each["workers"] / 2
    rows = {
        "1 worker, wall s": [each["wall"] for each in one],
        "1 worker, CPU-s": [each["own"] for each in one],
        "2 workers, wall s": [each["wall"] for each in two],
        "2 workers, CPU-s of the asking process": [each["own"] for each in two],
        "2 workers, CPU-s of both": [each["workers"] for each in two],
        "efficiency, wall": [a["wall"] / (2 * b["wall"]) for a, b in zip(one, two, strict=True)],
        "efficiency, CPU": [a["own"] / (2 * b["alone"]) for a, b in zip(one, two, strict=True)],
    }
    idle = [measured("jobs") for _ in range(pairs)]
    rows["two jobs that do nothing, the first, wall s"] = [each["first"] for each in idle]
    rows["two jobs that do nothing, later ones, wall s"] = [each["later"] for each in idle]
    load = os.getloadavg()[0]
    with RESULTS.open("w", newline="") as file:
        file.write(
            f"# python experiments/bench_engine.py {pairs}; {os.cpu_count()} cores, load {load:.1f} at the end\n"
        )
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["scene", "points", "directions", "what", "median", "least", "most"])
        for what, values in rows.items():
            figures = [f"{value:.3g}" for value in (statistics.median(values), min(values), max(values))]
            writer.writerow(["room x 4", POINTS, DIRECTIONS, what, *figures])
    print(RESULTS.read_text())


if __name__ == "__main__":
    if sys.argv[1:2] == ["bake"]:
        print(json.dumps(bake(int(sys.argv[2]))))
    elif sys.argv[1:2] == ["jobs"]:
        print(json.dumps(jobs()))
    else:
        main(int(sys.argv[1]) if sys.argv[1:] else 3)
