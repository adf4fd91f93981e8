"""The points of the sweep `large_scene` as one table, a chart of merging, and a sheet of views.

    python experiments/large_scene/report.py runs/large_scene runs/modern_hall

takes every point of these sweeps, counts what its networks hold, and writes networks.csv (all figures), networks.md
(the main ones), chart.png, sheet.jpg (views of the colonnade) and command.txt into
experiments/large_scene/results/.
"""

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from experiments import collect
from prtnet import PrtnetError, clusters, netspec, score, store
from prtnet.chart import plot, sheet, tables
from prtnet.netspec import NetSpec

RESULTS = Path(__file__).parent / "results"
Row = dict[str, Any]

LARGE, WHOLE = "one_large", "clusters_12"  # the words that are held against each other
SHOWN = 3  # views of the sheet
COLUMNS = (
    *("scene", "point", "method", "networks", "parameters", "bytes", "macs", "psnr", "psnr_worst", "noise_floor"),
    *("border_worst", "border_mean", "across", "beside", "ms", "ms_ratio", "train_seconds", "transfer_rmse"),
)


def gather(sweeps: Sequence[Path]) -> list[Row]:
    """A row for each point. Raises PrtnetError for a sweep that has none."""
    found = []
    for sweep in sweeps:
        points = sorted(path.parent for path in sweep.glob("*/score.json"))
        if not points:
            raise PrtnetError(f"{sweep}: found no point with score.json, expected a finished sweep")
        found += [row for point in points for row in _rows(point)]
    return sorted(found, key=lambda row: (row["scene"], row["method"] == "clusters", -row["networks"], row["point"]))


def _rows(point: Path) -> list[Row]:
    rows, _ = score.read(point / "score.json")
    seams = json.loads((point / "score.json").read_text(encoding="utf-8")).get("seams", {})
    floor = next((row.psnr for row in rows if row.is_noise_floor and row.reference == "traced"), None)
    word = dict(pair.split("=") for pair in point.name.split(",") if "=" in pair).get("ablation", point.name)
    made = []
    for row in rows:
        if row.reference != "traced" or row.method not in ("net", "clusters"):
            continue
        nets = _nets(point, row.method)
        figures = {name: getattr(row, name) for name in COLUMNS if hasattr(row, name)}
        figures |= {"point": word, "networks": len(nets), "noise_floor": floor}
        figures["parameters"] = sum(_parameters(net) for net in nets)
        made.append(figures | _seam(seams.get(row.method)))
    return made


def _nets(point: Path, method: str) -> tuple[NetSpec, ...]:
    return (
        clusters.load(point / "clusters").nets if method == "clusters" else (netspec.load(point / "net.safetensors"),)
    )


def _parameters(net: NetSpec) -> int:
    return sum(each.size for each in (*net.weights, *net.biases, *net.grids, *(table for _, table in net.hashes)))


def _seam(found: Row | None) -> Row:
    """The worst border, and the mean jumps of all borders, each by its length."""
    if not found or found["worst"] is None:
        return {}
    pairs = np.array([border["pairs"] for border in found["borders"]], np.float64)
    jumps = {name: [border[name] for border in found["borders"]] for name in ("across", "beside")}
    means = {name: float(np.average(values, weights=pairs)) for name, values in jumps.items()}
    return {"border_worst": found["worst"], "border_mean": found["mean"]} | means


def _or_dash(write: Callable[[Any], str]) -> Callable[[Any], str]:
    return lambda value: "-" if value is None else write(value)


CELLS: tuple[tuple[str, str, Callable[[Any], str]], ...] = (
    ("networks", "networks", str),
    ("parameters", "parameters", _or_dash(tables.count)),
    ("bytes", "bytes", _or_dash(tables.size)),
    ("macs", "MACs per pixel", _or_dash(tables.count)),
    ("psnr", "PSNR", _or_dash(tables.decimals(2))),
    ("psnr_worst", "worst view", _or_dash(tables.decimals(2))),
    ("border_worst", "worst border", _or_dash(tables.ratio)),
    ("border_mean", "mean border", _or_dash(tables.ratio)),
    ("ms_ratio", "frame", _or_dash(tables.ratio)),
    ("train_seconds", "training", _or_dash(tables.duration)),
)


def markdown(rows: list[Row]) -> str:
    """The main figures, a line for each network or set of networks."""
    titles = ["scene", "point", "what", *(title for _, title, _ in CELLS)]
    marks = [":--"] * 3 + ["--:"] * len(CELLS)
    body = [
        [row["scene"], row["point"], row["method"], *(write(row.get(key)) for key, _, write in CELLS)] for row in rows
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in (titles, marks, *body)) + "\n"


