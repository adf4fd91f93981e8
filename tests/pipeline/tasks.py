"""Parts of a run that end in every way, at the top of a module that another process imports quickly."""

import json
import os
import signal

import numpy as np

from prtnet import PrtnetError
from prtnet.pipeline import shards


def makes_shards_but_dies_once(job, *, first: int, step: int, **arguments) -> None:
    """The second worker is killed when it has made some of its shards."""
    mark = job.out / "killed"
    if first == 1 and not mark.exists():
        shards.make_some(job, first=1, step=3 * step, **arguments)
        records = [json.loads(path.read_text())["inputs"] for path in job.store.root.rglob("*.shards/*.json")]
        mark.write_text(" ".join(str(record["shard"]) for record in records if "shard" in record))
        os.kill(os.getpid(), signal.SIGKILL)
    shards.make_some(job, first=first, step=step, **arguments)


def dies(job) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def fails_after_it_died(job) -> None:
    mark = job.out / "died"
    if not mark.exists():
        mark.touch()
        dies(job)
    puts(job, number=1)


def puts(job, *, number: int) -> None:
    if number == 1:
        raise PrtnetError("number: found 1, expected another")
    job.store.make("number", {"number": number}, lambda: ({"number": np.array([number])}, {}))


def breaks(job) -> None:
    raise ZeroDivisionError("no error of a user")
