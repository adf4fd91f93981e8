"""The sweep `data_driven` as tables, charts and a sheet of views.

    python -m experiments.data_driven.report runs/data_driven

writes tables (*.md), all curves (curves.csv), curves.png, failure.png, methods.png, views.jpg and command.txt into
experiments/data_driven/results/, and the tables into experiments/data_driven/README.md as well.
"""

import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from experiments import collect
from experiments.data_driven import charts
from prtnet import PrtnetError, score, store
from prtnet.chart import sheet, tables

HERE = Path(__file__).parent
KINDS = ("spot", "point", "directional", "environment")
ORDER = [*(f"trained_on_{name}" for name in (*KINDS, "all", "colours")), "separate_channels", "display_space"]
FIGURES = ("training", "unseen", "projection", "coloured")
# of a point that has no other methods: what is drawn beside the method itself
PICTURES = ("direct", "data_driven", "projection", "lightmap", score.NOISE_FLOOR)
SHOWN = ("trained_on_spot", "trained_on_directional", "trained_on_all")  # whose views are shown
Line = dict[str, Any]
Curves = dict[str, dict[str, list[Line]]]  # point -> what varies -> lines


def word_of(folder: Path) -> str:
    """What the point varies."""
    words = dict(pair.split("=", 1) for pair in folder.name.split(",") if "=" in pair)
    return words.get("ablation", folder.name)


def points_of(sweep: Path) -> dict[str, Path]:
    """Finished points by their words, in the order of `ORDER`. Raises PrtnetError for a sweep that has none."""
    found = {word_of(file.parent): file.parent for file in sorted(sweep.glob("*/score.json"))}
    if not found:
        raise PrtnetError(f"{sweep}: found no point with a score.json, expected a finished sweep")
    return {word: found[word] for word in sorted(found, key=lambda word: ORDER.index(word) if word in ORDER else 99)}


def curves_of(points: dict[str, Path]) -> Curves:
    """Of the points that have them."""
    files = {word: folder / "curves.json" for word, folder in points.items()}
    return {word: json.loads(file.read_text(encoding="utf-8")) for word, file in files.items() if file.exists()}


