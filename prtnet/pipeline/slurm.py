"""The engine `slurm`: each part of a run is a job of SLURM, handed to it by submitit.

SLURM itself queues jobs again whose node has failed, submitit those that are preempted or run out of time; jobs that
end in any other way without a result are submitted again here. Whether a job is still there is asked of `squeue`, since
`sacct`, which submitit asks, knows nothing where a site keeps no accounts.
"""

import importlib.util
import logging
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from prtnet import PrtnetError
from prtnet.config import ClusterOptions

if TYPE_CHECKING:
    from prtnet.pipeline.engine import Order

log = logging.getLogger(__name__)

POLL_SECONDS = 1.0
GRACE_SECONDS = 10.0  # that a result's file may need to be seen here, over a network, after its job has left the queue


def check_installed() -> None:
    """Raises PrtnetError, with the line to type, where submitit, Hydra's launcher for it or SLURM is absent."""
    for module in ("submitit", "hydra_plugins.hydra_submitit_launcher"):
        if not _found(module):
            raise PrtnetError(
                f"cluster=slurm: found no {module}, expected it to be installed; type: pip install 'prtnet[cluster]'"
            )
    for program in ("sbatch", "squeue", "scancel", "srun"):
        if shutil.which(program) is None:
            raise PrtnetError(
                f"cluster=slurm: found no {program}, expected the commands of SLURM; start the run on a machine of the "
                "cluster, or type: sudo apt-get install slurm-client, or stay on this machine with cluster=cores"
            )


def check(options: ClusterOptions) -> None:
    """Raises PrtnetError where SLURM cannot be had, or would refuse the jobs: it is asked before there is any."""
    check_installed()
    words = ["--test-only", "--wrap=true", f"--time={options.minutes}", f"--cpus-per-task={options.cpus}"]
    words += [f"--partition={options.partition}"] if options.partition else []
    words += [f"--mem={options.memory}G"] if options.memory else []
    asked = subprocess.run(["sbatch", *words], capture_output=True, text=True, check=False)
    if asked.returncode:
        raise PrtnetError(
            f"cluster=slurm: SLURM refuses such jobs: {asked.stderr.strip()}; expected cluster.partition, minutes, "
            "memory and cpus that it has; sinfo lists them"
        )


def run(orders: Mapping[str, "Order"], options: ClusterOptions, ended: dict[str, str]) -> None:
    """Every order as a job of SLURM; `ended` gets what each failed with, "" where it did not."""
    import submitit

    folder = Path(options.folder).absolute()
    executor = submitit.AutoExecutor(folder / "%j", cluster="slurm", slurm_max_num_timeout=options.retries)
    executor.update_parameters(
        name="prtnet",
        timeout_min=options.minutes,
        cpus_per_task=options.cpus,
        slurm_additional_parameters={"requeue": True},
        **({"mem_gb": options.memory} if options.memory else {}),
        **({"slurm_partition": options.partition} if options.partition else {}),
    )
    log.info("%d jobs of SLURM, logs in %s", len(orders), folder)
    most = options.workers if options.workers > 0 else len(orders)
    wait(Submitted(executor, orders, options.cpus, options.retries, most), ended, _queued)


@dataclass
class Submitted:
    """Orders as jobs of an executor of submitit, by the names of their tasks."""

    executor: Any
    orders: Mapping[str, "Order"]
    cpus: int
    retries: int
    most: int  # at a time
    running: dict[str, Any] = field(default_factory=dict)
    attempts: dict[str, int] = field(default_factory=dict)
    missed: dict[str, float] = field(default_factory=dict)  # when a job without a result was first not in the queue

    def submit(self, name: str) -> None:
        self.attempts[name] = self.attempts.get(name, 0) + 1
        self.running[name] = self.executor.submit(Attempt(), self.orders[name], self.cpus)

    def outcome(self, name: str, queued: Mapping[str, str] | None) -> str | None:
        """What a job has failed with, "" where it has not; None while it has not ended. Lost ones begin again.

        `queued`: states of the jobs that are still to run or running, by id; None where they cannot be told now.
        """
        job = self.running[name]
        if job.paths.result_pickle.exists():
            return _result(job)
        if queued is None or job.job_id in queued:
            self.missed.pop(name, None)
            return None
        if time.monotonic() - self.missed.setdefault(name, time.monotonic()) < GRACE_SECONDS:
            return None
        del self.missed[name]
        if self.attempts[name] > self.retries:
            return f"killed, attempts: {self.attempts[name]}{_log_of(job)}"
        log.warning("job %s of %s ended without a result and is submitted again", job.job_id, name)
        self.submit(name)
        return None


