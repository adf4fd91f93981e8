"""What a sweep found: score.json, table.md, chart.png and command.txt beside its points, made anew as each point ends.

Each point has besides its own line of TensorBoard's tab HPARAMS.
"""

import logging
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from prtnet import PrtnetError, score, store
from prtnet.chart import plot, points, tables
from prtnet.models import board
from prtnet.pipeline.job import Job
from prtnet.pipeline.score import Scored
from prtnet.pipeline.train import Trained
from prtnet.score import Row

METRICS = ("psnr", "psnr_worst", "ssim", "macs", "bytes", "ms_ratio")

log = logging.getLogger(__name__)


def log_point(job: Job, point: str, scored: Scored, trained: Trained) -> None:
    """Write the net's line of TensorBoard's tab HPARAMS: what was swept, and what it gave against `traced`."""
    folder = job.out / "tensorboard" / "point"
    stamp = folder / ".key"
    if stamp.exists() and stamp.read_text() == scored.key:
        return
    row = next(row for row in scored.rows if row.method == "net" and row.reference == "traced")
    figures = {key: getattr(row, key) for key in METRICS} | {"transfer_rmse": trained.facts["areas_rmse"]}
    found = {key: float(value) for key, value in figures.items() if value is not None}
    board.hyperparameters(folder, points.options(point), found)
    store.write_text(stamp, scored.key)


def summarise(job: Job, point: str, command: str = "") -> None:
    """Write the summary of all points of the sweep of a job that have been scored, and the sweep's command."""
    summary_of(job.out.parents[len(Path(point).parts) - 1], command)


def summary_of(base: Path, command: str = "") -> None:
    """Write the summary of all points below a sweep's folder that have been scored, and the sweep's command; what fails
    leaves the rest."""
    # points that end together write one after the other, so that the last one has seen them all
    with store.alone(base / ".sweep.lock"):
        rows = _rows(base)
        if not rows:
            return
        score.write(base / "score.json", rows, score.versions())
        if command:
            store.write_text(base / "command.txt", f"{command}\n")
        shown, count = points.side_by_side(rows), len({row.point for row in rows})
        title = f"# {tables.escape_markdown(base.name)}\n\n{count} point{'s' * (count != 1)}"
        store.write_text(base / "table.md", f"{title}\n\n{tables.markdown(list(shown), shown)}")
        if any(row.reference == "traced" and row.psnr is not None for row in shown):
            plot.panels(base / "chart.png", shown, title=base.name.replace("_", " "))
    log.info("sweep: %d points in %s", count, base / "table.md")


def _rows(base: Path) -> list[Row]:
    """The rows of every point, each with its point's name: its folder below `base`."""
    rows = []
    for name, file in sorted(_score_files(base), key=lambda found: _natural(found[0])):
        try:
            found, _ = score.read(file)
        except PrtnetError as error:
            log.warning("sweep: %s: left out", error)
            continue
        rows += [replace(row, point=name) for row in found]
    return rows


def _score_files(base: Path) -> Iterator[tuple[str, Path]]:
    # points are named by what is swept, KEY=VALUE; a value that is a path makes folders of its own
    for folder in base.iterdir():
        if "=" in folder.name and folder.is_dir():
            for file in folder.rglob("score.json"):
                yield file.parent.relative_to(base).as_posix(), file


def _natural(name: str) -> list[tuple[bool, float, str]]:
    """A key that sorts width=8 before width=16."""
    parts = re.split(r"(\d+(?:\.\d+)?)", name)
    return [(bool(i % 2), float(part) if i % 2 else 0.0, part) for i, part in enumerate(parts)]
