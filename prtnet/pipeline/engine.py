"""Independent parts of a run on an existing engine: one after the other here, over the cores, or on SLURM.

A part is a function of the pipeline with plain arguments. It leaves its results in the store, under keys, and gives
nothing back: who asked for it finds them there. So a part that was killed is started again and goes on where it was,
and a run gives the same bytes on every engine. (Of machines; the clusters of a scene are `pipeline.clusters`.)
"""

import logging
import pickle
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from prtnet import PrtnetError, console
from prtnet.config import ClusterOptions
from prtnet.data.transfer import cores
from prtnet.pipeline import slurm
from prtnet.pipeline.job import Job, opened
from prtnet.store import Store

log = logging.getLogger(__name__)

ENGINES = ("process", "cores", "slurm")
POOL: dict[str, Any] = {"backend": "loky", "batch_size": 1, "return_as": "generator_unordered"}
POLL_SECONDS = 0.5  # between two looks at how far the parts are


@dataclass(frozen=True)
class Task:
    """One part: `function(job, **arguments)`, a function at the top of a module and plain values."""

    name: str  # of its log file
    function: Callable[..., None]
    arguments: Mapping[str, Any]


@dataclass(frozen=True)
class Order:
    """A task with what another process needs to open its job."""

    task: Task
    job: bytes
    log: Path | None  # None where the engine keeps the log


def check(options: ClusterOptions) -> None:
    """Raises PrtnetError, before any work, for an engine that cannot be had."""
    if options.engine not in ENGINES:
        raise PrtnetError(f"cluster.engine: found {options.engine!r}, expected one of {', '.join(ENGINES)}")
    least = {"least_shards": 1, "retries": 0, "minutes": 1, "memory": 1, "cpus": 1}
    for name, minimum in least.items():
        found = getattr(options, name)
        if found is not None and found < minimum:
            raise PrtnetError(f"cluster.{name}: found {found}, expected at least {minimum}")
    if options.workers < 1 and options.workers != -1:
        raise PrtnetError(f"cluster.workers: found {options.workers}, expected at least 1, or -1 for one per core")
    if options.engine == "slurm":
        slurm.check(options)


def workers(options: ClusterOptions) -> int:
    """Parts that are made at a time."""
    if options.engine == "process":
        return 1
    return cores() if options.workers == -1 else options.workers


def useful_workers(job: Job, shards: int) -> int:
    """How many workers are worth starting for so many shards."""
    options = job.config.cluster
    return min(workers(options), shards // options.least_shards)


def threads(job: Job) -> int:
    """Threads of ray tracing of all workers together."""
    options = job.config.cluster
    if options.engine == "slurm":
        return workers(options) * (job.config.threads or options.cpus)
    return job.config.threads or cores()


def spread(
    job: Job,
    title: str,
    tasks: Sequence[Task],
    *,
    total: int | None = None,
    unit: str = "jobs",
    reached: Callable[[], int] | None = None,
) -> None:
    """Have all tasks done by the job's engine. `reached()` of `total` `unit` is shown while they run.

    A task that ends by a PrtnetError, or is killed more often than `cluster.retries`, leaves the others unharmed:
    PrtnetError is raised when all have ended, with its message and log file.
    """
    options, folder = job.config.cluster, Path(job.config.cluster.folder).absolute()
    ended: dict[str, str] = {}

    def over() -> int:
        return len(ended)

    with _watched(title, total or len(tasks), unit, reached or over):
        if workers(options) == 1 and options.engine != "slurm":
            ended.update((task.name, _done(job, task)) for task in tasks)
        else:
            on_slurm = options.engine == "slurm"
            folder.mkdir(parents=True, exist_ok=True)
            logs = [None if on_slurm else folder / f"{task.name}.log" for task in tasks]
            own = _description(job)
            orders = {task.name: Order(task, own, file) for task, file in zip(tasks, logs, strict=True)}
            (slurm.run if on_slurm else _over_cores)(orders, options, ended)
    failed = [f"{task.name}: {ended[task.name]}" for task in tasks if ended[task.name]]
    if failed:
        raise PrtnetError(
            f"{title}: {len(failed)} of {len(tasks)} jobs failed, what the others made is kept; the same command makes "
            "what is missing\n  " + "\n  ".join(failed)
        )


@contextmanager
def _watched(title: str, total: int, unit: str, reached: Callable[[], int]) -> Iterator[None]:
    """A progress line beside the block."""
    stop = threading.Event()
    with console.progress(title, total, unit) as reach:

        def watch() -> None:
            while not stop.wait(POLL_SECONDS):
                reach(reached())

        thread = threading.Thread(target=watch, daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()


def _done(job: Job, task: Task) -> str:
    """Do a task here; what it failed with, "" where it did not."""
    try:
        task.function(job, **task.arguments)
    except PrtnetError as error:
        return str(error)
    return ""


def _over_cores(orders: Mapping[str, Order], options: ClusterOptions, ended: dict[str, str]) -> None:
    """Every order in a process of a pool; `ended` gets what each failed with, "" where it did not."""
    for attempt in range(options.retries + 1):
        left = [order for name, order in orders.items() if name not in ended]
        if attempt and left:
            log.warning("a job was killed: %d of %d are started again", len(left), len(orders))
        # a process that is killed takes the pool with it: the last time each has one to itself, and falls alone
        alone = attempt == options.retries > 0
        for together in [[order] for order in left] if alone else [left]:
            _in_processes(together, workers(options), ended)
    for name in orders.keys() - ended.keys():
        ended[name] = f"killed, attempts: {options.retries + 1}\n    log: {orders[name].log}"


def _in_processes(orders: Sequence[Order], most: int, ended: dict[str, str]) -> None:
    """Orders in a pool of joblib's, until one of its processes is killed."""
    from joblib import Parallel, delayed

    count = min(most, len(orders))
    # for one job joblib would make no process
    pool: Any = Parallel(n_jobs=max(2, count), **POOL)
    with suppress(BrokenProcessPool):
        for name, failure in pool(delayed(_in_pool)(order, max(1, cores() // count)) for order in orders):
            ended[name] = failure


def _in_pool(order: Order, share: int) -> tuple[str, str]:
    """(name, failure) of an order, in a process of a pool, with its log in a file."""
    # Ctrl-C reaches all processes of a terminal, and who waits for this one ends it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    assert order.log is not None
    handler = logging.FileHandler(order.log)
    logger = logging.getLogger("prtnet")
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        failure = work(order, share)
    except Exception as error:
        logger.exception("no error of a user")
        failure = f"{type(error).__name__}: {error}"
    finally:
        logger.removeHandler(handler)
        handler.close()
    return order.task.name, f"{failure}\n    log: {order.log}" if failure else ""


def work(order: Order, threads: int) -> str:
    """Open the order's job and do its task with so many threads; what it failed with, "" where it did not."""
    try:
        job = _opened(order.job, threads)
    except PrtnetError as error:
        return str(error)
    return _done(job, order.task)


def _description(job: Job) -> bytes:
    """What another process opens the same job with. Inverse of `_opened`."""
    # parts of parts stay in the process that makes them
    config = replace(job.config, cluster=ClusterOptions())
    return pickle.dumps((config, job.out.absolute(), job.store.root.absolute(), job.command))


@lru_cache(maxsize=1)
def _opened(description: bytes, threads: int) -> Job:
    """Kept until the next one: a process of a pool makes parts of the same job again and again."""
    config, out, cache, command = pickle.loads(description)
    config = replace(config, threads=config.threads or threads)
    return replace(opened(config, command, None), out=out, store=Store(cache))