def wait(jobs: Submitted, ended: dict[str, str], queued: Callable[[Sequence[Any]], Mapping[str, str] | None]) -> None:
    """Submit all orders and wait for them; Ctrl-C, or an error, cancels what has not ended."""
    said: Mapping[str, str] = {}
    later = list(jobs.orders)
    try:
        while jobs.running or later:
            while later and len(jobs.running) < jobs.most:
                jobs.submit(later.pop(0))
            time.sleep(POLL_SECONDS)
            states = queued(list(jobs.running.values()))
            said = _say(states or {}, said)
            for name in list(jobs.running):
                outcome = jobs.outcome(name, states)
                if outcome is not None:
                    ended[name] = outcome
                    del jobs.running[name]
    except submitit_errors() as error:
        raise PrtnetError(
            f"cluster=slurm: a job could not be submitted: {error}; those that were are cancelled, and what they "
            "have made is kept"
        ) from error
    finally:
        for job in jobs.running.values():
            job.cancel(check=False)


def submitit_errors() -> tuple[type[Exception], ...]:
    """What submitit raises where sbatch refuses."""
    from submitit.core import utils

    return (utils.FailedJobError, utils.FailedSubmissionError)


def _say(states: Mapping[str, str], said: Mapping[str, str]) -> Mapping[str, str]:
    """Say why jobs wait, once: SLURM may never start one whose reason does not pass."""
    for job, words in states.items():
        if words.startswith("PENDING") and said.get(job) != words:
            log.info("job %s: %s", job, words)
    return states


class Attempt:
    """What a job of submitit calls. It can be begun again at any time, since what it has made is in the store."""

    def __call__(self, order: "Order", threads: int) -> str:
        import sys

        from prtnet.pipeline import engine

        logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)
        return engine.work(order, threads)

    def checkpoint(self, order: "Order", threads: int) -> Any:
        import submitit

        return submitit.helpers.DelayedSubmission(self, order, threads)


def _found(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        return False


def _result(job: Any) -> str:
    """What a job that has ended failed with, "" where it did not."""
    error = job.exception()
    failure = str(error).strip().splitlines()[-1] if error else job.result()
    return failure + _log_of(job) if failure else ""


def _log_of(job: Any) -> str:
    return f"\n    log: {job.paths.stdout}\n    log: {job.paths.stderr}"


def _queued(jobs: Sequence[Any]) -> dict[str, str] | None:
    """State and reason of the jobs that are still to run or running, by id; None where SLURM does not answer."""
    asked = subprocess.run(_queue_command(), capture_output=True, text=True, check=False)
    own = {job.job_id for job in jobs}
    return None if asked.returncode else {job: words for job, words in _states(asked.stdout).items() if job in own}


def _queue_command() -> list[str]:
    return ["squeue", "--noheader", "--array", f"--user={os.getuid()}", "--format=%i %T (%r)"]


def _states(listed: str) -> dict[str, str]:
    """State and reason by id, of what the command above prints; a point of a sweep has the id JOB_INDEX."""
    return dict(line.strip().split(" ", 1) for line in listed.splitlines() if line.strip())


def ask_the_queue() -> None:
    """Have submitit ask squeue after the points of a sweep, too: without accounts it would wait for a killed one for
    ever."""
    from submitit.core.core import InfoWatcher
    from submitit.slurm.slurm import SlurmJob

    class QueueWatcher(InfoWatcher):
        def _make_command(self) -> list[str] | None:
            return _queue_command() if self._registered - self._finished else None

        def read_info(self, string: bytes | str) -> dict[str, dict[str, str]]:
            there = _states(string if isinstance(string, str) else string.decode())
            return {job: {"State": there.get(job, "GONE").split(" ")[0]} for job in self._registered}

        def get_state(self, job_id: str, mode: str = "standard") -> str:
            return self.get_info(job_id, mode=mode).get("State", "UNKNOWN")

        def is_done(self, job_id: str, mode: str = "standard") -> bool:
            return self.get_state(job_id, mode) == "GONE"

    # declared as the one that asks sacct
    SlurmJob.watcher = QueueWatcher(delay_s=30)  # pyright: ignore[reportAttributeAccessIssue]


def cancel(name: str) -> None:
    """Cancel all jobs of a name, the points of a sweep."""
    subprocess.run(["scancel", f"--name={name}", f"--user={os.getuid()}"], check=False)