def chart(path: Path, rows: list[Row]) -> None:
    """Write a PNG: accuracy against that of the one large net, by the number of networks that merging leaves and by
    bytes; a line for each scene, and a cross for the one small net."""
    figure = plot.canvas(9.6, 3.6)
    panels = (("networks", "networks"), ("bytes", "bytes of all networks"))
    for place, (key, label) in enumerate(panels):
        axes = figure.add_axes((0.07 + 0.49 * place, 0.16, 0.42, 0.74))
        plot.dress(axes)
        axes.axhline(0, color=plot.FAINT, linestyle="--", linewidth=1)
        for colour, scene in zip(plot.COLOURS, sorted({row["scene"] for row in rows}), strict=False):
            of_scene = [row for row in rows if row["scene"] == scene]
            large = next((row["psnr"] for row in of_scene if row["point"] == LARGE), None)
            if large is None:
                continue
            for method, mark in (("clusters", "-o"), ("net", "x")):
                shown = [row for row in of_scene if row["method"] == method and row["point"] != LARGE]
                across, up = [row[key] for row in shown], [row["psnr"] - large for row in shown]
                axes.plot(across, up, mark, color=colour, label=scene if mark == "-o" else None, markersize=5)
        axes.set_xlabel(label, color=plot.INK)
        if key == "bytes":
            axes.xaxis.set_major_formatter(lambda value, _: tables.size(float(value)))
        else:
            axes.set_ylabel("PSNR less that of one large net, dB", color=plot.INK)
            axes.legend(frameon=False, labelcolor=plot.INK)
    plot.save(figure, path)


def views(path: Path, large: Path, whole: Path) -> None:
    """Write a JPEG: views traced, by the large net and by clusters, errors beside them; clusters in false colours in
    the first view. Cut out of the points' contact sheets, which have one layout."""
    found = {name: _cells(point) for name, point in (("large", large), ("whole", whole))}
    size, colours = len(found["whole"][0]["traced"]), _picture(whole / "clusters.png")
    rows: dict[str, list[Any]] = {}
    for number in sheet.chosen(len(found["whole"]), SHOWN):
        one, many = found["large"][number], found["whole"][number]
        shown = [many["traced"], one["net"], one["net error"], many["clusters"], many["clusters error"]]
        rows[f"view {number + 1}"] = [*shown, None if rows else colours[:, :size]]
    titles = ("traced", "one large net", "its error x8", "12 clusters", "their error x8", "which is where")
    sheet.grid(path, rows, titles, title="colonnade: one large network, and a small one in each of 12 cells", cell=size)


def _cells(point: Path) -> list[dict[str, Any]]:
    """By view: picture by method, and `METHOD error`."""
    rows, _ = score.read(point / "score.json")
    # kept frames come back by name
    methods = sorted(row.method for row in rows if row.reference == "traced" and row.is_method)
    image, size = _picture(point / "contact_sheet.png"), rows[0].views
    names = ["traced", *(name for method in methods for name in (method, f"{method} error"))]
    side = _side(image, len(methods))
    plan = sheet.layout(size, len(methods), (side, side))
    found = []
    for row in range(plan.rows):
        corners = [plan.corner(row, column) for column in range(plan.columns)]
        found.append({name: image[y : y + side, x : x + side] for name, (x, y) in zip(names, corners, strict=True)})
    return found


def _side(image: Any, methods: int) -> int:
    """Of the pictures on a contact sheet as wide as this one."""
    plain = sheet.layout(1, methods, (1, 1), cell=1)
    return (image.shape[1] - plain.sheet[0]) // plain.columns + 1


def _picture(path: Path) -> Any:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), np.float32) / 255


def report(sweeps: Sequence[Path], results: Path) -> list[Row]:
    """Write the results of sweeps; the views are those of the first."""
    rows = gather(sweeps)
    results.mkdir(parents=True, exist_ok=True)
    collect.write_csv(results / "networks.csv", COLUMNS, rows)
    store.write_text(results / "networks.md", markdown(rows))
    collect.write_command(results / "command.txt", sweeps)
    chart(results / "chart.png", rows)
    large, whole = (sorted(sweeps[0].glob(f"ablation={word},*")) for word in (LARGE, WHOLE))
    if large and whole:
        views(results / "sheet.jpg", large[0], whole[0])
    return rows


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    print(markdown(report([Path(argument) for argument in sys.argv[1:]], RESULTS)), end="")
