"""Gather finished runs into experiments/results/NAME: rows, table, chart and contact sheets, small enough to keep.

    python experiments/collect.py first_light runs/first_light/*
    python experiments/collect.py recipes default=runs/a published=runs/b

A folder may be named: its networks are then listed as `net NAME`, so that runs of one scene can stand side by side.

    python experiments/collect.py --sweep network_size

takes what a sweep has written of itself in runs/network_size into experiments/network_size/results, with the lobes of
its default recipe and the commit it was collected at.
"""

import csv
import json
import shutil
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from PIL import Image

from prtnet import PrtnetError, score, store
from prtnet.chart import plot, tables

STUDIES = Path(__file__).parent
RESULTS = STUDIES / "results"
SUMMARY = ("score.json", "table.md", "chart.png")


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


def collect_sweep(sweep: Path, folder: Path) -> None:
    """Copy a sweep's summary. Its lobes are those of the point `ablation=none` with the first scene and seed."""
    missing = [name for name in (*SUMMARY, "command.txt") if not (sweep / name).exists()]
    lobes = sorted(sweep.glob("*/lobes.png"))
    if missing or not lobes:
        raise PrtnetError(f"{sweep}: no {(missing or ['lobes.png'])[0]}, expected a finished sweep with nets")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in SUMMARY:
        shutil.copyfile(sweep / name, folder / name)
    default = [file for file in lobes if "ablation=none" in file.parent.name.split(",")]
    shutil.copyfile((default or lobes)[0], folder / "lobes.png")
    command = (sweep / "command.txt").read_text(encoding="utf-8")
    store.write_text(folder / "command.txt", f"{command}# collected at commit {commit()}\n")


def commit() -> str:
    """The commit of this checkout, and whether files differ from it."""
    git = ["git", "-C", str(STUDIES)]
    commit = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=True).stdout.strip()
    changed = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", "../prtnet", "../configs"], check=False).returncode
    return f"{commit}{' with changes' if changed else ''}"


def write_csv(path: Path, columns: Iterable[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Rows of figures in four digits, one column for each name."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(columns), lineterminator="\n")
        writer.writeheader()
        writer.writerows({key: _rounded(value) for key, value in row.items()} for row in rows)


def _rounded(value: Any) -> Any:
    return float(f"{value:.4g}") if isinstance(value, float) else value


def write_command(path: Path, sweeps: Sequence[Path]) -> None:
    """What made the results of sweeps: their commands, this commit, the versions of the first."""
    commands = "".join((sweep / "command.txt").read_text(encoding="utf-8") for sweep in sweeps)
    versions = json.dumps(score.read(sweeps[0] / "score.json")[1])
    store.write_text(path, f"{commands}# collected at commit {commit()}\n# {versions}\n")


def _named(argument: str) -> tuple[str, Path]:
    label, _, path = argument.partition("=")
    # the folders of sweeps have a "=" in their own names
    return ("", Path(argument)) if Path(argument).is_dir() else (label, Path(path))


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    if sys.argv[1] == "--sweep":
        for name in sys.argv[2:]:
            collect_sweep(Path("runs") / name, STUDIES / name / "results")
        sys.exit()
    collect(sys.argv[1], [_named(argument) for argument in sys.argv[2:]])