def markdown(titles: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> str:
    """A table of which the first columns are `words`, the others numbers."""
    marks = [":--"] * words + ["--:"] * (len(titles) - words)
    return "\n".join(f"| {' | '.join(line)} |" for line in (titles, marks, *rows)) + "\n"


def lights(curves: Curves) -> str:
    """Trained on one kind of light, lit by another: the error, and that of the projection behind a stroke."""
    rows = []
    for word, found in curves.items():
        by_kind = {line["kind"]: line for line in found.get("lights", [])}
        if word.startswith("trained_on_") and by_kind:
            cells = [_pair(by_kind.get(kind)) for kind in KINDS]
            rows.append([word.removeprefix("trained_on_"), *cells])
    return markdown(["trained on", *(f"lit by {kind}" for kind in KINDS)], rows)


def _pair(line: Line | None) -> str:
    return f"{line['unseen']:.3f} / {line['projection']:.3f}" if line else "-"


def varied(curves: Curves, what: str) -> str:
    """All points' lines of what varies, side by side: error on unseen lights / of the projection."""
    found = {word: {line[what]: line for line in each.get(what, [])} for word, each in curves.items()}
    found = {word: each for word, each in found.items() if each and word.startswith("trained_on_")}
    values = sorted({value for each in found.values() for value in each})
    rows = [[f"{value:g}", *(_pair(each.get(value)) for each in found.values())] for value in values]
    return markdown([what, *(word.removeprefix("trained_on_") for word in found)], rows, 0)


def large(curves: Curves) -> str:
    """Points and configurations of the point that has most of both."""
    found = curves.get("large_database", {})
    rows = [
        [what, str(line[what]), *_figures(line)[:3]]
        for what in ("points", "configurations")
        for line in found.get(what, [])
    ]
    return markdown(["of the large database", "first", *FIGURES[:3]], rows)


def noise(curves: Curves) -> str:
    """Error on unseen lights by the share of the rays that lightmaps have."""
    found = {word: each["noise"] for word, each in curves.items() if each.get("noise") and _is_trained(word)}
    rows = [
        [word.removeprefix("trained_on_"), f"1/{1 / line['rays']:.0f}", f"{line['noise']:.3f}", _pair(line)]
        for word, lines in found.items()
        for line in lines
    ]
    return markdown(["trained on", "rays", "noise of a texel", "unseen"], rows)


def _is_trained(word: str) -> bool:
    return word.startswith("trained_on_")


def spaces(curves: Curves) -> str:
    """Channels and gamma: errors on training lights, unseen ones, and these in saturated colours."""
    rows = [
        [word.removeprefix("trained_on_"), line["channels"], f"{line['gamma']:g}", *_figures(line)]
        for word, found in curves.items()
        if _is_trained(word)
        for line in found.get("spaces", [])
    ]
    return markdown(["trained on", "channels", "gamma", *FIGURES], rows, 2)


def _figures(line: Line) -> list[str]:
    return [f"{line[name]:.3f}" if name in line else "-" for name in FIGURES]


def matrices(curves: Curves) -> str:
    """A matrix for each pose, or one for all."""
    lines = next((found["matrices"] for found in curves.values() if found.get("matrices")), [])
    return markdown(["matrices", *FIGURES[:3]], [[line["matrices"], *_figures(line)[:3]] for line in lines])


def drawn(points: dict[str, Path]) -> str:
    """PSNR of pictures against path tracing, of every point that the method has by itself."""
    rows = []
    for word, folder in points.items():
        of = {row.method: row for row in score.read(folder / "score.json")[0]}
        if "path_traced" not in {row.reference for row in of.values()}:
            continue
        cells = [f"{of[name].psnr:.1f}" if name in of and of[name].psnr is not None else "-" for name in PICTURES]
        rows.append([word.replace("_", " "), *cells])
    return markdown(["point", *(name.replace("_", " ") for name in PICTURES)], rows)


def methods_rows(points: dict[str, Path]) -> list[score.Row]:
    """Rows of the points that have all methods, against their reference."""
    chosen = [folder for word, folder in points.items() if word.startswith("methods_")]
    rows = [row for folder in chosen for row in score.read(folder / "score.json")[0]]
    return [row for row in rows if row.reference == "traced"]


def methods(rows: Sequence[score.Row]) -> str:
    """Every method on the same views: bytes, milliseconds, accuracy."""
    cells = [
        [
            *(row.scene.replace("_", " "), row.method.replace("_", " ")),
            *(_or_dash(row.psnr, tables.decimals(2)), _or_dash(row.psnr_worst, tables.decimals(2))),
            *(_or_dash(row.bytes, tables.size), _or_dash(row.ms_ratio, tables.ratio)),
            *(_or_dash(row.macs, tables.count), _or_dash(row.bake_seconds, tables.duration)),
            _or_dash(row.train_seconds, tables.duration),
        ]
        for row in rows
    ]
    titles = ["scene", "method", "PSNR", "worst", "bytes", "frame", "MACs", "bake", "training"]
    return markdown(titles, cells, 2)


def _or_dash(value: Any, write: Any) -> str:
    return "-" if value is None else write(value)


def flat(curves: Curves) -> list[Line]:
    """Every line of every point, with the point and what varies in it."""
    return [
        {"point": word, "curve": what} | line
        for word, found in curves.items()
        for what, lines in found.items()
        for line in lines
    ]


def fill(text: str, made: dict[str, str]) -> str:
    """A page with what stands between <!-- NAME --> and <!-- end --> made anew."""

    def block(found: re.Match[str]) -> str:
        name = found.group(1)
        return f"<!-- {name} -->\n\n{made[name]}\n<!-- end -->" if name in made else found.group(0)

    return re.sub(r"<!-- (\w+) -->\n.*?<!-- end -->", block, text, flags=re.DOTALL)


def views(points: dict[str, Path], path: Path) -> None:
    """A view under one light of each kind: path traced, direct, and by each database of `SHOWN` with its error; cut out
    of their contact sheets, which have the path-traced picture first and each method's error beside it."""
    words = [word for word in SHOWN if word in points and (points[word] / "contact_sheet.png").exists()]
    if not words:
        return
    found = {word: _cells(points[word] / "contact_sheet.png") for word in words}
    first = found[words[0]]
    rows: dict[str, list[Any]] = {}
    for number, kind in enumerate(KINDS[: len(first)]):
        # methods by name: data_driven comes before direct
        learned = [cell for word in words for cell in found[word][number][1:3]]
        rows[f"lit by {kind}"] = [first[number][0], first[number][3], *learned]
    titles = [title for word in words for title in (word.removeprefix("trained_on_"), "its error x8")]
    title = "cornell: an operator that has learned from lights of one kind, or of all, under unseen lights"
    sheet.grid(path, rows, ["path traced", "direct light", *titles], title=title, cell=len(first[0][0]))


def _cells(path: Path) -> list[list[Any]]:
    """Pictures of a contact sheet by row and column."""
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("RGB"), np.float32) / 255
    columns = 1 + 2 * len(PICTURES[:-1])
    side = (pixels.shape[1] - sheet.Layout(1, columns, 0, 0).sheet[0]) // columns
    frame = sheet.Layout(0, columns, side, side)
    count = (pixels.shape[0] - frame.sheet[1]) // (side + frame.caption)
    corners = [[frame.corner(row, column) for column in range(columns)] for row in range(count)]
    return [[pixels[y : y + side, x : x + side] for x, y in row] for row in corners]


def report(sweep: Path, page: Path) -> dict[str, str]:
    """Write the results beside the page, and the page's tables; these by name."""
    points, results = points_of(sweep), page.parent / "results"
    curves, rows = curves_of(points), methods_rows(points)
    made = {"lights": lights(curves), "spaces": spaces(curves), "matrices": matrices(curves), "noise": noise(curves)}
    made |= {name: varied(curves, name) for name in ("elements", "points", "ridge", "configurations")}
    made |= {"drawn": drawn(points), "methods": methods(rows), "large_points": large(curves)}
    # of experiments/data_driven/directional.py, where it has been run
    if (results / "directional.md").exists():
        made["directional"] = (results / "directional.md").read_text(encoding="utf-8")
    results.mkdir(parents=True, exist_ok=True)
    for name, text in made.items():
        store.write_text(results / f"{name}.md", text)
    lines = flat(curves)
    if lines:
        collect.write_csv(results / "curves.csv", dict.fromkeys(key for line in lines for key in line), lines)
        charts.curves(results / "curves.png", curves)
        charts.failure(results / "failure.png", curves)
    if rows:
        score.write(results / "methods.json", rows, score.versions())
        charts.methods(results / "methods.png", rows)
    views(points, results / "views.jpg")
    command = (sweep / "command.txt").read_text(encoding="utf-8") if (sweep / "command.txt").exists() else ""
    store.write_text(results / "command.txt", f"{command}# collected at commit {collect.commit()}\n")
    if page.exists():
        store.write_text(page, fill(page.read_text(encoding="utf-8"), made))
    return made


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    print("\n".join(report(Path(sys.argv[1]), HERE / "README.md").values()))
