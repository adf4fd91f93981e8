"""What the study of stability shows: a chart of all cases, a sheet of crops, and the table of its page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from experiments.stability.cases import Case
from prtnet import store
from prtnet.chart import plot
from prtnet.chart.sheet import grid

Array = np.ndarray
Image = Float[Array, "h w 3"]
Row = Mapping[str, Any]
ORDER = ("vertex", "texture", "net")
COLUMNS = ("traced", *ORDER)
ACROSS = 4
START, END = "<!-- figures -->\n", "<!-- end -->\n"


def line(rows: Sequence[Row]) -> str:
    """One value for the terminal."""
    found = "  ".join(f"{row['method']} {row['psnr']:.2f} dB, worst {row['worst']:.3f}" for row in rows)
    return f"{rows[0]['case']} {rows[0]['value']}: {found}  floor {rows[0]['floor']:.2f}"


def chart(path: Path, cases: Sequence[Case], rows: Sequence[Row]) -> None:
    """Write a PNG with a panel for each case: PSNR of the three methods and their noise floor by what varies."""
    shown = [case for case in cases if any(row["case"] == case.name for row in rows)]
    across = min(len(shown), ACROSS)
    down = -(-len(shown) // across)
    figure = Figure(figsize=(4.3 * across, 3.0 * down + 0.4), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(down, across, squeeze=False)
    for axes, case in zip(panels.flat, shown, strict=False):
        _panel(axes, case, [row for row in rows if row["case"] == case.name])
    for axes in panels.flat[len(shown) :]:
        axes.set_axis_off()
    for axes in panels[:, 0]:
        axes.set_ylabel("PSNR against traced, dB", color=plot.INK, size=9)
    handles, names = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper left", ncols=4, frameon=False, labelcolor=plot.INK)
    figure.savefig(path, format="png", metadata={"Software": None})


def _panel(axes: Axes, case: Case, rows: Sequence[Row]) -> None:
    labels = [value.label for value in case.values]
    for colour, method in zip(plot.COLOURS, ORDER, strict=False):
        found = {row["value"]: row["psnr"] for row in rows if row["method"] == method}
        axes.plot(labels, [found[label] for label in labels], "-o", markersize=4, color=colour, label=method)
    floors = {row["value"]: row["floor"] for row in rows}
    axes.plot(labels, [floors[label] for label in labels], "--", color=plot.FAINT, label="noise floor")
    axes.set_title(case.name.replace("_", " "), loc="left", color=plot.INK, size=11, weight="bold")
    axes.set_xlabel(case.axis, color=plot.INK, size=9)
    axes.tick_params(colors=plot.FAINT, labelsize=8)
    axes.margins(x=0.12)
    axes.grid(True, color=plot.GRID)


def crop(frames: Mapping[str, Sequence[Image]], covered: Sequence[Bool[Array, "h w"]]) -> list[Image]:
    """Half the side of the view where the three methods are wrong the most, at the place of it; the reference first."""
    total = [
        mask * sum(np.square(frames[method][view] - frames["traced"][view]).sum(axis=-1) for method in ORDER)
        for view, mask in enumerate(covered)
    ]
    view = int(np.argmax([error.mean() for error in total]))
    half = len(total[view]) // 2
    sums = np.pad(total[view], ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    windows = sums[half:, half:] - sums[:-half, half:] - sums[half:, :-half] + sums[:-half, :-half]
    y, x = np.unravel_index(np.argmax(windows), windows.shape)
    return [frames[name][view][y : y + half, x : x + half] for name in COLUMNS]


def keep(out: Path, case: Case, crops: Sequence[Image]) -> None:
    """Keep a case's crops, so that the sheet shows those of earlier runs as well. See `sheet`."""
    store.save_arrays(_kept(out, case), dict(zip(COLUMNS, crops, strict=True)))


def sheet(path: Path, cases: Sequence[Case], out: Path) -> None:
    """Write a JPEG of all crops that were kept, a row for each case; none where there are none."""
    rows = {}
    for case in cases:
        if _kept(out, case).exists():
            arrays = store.load_arrays(_kept(out, case))
            rows[f"{case.name}: {case.shown}"] = [arrays[name] for name in COLUMNS]
    if rows:
        grid(path, rows, COLUMNS, title="Where methods differ the most from traced pixels", cell=256)


def _kept(out: Path, case: Case) -> Path:
    return out / "crops" / f"{case.name}.safetensors"


def table(cases: Sequence[Case], rows: Sequence[Row]) -> str:
    """The figures in Markdown, PSNR / p999 / worst of each method."""
    lines = ["| case | value | vertex | texture | net | floor |", "|---|---|---|---|---|---|"]
    for case in cases:
        own = {(row["value"], row["method"]): row for row in rows if row["case"] == case.name}
        for value in case.values if own else ():
            found = [own[value.label, method] for method in ORDER]
            cells = [f"{row['psnr']:.1f} / {row['p999']:.2f} / {row['worst']:.2f}" for row in found]
            lines.append(f"| {case.name} | {value.label} | {' | '.join(cells)} | {found[0]['floor']:.1f} |")
    return "".join(f"{each}\n" for each in lines)


def update(page: Path, cases: Sequence[Case], rows: Sequence[Row]) -> None:
    """Write the figures anew into the page, between its two marks."""
    before, _, rest = page.read_text(encoding="utf-8").partition(START)
    store.write_text(page, before + START + table(cases, rows) + END + rest.partition(END)[2])
