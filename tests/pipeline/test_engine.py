"""Parts of a run over the cores and by submitit: the same bytes, kills, failures, engines that are absent."""

import os
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data.surface import Surface
from prtnet.pipeline import engine, run, shards, slurm
from prtnet.pipeline.bake import bake
from prtnet.pipeline.clusters import train_clusters
from prtnet.pipeline.engine import Order, Task
from prtnet.pipeline.job import open_job
from prtnet.pipeline.shards import Bake, Gather
from tests.pipeline import tasks
from tests.pipeline.test_pipeline import config
from tests.small import overrides
from tests.test_cli import prtnet


def opened(out: Path, name: str, **changes: object):
    own = {"cluster__engine": name, "cluster__workers": 2, "cluster__folder": str(out / "jobs")}
    return open_job(config(out, **{"methods": ["texture"], **own, **changes}), "", None)


def files(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*.safetensors")}


@pytest.fixture(autouse=True)
def _small_shards(monkeypatch):
    monkeypatch.setattr(shards, "SHARD_RAYS", 1 << 14)
    monkeypatch.setattr(engine, "POLL_SECONDS", 0.05)


@pytest.mark.filterwarnings("ignore:A worker stopped")  # joblib, of one that is killed on purpose
def test_cores_bake_the_same_bytes_though_a_worker_is_killed(tmp_path, monkeypatch):
    bake(opened(tmp_path / "process", "process"))
    monkeypatch.setattr(shards, "make_some", tasks.makes_shards_but_dies_once)
    bake(opened(tmp_path / "cores", "cores"))
    kept = (tmp_path / "cores" / "killed").read_text().split()
    assert kept
    assert files(tmp_path / "cores") == files(tmp_path / "process")
    made = "".join(log.read_text() for log in (tmp_path / "cores" / "jobs").glob("texture-*.log"))
    numbers = [line.split()[1] for line in made.splitlines() if line.startswith("shard")]
    assert sorted(set(numbers)) == ["0", "1", "2", "3", "4"]
    # what was whole when the worker was killed was found; its end ends the other's shard too
    assert all(numbers.count(number) == 1 for number in kept)


@pytest.mark.filterwarnings("ignore:A worker stopped")
def test_tasks_that_fail_or_are_killed_leave_the_others_unharmed(tmp_path):
    job = opened(tmp_path, "cores", cluster__retries=1)
    parts = [Task(f"puts-{number}", tasks.puts, {"number": number}) for number in range(4)]
    parts += [Task("breaks", tasks.breaks, {}), Task("dies", tasks.dies, {})]
    with pytest.raises(PrtnetError) as error:
        engine.spread(job, "parts", parts)
    words = str(error.value)
    assert "parts: 3 of 6 jobs failed" in words
    assert "puts-1: number: found 1, expected another" in words
    assert "breaks: ZeroDivisionError: no error of a user" in words
    assert "dies: killed, attempts: 2" in words
    assert all(str(tmp_path / "jobs" / f"{name}.log") in words for name in ("puts-1", "breaks", "dies"))
    assert "in breaks" in (tmp_path / "jobs" / "breaks.log").read_text()
    assert len(list((tmp_path / "cache" / "number").glob("*.safetensors"))) == 3


def test_a_task_that_fails_here_leaves_the_others_unharmed(tmp_path):
    parts = [Task(f"puts-{number}", tasks.puts, {"number": number}) for number in range(4)]
    with pytest.raises(PrtnetError, match=r"1 of 4 jobs failed(.|\n)*puts-1: number: found 1, expected another"):
        engine.spread(opened(tmp_path, "process"), "numbers", parts)
    assert len(list((tmp_path / "cache" / "number").glob("*.safetensors"))) == 3


def test_workers_with_another_scene_refuse(tmp_path):
    job = opened(tmp_path, "process")
    with pytest.raises(PrtnetError, match=r"found the scene .* expected .*same files"):
        shards.make_some(job, folder="", scene={}, tracer="", gather="bake", bands=1, first=0, step=1)


def test_a_bake_is_handed_over_whole():
    rng = np.random.default_rng(5)
    surface = Surface(
        rng.random((4, 3, 2), np.float32), *(rng.integers(9, size=size).astype(np.int32) for size in (4, (4, 2), 7))
    )
    points = rng.random((5, 3)), *rng.random((2, 5, 3), np.float32)
    for gather in (Gather("bake", 3), Gather("bounce", 3, surface, rng.random((7, 9, 3), np.float32))):
        work = Bake(gather, *points, directions=8, salt=1, size=2)
        found = shards._of_handed(shards._handed(work), gather.kind, 3, directions=8, salt=1, size=2)
        pairs = [(getattr(work, name), getattr(found, name)) for name in ("positions", "normals", "geometric_normals")]
        if gather.surface is not None:
            pairs += [(gather.sent, found.gather.sent)]
            pairs += [
                (getattr(surface, each.name), getattr(found.gather.surface, each.name)) for each in fields(surface)
            ]
        for expected, array in pairs:
            np.testing.assert_array_equal(array, expected)
            assert array.dtype == expected.dtype


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"engine": "condor"}, "cluster.engine: found 'condor', expected one of process, cores, slurm"),
        ({"workers": 0}, "cluster.workers: found 0, expected at least 1"),
        ({"retries": -1}, "cluster.retries: found -1"),
        ({"engine": "slurm", "cpus": 0}, "cluster.cpus: found 0"),
    ],
)
def test_engines_are_checked_before_any_work(changes, words, tmp_path):
    with pytest.raises(PrtnetError, match=words):
        run(config(tmp_path / "out", **{f"cluster__{name}": value for name, value in changes.items()}))
    assert not (tmp_path / "out").exists()


