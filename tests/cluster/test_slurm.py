"""Runs on a real SLURM of two nodes: ./run cluster-test. What they leave is compared with one process's, in bytes."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.cluster.two_nodes import NODES, TwoNodes, lacking
from tests.small import overrides

pytestmark = [pytest.mark.slurm, pytest.mark.skipif(bool(lacking()), reason=lacking() or "-")]

CHECKOUT = Path(__file__).resolve().parents[2]
# a dozen shards of a second or two, a network of the whole and one for each half
BAKE = {"samples__count": 1_500_000, "samples__directions": 512, "stages": "[train]"}
BAKE |= {"methods": "[texture,net,clusters]", "split__by": "grid", "split__cells": "[2,1,1]"}
ON_SLURM = ("cluster=slurm", "cluster.cpus=1", "cluster.workers=2", "cluster.least_shards=2")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with TwoNodes(tmp_path_factory.mktemp("slurm")) as two:
        yield two


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The same run in one process."""
    folder = tmp_path_factory.mktemp("alone")
    assert start(folder, os.environ, *overrides(folder / "out", **BAKE)).wait() == 0, (folder / "log").read_text()
    return artifacts(folder / "out")


def start(folder: Path, environment, *words: str) -> subprocess.Popen[bytes]:
    """The command line in a folder, with what it says in `log` there."""
    folder.mkdir(parents=True, exist_ok=True)
    environment = dict(environment) | {"PYTHONPATH": str(CHECKOUT)}
    with (folder / "log").open("wb") as log:
        command = [sys.executable, "-m", "prtnet", *words]
        return subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log, start_new_session=True)


def artifacts(out: Path) -> dict[str, bytes]:
    """All results; that networks were spread is noted where they were."""
    found = [path for path in out.rglob("*.safetensors") if path.parent.name != "spread"]
    return {str(path.relative_to(out)): path.read_bytes() for path in found}


def until(found, seconds: float = 120):
    """What found() gives, as soon as it gives something."""
    for _ in range(int(seconds * 4)):
        if answer := found():
            return answer
        time.sleep(0.25)
    raise AssertionError(f"nothing after {seconds:.0f} s")


def half_way(out: Path) -> bool:
    return len(list(out.glob("cache/training/*.shards/*.json"))) >= 4


def jobs_on(cluster: TwoNodes, node: str) -> list[str]:
    return cluster.command("squeue", "--noheader", f"--nodelist={node}", "--state=running", "--format=%A").split()


def test_both_nodes_make_a_run_together_though_one_fails_half_way(cluster, alone, tmp_path):
    run = start(tmp_path, cluster.environment, *ON_SLURM, *overrides(tmp_path / "out", **BAKE))
    until(lambda: half_way(tmp_path / "out"))
    (lost,) = jobs_on(cluster, NODES[1])
    cluster.kill(NODES[1])
    until(lambda: cluster.state(NODES[1]).startswith("down"))
    # SLURM begins such a job again after two minutes, or when it is told to
    until(lambda: "BeginTime" in cluster.command("squeue", "--noheader", f"--job={lost}", "--format=%r"))
    cluster.command("scontrol", "update", f"JobId={lost}", "StartTime=now")
    assert run.wait(timeout=300) == 0, (tmp_path / "log").read_text()
    assert artifacts(tmp_path / "out") == alone
    logs = [path.read_text() for path in (tmp_path / "runs" / "jobs").glob("*/*_log.out")]
    assert sum("clusters: network" in log for log in logs) == 2
    cluster.start_node(NODES[1])
    until(lambda: cluster.state(NODES[1]) == "idle")


def test_a_job_that_is_killed_is_submitted_again(cluster, alone, tmp_path):
    run = start(tmp_path, cluster.environment, *ON_SLURM, *overrides(tmp_path / "out", **BAKE))
    until(lambda: half_way(tmp_path / "out"))
    (job,) = jobs_on(cluster, NODES[0])
    cluster.kill_job(job)
    assert run.wait(timeout=300) == 0, (tmp_path / "log").read_text()
    assert f"job {job} of training-" in (tmp_path / "log").read_text()
    assert artifacts(tmp_path / "out") == alone
    logs = "".join(path.read_text() for path in (tmp_path / "runs" / "jobs").glob("*/*_log.out"))
    shards = [line for line in logs.splitlines() if line.startswith("shard ")]
    # all, and again at most the one that each kill has cut short
    assert len(set(shards)) == 12
    assert len(shards) <= 13


def test_points_of_a_sweep_are_jobs(cluster, tmp_path):
    words = overrides(tmp_path / "out", stages="[train]", model__width="4,8")
    run = start(tmp_path, cluster.environment, "-m", *ON_SLURM, *words)
    assert run.wait(timeout=300) == 0, (tmp_path / "log").read_text()
    assert len(list((tmp_path / "out" / "cache" / "net").glob("*.safetensors"))) == 2
    assert len(list((tmp_path / "runs" / "jobs").glob("*_[01]/*_log.out"))) == 2


@pytest.mark.parametrize("multirun", [[], ["-m", "model.width=4,8"]])
def test_a_partition_that_is_not_there_is_said_before_any_work(multirun, cluster, tmp_path):
    words = [*multirun, *ON_SLURM, "cluster.partition=night", *overrides(tmp_path / "out")]
    assert start(tmp_path, cluster.environment, *words).wait(timeout=60) == 2
    said = (tmp_path / "log").read_text()
    assert "prtnet: cluster=slurm: SLURM refuses such jobs" in said
    assert "night" in said
    assert "Traceback" not in said
    assert [path.name for path in tmp_path.iterdir()] == ["log"]


@pytest.mark.parametrize("multirun", [[], ["-m", "model.width=4,8"]])
def test_ctrl_c_cancels_the_jobs(multirun, cluster, tmp_path):
    words = overrides(tmp_path / "out", stages="[train]", train__steps=1_000_000)
    run = start(tmp_path, cluster.environment, *multirun, *ON_SLURM, *words)
    until(lambda: cluster.command("squeue", "--noheader", "--state=running"))
    run.send_signal(signal.SIGINT)
    assert run.wait(timeout=60) == 130
    assert "prtnet: interrupted; the same command goes on from here" in (tmp_path / "log").read_text()
    until(lambda: not cluster.command("squeue", "--noheader", "--state=running,pending"))
