"""Gather finished runs into experiments/results/NAME: rows, table, chart and contact sheets, small enough to keep.

    python experiments/collect.py first_light runs/first_light/*
    python experiments/collect.py recipes default=runs/a published=runs/b

A folder may be named: its networks are then listed as `net NAME`, so that runs of one scene can stand side by side.
"""

import shutil
import sys
from dataclasses import replace
from pathlib import Path

from PIL import Image

from prtnet import score, store
from prtnet.chart import plot, tables

RESULTS = Path(__file__).parent / "results"


def rows_of(label: str, run: Path) -> list[score.Row]:
    """The rows of a run, its nets under their label."""
    rows, _ = score.read(run / "score.json")
    return [replace(row, method=f"net {label}") if label and row.method == "net" else row for row in rows]


def collect(name: str, runs: list[tuple[str, Path]]) -> None:
    """Write the results of a study. What several runs share (texture, noise floor) is listed once."""
    folder = RESULTS / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    rows: dict[tuple[str, ...], score.Row] = {}
    for label, run in runs:
        for row in rows_of(label, run):
            rows.setdefault((row.scene, row.method, row.material, row.light, row.reference), row)
        sheet = folder / f"{'_'.join(filter(None, (rows_of(label, run)[0].scene, label)))}.jpg"
        Image.open(run / "contact_sheet.png").convert("RGB").save(sheet, quality=82)
    kept = list(rows.values())
    score.write(folder / "score.json", kept, score.versions())
    store.write_text(folder / "table.md", tables.markdown(kept))
    plot.pareto(folder / "chart.png", kept, title=name.replace("_", " "))
    print(tables.table(kept))


def _named(argument: str) -> tuple[str, Path]:
    label, _, path = argument.partition("=")
    # the folders of sweeps have a "=" in their own names
    return ("", Path(argument)) if Path(argument).is_dir() else (label, Path(path))


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    collect(sys.argv[1], [_named(argument) for argument in sys.argv[2:]])
