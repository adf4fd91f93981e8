"""The certificates of a sweep over forms of export as one table.

    python experiments/exports/report.py runs/exports

takes every point of the sweep, with what `frames.py` has left there, checks its files against its certificate, and
writes certificates.csv (all figures), certificates.md (the main ones), chart.png and command.txt into
experiments/exports/results/.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from experiments import collect
from experiments.exports import frames
from prtnet import PrtnetError, netspec, score, store
from prtnet.chart import plot, tables
from prtnet.export import bundle, certificate
from prtnet.pipeline import drawn_by

RESULTS = Path(__file__).parent / "results"
Row = dict[str, Any]

NET = "net.safetensors"
ERRORS = {  # of a certificate, and how a column says it
    "coefficients": "coefficients",
    "diffuse shading": "diffuse",
    "diffuse shading, light folded": "folded",
    "glossy shading": "glossy",
    "torch": "torch",
}
UNBOUND = (("torch", "bound"),)  # nothing that is exported
FILES = ("transfer.glsl", "irradiance.glsl", "shading.glsl", bundle.WEIGHTS, NET)
COLUMNS = (
    *("point", "width", "depth", "form", "macs", "executed", "device", "validated", "points"),
    *(f"{name}_{what}" for name in ERRORS.values() for what in ("max", "mean", "bound") if (name, what) not in UNBOUND),
    *(
        "first_draw_cpu_s",
        "frame_of_points",
        "points_ms",
        "frame",
        "ms",
        "ms_ratio",
        "cpu_ms",
        "cpu_ratio",
        "psnr",
        "psnr_texture",
    ),
    *(f"bytes_{name}" for name in FILES),
)
FORMS = ("literal", "texture", "ubo", drawn_by.DEFERRED)


def gather(sweep: Path) -> list[Row]:
    """A row for each point, by width and then by form. Raises PrtnetError where there is none, or where files are not
    those that were measured, or frames were not timed."""
    found = [_row(path.parent) for path in sorted(sweep.glob(f"*/{certificate.NAME}"))]
    if not found:
        raise PrtnetError(f"{sweep}: found no point with {certificate.NAME}, expected a finished sweep with nets")
    return sorted(found, key=lambda row: (row["width"], row["depth"], FORMS.index(row["form"]), row["point"]))


def _row(point: Path) -> Row:
    facts, net = certificate.check(point), netspec.load(point / NET)
    options = yaml.safe_load((point / "config.yaml").read_text(encoding="utf-8"))
    by = drawn_by.chosen(options["render"]["net"], net)
    sizes = facts["net"]["layers"][1:-1]
    row: Row = {
        "point": point.name.partition("=")[2] or point.name,
        "width": max(sizes, default=0),
        "depth": len(sizes),
        "form": facts["form"]["storage"] if by == drawn_by.SHADER else by,
        "macs": facts["net"]["macs"],
    }
    return row | (_shader(point, facts) if by == drawn_by.SHADER else _deferred(point, facts)) | _frames(point, options)


def _shader(point: Path, facts: Row) -> Row:
    row: Row = {"executed": facts["executed"], "device": facts.get("device"), "validated": facts["validated"]}
    row["points"] = sum(facts["points"].values())
    for key, name in ERRORS.items():
        row |= {f"{name}_{what}": value for what, value in facts["errors"].get(key, {}).items()}
    if timing := facts.get("timing"):
        row["first_draw_cpu_s"], row["points_ms"] = timing["first_draw_cpu_seconds"], timing["milliseconds"]
        row["frame_of_points"] = timing["frame"][0]
    files = [name for name in FILES if name in facts["files"]]
    return row | {f"bytes_{name}": (point / name).stat().st_size for name in files}


def _deferred(point: Path, facts: Row) -> Row:
    """No shader has part in it: its coefficients are torch's, its shading that of NumPy."""
    error = facts["errors"]["torch"]
    row: Row = {"executed": True, "device": "torch on the CPU", "points": sum(facts["points"].values())}
    row |= {f"{name}_{what}": error[what] for name in ("coefficients", "torch") for what in error}
    return row | {f"bytes_{NET}": (point / NET).stat().st_size}


