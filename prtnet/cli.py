"""The one Hydra app: `prtnet ...` or `python -m prtnet ...`."""

import logging
import os
import shlex
import sys
import time
from pathlib import Path

import hydra
from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import CompactHydraException, OverrideParseException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from prtnet import PrtnetError, config

PACKAGE = Path(__file__).resolve().parent
COMMAND = "PRTNET_COMMAND"  # as it was typed: the processes of a launcher see the environment, and only their own point
JOBS = "PRTNET_JOBS"  # the name of a sweep's jobs on SLURM, by which they are cancelled


class PointFailed(CompactHydraException):
    """A point of a sweep found a PrtnetError. Hydra goes on with the other points and ends with this one's message."""


def config_folder() -> Path:
    """`configs/` inside the installed package, or beside it in a checkout."""
    inside = PACKAGE / "configs"
    return inside if inside.is_dir() else PACKAGE.parent / "configs"


@hydra.main(version_base="1.3", config_path=str(config_folder()), config_name="config")
def _job(composed: DictConfig) -> None:
    # the heavy imports wait until there is work: --help and --cfg stay quick
    from prtnet import pipeline

    # here, since a launcher's processes never see main
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stdout)
    try:
        options = OmegaConf.to_object(composed)
        assert isinstance(options, config.Config)
        if _swept():
            # the points are what is spread; each does its own parts where it runs
            options.cluster = config.ClusterOptions()
        pipeline.run(options, *_point())
    except PrtnetError as error:
        code = _said(error)
        if _swept():
            raise PointFailed("prtnet: a point of the sweep failed, see above; the others are done") from None
        raise SystemExit(code) from None
    except KeyboardInterrupt:
        raise SystemExit(_interrupted()) from None


def _said(error: PrtnetError) -> int:
    """Print the message of an error; the exit code that goes with it."""
    print(f"prtnet: {error}", file=sys.stderr)
    return 2


def _interrupted() -> int:
    print("prtnet: interrupted; the same command goes on from here", file=sys.stderr)
    return 130


def _point() -> tuple[str, str | None, str]:
    """The command of this job, what tells it from the others of a sweep (None outside sweeps), the whole command."""
    settings = HydraConfig.get()
    own = shlex.join(["prtnet", *settings.overrides.task])
    return own, settings.job.override_dirname if _swept() else None, os.environ.get(COMMAND, own)


def _swept() -> bool:
    return HydraConfig.get().mode == RunMode.MULTIRUN


def _with_point_names(arguments: list[str]) -> list[str]:
    """The arguments with one more override: a sweep's point is named by what is swept and not by what is fixed."""
    words = [word for word in arguments if "=" in word and not word.startswith("-")]
    try:
        overrides = OverridesParser.create().parse_overrides(words)
    except OverrideParseException:
        return arguments  # Hydra says what is wrong with them
    swept = {override.key_or_group for override in overrides if override.is_sweep_override()}
    fixed = sorted({override.key_or_group for override in overrides} - swept)
    if not fixed:
        return arguments
    # beside another override: argparse wants them together
    place = arguments.index(words[0])
    return [
        *arguments[:place],
        f"hydra.job.config.override_dirname.exclude_keys=[{','.join(fixed)}]",
        *arguments[place:],
    ]


def _prepare_slurm(arguments: list[str]) -> None:
    """What Hydra would not say well, before it looks for its launcher and hands the points of a sweep to it.

    Raises PrtnetError where the launcher or SLURM is absent, or SLURM refuses such jobs.
    """
    from prtnet.pipeline import slurm

    slurm.check_installed()
    if not {"-m", "--multirun"} & set(arguments):
        return
    with initialize_config_dir(str(config_folder()), version_base="1.3"):
        composed = compose("config", [word for word in arguments if word.startswith("cluster")])
    options = OmegaConf.to_object(composed)
    assert isinstance(options, config.Config)
    slurm.check(options.cluster)
    slurm.ask_the_queue()


def main() -> None:
    """Entry point. Exit codes: 0 done, 1 a key or value refused, 2 a PrtnetError, 130 interrupted."""
    config.register()
    os.environ[COMMAND] = shlex.join(["prtnet", *sys.argv[1:]])
    on_slurm = "cluster=slurm" in sys.argv[1:]
    if on_slurm:
        os.environ[JOBS] = f"prtnet-{os.getpid()}-{time.time_ns():x}"
        try:
            _prepare_slurm(sys.argv[1:])
        except PrtnetError as error:
            raise SystemExit(_said(error)) from None
    sys.argv[1:] = _with_point_names(sys.argv[1:])
    try:
        _job()
    except KeyboardInterrupt:
        if on_slurm:
            from prtnet.pipeline import slurm

            slurm.cancel(os.environ[JOBS])
        raise SystemExit(_interrupted()) from None
    except SystemExit as stop:
        # Hydra's own exit code is 1 whatever a sweep ended with
        if isinstance(stop.__context__, PointFailed):
            raise SystemExit(2) from None
        if on_slurm and type(stop.__context__).__name__ == "UncompletedJobError":
            lost = PrtnetError("a job of the sweep was killed, see above; the same command makes what is missing")
            raise SystemExit(_said(lost)) from None
        raise


if __name__ == "__main__":
    main()