def test_an_absent_launcher_is_named_with_the_line_to_type(tmp_path, monkeypatch):
    monkeypatch.setattr(slurm, "_found", lambda module: False)
    with pytest.raises(PrtnetError, match=r"found no submitit, .*pip install 'prtnet\[cluster\]'"):
        run(config(tmp_path / "out", cluster__engine="slurm"))
    assert not (tmp_path / "out").exists()


def test_an_absent_slurm_is_said_before_a_sweep(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    done = prtnet("-m", "model.width=4,8", "cluster=slurm", *overrides(tmp_path / "out"))
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("prtnet: cluster=slurm: found no ")
    assert not (tmp_path / "out").exists()


def test_jobs_that_slurm_would_refuse_are_refused_before_any_work(tmp_path, monkeypatch):
    for name in ("sbatch", "squeue", "scancel", "srun"):
        (tmp_path / name).write_text("#!/bin/sh\necho 'invalid partition specified: nope' >&2\nexit 1\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(slurm, "_found", lambda module: True)
    with pytest.raises(PrtnetError, match="SLURM refuses such jobs: invalid partition specified: nope"):
        run(config(tmp_path / "out", cluster__engine="slurm"))
    assert not (tmp_path / "out").exists()


def test_a_job_of_submitit_is_submitted_again_when_it_is_killed(tmp_path, monkeypatch):
    """By submitit's own executor of local processes, in place of SLURM's."""
    submitit = pytest.importorskip("submitit", reason="needs submitit: pip install 'prtnet[cluster]'")
    monkeypatch.setattr(slurm, "GRACE_SECONDS", 0.2)
    monkeypatch.setattr(slurm, "POLL_SECONDS", 0.1)
    order = Order(Task("part", tasks.fails_after_it_died, {}), engine._description(opened(tmp_path, "process")), None)
    ended: dict[str, str] = {}
    executor = submitit.AutoExecutor(tmp_path / "jobs", cluster="local")
    jobs = slurm.Submitted(executor, {"part": order}, cpus=1, retries=1, most=1)
    slurm.wait(jobs, ended, lambda jobs: {job.job_id: "" for job in jobs if job.state == "RUNNING"})
    assert ended["part"].startswith("number: found 1, expected another\n    log: ")
    assert jobs.attempts == {"part": 2}


def test_networks_of_clusters_are_trained_as_jobs_with_the_same_bytes(tmp_path, monkeypatch):
    """Each job opens its own run and finds the points; here it does so in this process, which has torch already."""

    def in_process(orders, most, ended):
        ended.update((order.task.name, engine.work(order, 1)) for order in reversed(orders))

    monkeypatch.setattr(engine, "_in_processes", in_process)
    changes = {"stages": ["train"], "split__by": "grid", "split__cells": [2, 1, 1], "train__steps": 20}
    changes |= {"train__grid_cells": [], "train__hash_cells": [], "methods": ["texture", "clusters"]}
    found = []
    for name in ("process", "cores"):
        job = opened(tmp_path, name, **changes, cache=str(tmp_path / "cache"))
        baked = bake(job)
        train_clusters(job, baked.points, baked)
        nets = tmp_path / "cache" / "net"
        found.append({path.name: path.read_bytes() for path in nets.glob("*.safetensors")})
        nets.rename(tmp_path / name)
    assert len(found[0]) == 2
    assert found[0] == found[1]
    (kept,) = (tmp_path / "cache" / "spread").glob("*.json")
    assert '"networks": 2' in kept.read_text()