def _frames(point: Path, options: Row) -> Row:
    rows, _ = score.read(point / "score.json")
    found = {row.method: row for row in rows if row.reference == "traced"}
    net, texture = found["net"], found["texture"]
    return {
        "frame": options["render"]["size"],
        "ms": net.ms,
        "ms_ratio": net.ms_ratio,
        "psnr": net.psnr,
        "psnr_texture": texture.psnr,
        **_cpu(point),
    }


def _cpu(point: Path) -> Row:
    path = point / frames.NAME
    if not path.exists():
        raise PrtnetError(f"{path}: no such file, expected what experiments/exports/frames.py writes; run it first")
    found = json.loads(path.read_text(encoding="utf-8"))
    return {"cpu_ms": found["net"], "cpu_ratio": found["ratio"]}


def markdown(rows: list[Row]) -> str:
    """The main figures, a line for each point."""
    titles = ["net", "form", "MACs", "coefficient, max", "mean", "diffuse", "glossy", "first draw", "frame"]
    titles += ["shader", "weights", "PSNR"]
    body = [[_net(row), *(write(row.get(key)) for key, write in CELLS)] for row in rows]
    marks = [":--", ":--", *["--:"] * (len(titles) - 2)]
    return "\n".join(f"| {' | '.join(line)} |" for line in (titles, marks, *body)) + "\n"


def _net(row: Row) -> str:
    return f"{row['width']} x {row['depth']}"


def _or_dash(write: Callable[[Any], str]) -> Callable[[Any], str]:
    return lambda value: "-" if value is None else write(value)


ERROR = _or_dash(lambda value: f"{value:.1e}")
SIZE = _or_dash(tables.size)
CELLS: tuple[tuple[str, Callable[[Any], str]], ...] = (
    ("form", str),
    ("macs", _or_dash(tables.count)),
    ("coefficients_max", ERROR),
    ("coefficients_mean", ERROR),
    ("diffuse_max", ERROR),
    ("glossy_max", ERROR),
    ("first_draw_cpu_s", _or_dash(lambda value: f"{value:.2f} s")),
    ("cpu_ratio", _or_dash(tables.ratio)),
    ("bytes_transfer.glsl", SIZE),
    (f"bytes_{bundle.WEIGHTS}", SIZE),
    ("psnr", _or_dash(tables.decimals(2))),
)


def chart(path: Path, rows: list[Row]) -> None:
    """Write a PNG: what a frame and a first draw cost by the size of the net, a line for each form."""
    figure = plot.canvas(9.6, 3.6)
    panels = (
        ("cpu_ratio", "CPU time of a frame, over that of the texture method"),
        ("first_draw_cpu_s", "first draw, CPU-seconds"),
    )
    for place, (key, label) in enumerate(panels):
        axes = figure.add_axes((0.07 + 0.49 * place, 0.15, 0.42, 0.72))
        plot.dress(axes)
        for colour, form in zip(plot.COLOURS, FORMS, strict=False):
            shown = [row for row in rows if row["form"] == form and row.get(key)]
            if shown:
                across, up = [row["macs"] for row in shown], [row[key] for row in shown]
                axes.loglog(across, up, "-o", color=colour, label=form, markersize=5)
        axes.set_xticks(sorted({row["macs"] for row in rows}))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: tables.count(float(value))))
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_xlabel("multiply-adds of the net", color=plot.INK)
        axes.set_title(label, loc="left", color=plot.INK, size=11)
        if place == 0:
            axes.legend(frameon=False, labelcolor=plot.INK)
    plot.save(figure, path)


def report(sweep: Path, results: Path) -> list[Row]:
    """Write the results of a sweep; pictures that are there stay."""
    rows = gather(sweep)
    results.mkdir(parents=True, exist_ok=True)
    collect.write_csv(results / "certificates.csv", COLUMNS, rows)
    store.write_text(results / "certificates.md", markdown(rows))
    collect.write_command(results / "command.txt", [sweep])
    chart(results / "chart.png", rows)
    return rows


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    print(markdown(report(Path(sys.argv[1]), RESULTS)), end="")
