"""What a sweep found: score.json, table.md and chart.png beside its points, made anew as each of them ends."""

import logging
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from prtnet import PrtnetError, score, store
from prtnet.chart import plot, points, tables
from prtnet.score import Row

log = logging.getLogger(__name__)


def summarise(base: Path) -> None:
    """Write the summary of all points below a sweep's folder that have been scored; what fails leaves the rest."""
    # points that end together write one after the other, so that the last one has seen them all
    with store.alone(base / ".sweep.lock"):
        rows = _rows(base)
        if not rows:
            return
        score.write(base / "score.json", rows, score.versions())
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
