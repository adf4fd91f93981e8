"""Charts: speed against accuracy with its Pareto front, and the training curve."""

from collections.abc import Iterable, Mapping, Sequence
from io import BytesIO
from itertools import pairwise
from math import log10, pi
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from matplotlib.transforms import Bbox

from prtnet import PrtnetError, store
from prtnet.chart import tables
from prtnet.chart.labels import Labels
from prtnet.chart.tables import Spread
from prtnet.score import Row

COLOURS = ("#0b6fb8", "#c8501e", "#2a8a5b", "#8e4fa8", "#b08a00", "#c0397a", "#4c5f73", "#5b9bd5")
INK, FAINT, GRID = "#22262d", "#6a7280", "#e4e7ec"
PANELS = (("macs", "multiply-adds per pixel"), ("ms_ratio", "time of a frame, over the baseline's"))
SWEEP_PANELS = (PANELS[0], ("bytes", "bytes"), PANELS[1])
FAR = 1.0  # what lies this many times the range of the swept points above or below them is no part of the axes


def pareto(path: Path, rows: Sequence[Row], *, reference: str = "traced", title: str = "") -> None:
    """Write a PNG of PSNR against multiply-adds and against time: up and left is better.

    Only rows against `reference` are drawn; the front and the noise floor are those of one scene, material and light.
    With several of these a colour stands for each, else for each method. A point's area grows with its bytes.
    """
    groups = _groups(rows, reference)
    figure = canvas(12.0, 5.4)
    figure.suptitle(plain(title or "Speed against accuracy"), x=0.06, ha="left", color=INK, weight="bold", size=14)
    for place, (key, label) in enumerate(PANELS):
        axes = figure.add_axes((0.06 + 0.485 * place, 0.115, 0.435, 0.765))
        _panel(axes, groups, key)
        axes.set_xlabel(label, color=INK)
        axes.set_ylabel(f"PSNR against {reference}, dB" if place == 0 else "", color=INK)
    save(figure, path)


def panels(path: Path, rows: Mapping[Row, Spread | None], *, reference: str = "traced", title: str = "") -> None:
    """Write a PNG of the rows of a sweep, with the bars of their spread: for each scene, material and light a line of
    panels of PSNR against multiply-adds, bytes and time. The noise floor stands in words where it is far above."""
    groups = _groups(rows, reference)
    figure = canvas(5.4 * len(SWEEP_PANELS), 4.4 * len(groups) + 0.5)
    height = figure.get_figheight()
    figure.suptitle(plain(title), x=0.02, y=1 - 0.15 / height, ha="left", color=INK, weight="bold", size=14)
    for line, (group, members) in enumerate(groups.items()):
        low = (4.4 * (len(groups) - 1 - line) + 0.6) / height
        for column, (key, label) in enumerate(SWEEP_PANELS):
            left = (column + 0.11) / len(SWEEP_PANELS)
            axes = figure.add_axes((left, low, 0.86 / len(SWEEP_PANELS), 3.5 / height))
            _panel(axes, {group: members}, key, rows)
            axes.set_xlabel(label, color=INK)
            if column == 0:
                axes.set_title(plain(" · ".join(group)), loc="left", color=INK, size=11)
                axes.set_ylabel(f"PSNR against {reference}, dB", color=INK)
    save(figure, path)


def _groups(rows: Iterable[Row], reference: str) -> dict[tables.Group, list[Row]]:
    groups: dict[tables.Group, list[Row]] = {}
    for row in tables.ordered(rows):
        if row.reference == reference and row.psnr is not None:
            groups.setdefault(tables.group_of(row), []).append(row)
    if not groups:
        raise PrtnetError(f"chart: found no row against {reference!r}, expected at least one")
    return groups


def training_curve(target: Path | BytesIO, history: Sequence[tuple[int, float]]) -> None:
    """Write a PNG of the loss against the step, on a logarithmic axis where all losses are above zero."""
    figure = canvas(8.0, 3.2)
    axes = figure.add_axes((0.09, 0.16, 0.885, 0.79))
    dress(axes)
    steps, losses = [step for step, _ in history], [loss for _, loss in history]
    axes.plot(steps, losses, color=COLOURS[0], linewidth=1.4, marker="o" if len(steps) < 3 else "")
    if losses and min(losses) > 0 and max(losses) > 1.5 * min(losses):
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_xlabel("step", color=INK)
    axes.set_ylabel("training loss", color=INK)
    save(figure, target)


def front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The points (cost, accuracy) that no other beats in both, by growing cost."""
    best: list[tuple[float, float]] = []
    for cost, accuracy in sorted(points, key=lambda point: (point[0], -point[1])):
        if not best or accuracy > best[-1][1]:
            best.append((cost, accuracy))
    return best


def canvas(width: float, height: float) -> Figure:
    """An empty white figure, in inches."""
    figure = Figure(figsize=(width, height), dpi=110, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure, target: Path | BytesIO) -> None:
    """Write a PNG, to a path atomically."""
    # no program or version goes into the file, so that equal inputs give equal bytes
    options: dict[str, Any] = {"format": "png", "metadata": {"Software": None}}
    if isinstance(target, Path):
        with store.atomic(target) as temporary:
            figure.savefig(temporary, **options)
    else:
        figure.savefig(target, **options)


def plain(text: str) -> str:
    """Text that matplotlib does not take for mathematics."""
    return " ".join(text.split()).replace("$", r"\$")


def dress(axes: Axes) -> None:
    axes.grid(True, color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(which="both", colors=FAINT, labelsize=9)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color("#b6bcc6")


def _panel(
    axes: Axes,
    groups: dict[tables.Group, list[Row]],
    key: str,
    spreads: Mapping[Row, Spread | None] | None = None,
) -> None:
    """One panel. `spreads` are those of a sweep, whose points are named by what they vary and are all of one size."""
    dress(axes)
    rows = [row for members in groups.values() for row in members]
    far: list[Row] = []
    if spreads is not None:
        rows, far = _near(rows)
        groups = {group: [row for row in members if row in rows] for group, members in groups.items()}
    points = [row for row in rows if getattr(row, key) is not None and getattr(row, key) > 0 and not row.is_noise_floor]
    if not points:
        axes.set(xticks=[], yticks=[])
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", color=FAINT)
        return
    bars = [_reach(row, spreads) for row in rows]
    ends = [(row.psnr or 0.0) + end for row, bar in zip(rows, bars, strict=True) for end in (-bar, bar)]
    fit(axes, [getattr(row, key) for row in points], ends)
    colours = _colours(groups, points)
    labels = Labels()
    _note(axes, far, labels)
    for group, members in groups.items():
        ours = [row for row in points if tables.group_of(row) == group]
        line = "#aeb5c0" if len(groups) == 1 else colours[group]
        _draw_front(axes, [(getattr(row, key), row.psnr or 0.0) for row in ours], line, labels)
        for floor in (row for row in members if row.is_noise_floor):
            colour = FAINT if len(groups) == 1 else colours[group]
            _draw_floor(axes, floor.psnr or 0.0, colour, labels)
        for row in ours:
            colour = colours[group] if len(groups) > 1 else colours[row.method]
            if spreads is None:
                _draw_point(axes, row, key, colour, labels)
            else:
                # in a sweep with nets these are what it is about
                text = row.point if row.method == "net" and row.point else tables.method_name(row)
                _draw_sweep_point(axes, row, key, colour, labels, text.replace("_", " "), _reach(row, spreads))
    if len(groups) > 1:
        handles = [axes.plot([], [], "o", color=colours[group], label=plain(" · ".join(group)))[0] for group in groups]
        figure = axes.figure
        figure.legends.clear()
        figure.legend(handles=handles, loc="upper right", ncols=4, frameon=False, fontsize=9, labelcolor=INK)
    labels.write(axes)


def _near(rows: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    """The rows of a sweep that its axes cover, and those so far above or below what is swept that it would be squeezed
    together: often textures and noise floors."""
    levels = [row.psnr or 0.0 for row in rows if row.point and row.is_method] or [row.psnr or 0.0 for row in rows]
    reach = FAR * max(max(levels) - min(levels), 2.0)
    near = [row for row in rows if min(levels) - reach <= (row.psnr or 0.0) <= max(levels) + reach]
    return near, [row for row in rows if row not in near]


def _reach(row: Row, spreads: Mapping[Row, Spread | None] | None) -> float:
    """Half the length of a row's bar, dB."""
    spread = spreads.get(row) if spreads else None
    return spread.psnr if spread else 0.0


def _note(axes: Axes, far: Sequence[Row], labels: Labels) -> None:
    """Words at the upper edge for what the axes do not cover."""
    inside = axes.get_window_extent().frozen()
    for line, row in enumerate(far):
        above = (row.psnr or 0.0) > axes.get_ylim()[1]
        words = f"{'above' if above else 'below'} these axes: {tables.method_name(row)} {row.psnr:.1f} dB"
        place = inside.x0 + 5, inside.y1 - 14 - 14 * line
        text = axes.text(*place, plain(words), transform=None, color=FAINT, size=8.5)
        labels.taken.append(text.get_window_extent())


def _colours(groups: dict[tables.Group, list[Row]], points: Sequence[Row]) -> dict[Any, str]:
    names: list[Any] = list(groups) if len(groups) > 1 else sorted({row.method for row in points})
    return {name: COLOURS[index % len(COLOURS)] for index, name in enumerate(names)}


def fit(axes: Axes, costs: Sequence[float], accuracies: Sequence[float]) -> None:
    """A logarithmic cost axis and a linear accuracy axis, with room for labels around the outermost points."""
    axes.set_xscale("log")
    low, high = log10(min(costs)), log10(max(costs))
    pad = max(0.14 * (high - low), 0.4)
    axes.set_xlim(10 ** (low - pad), 10 ** (high + pad))
    narrow = high - low + 2 * pad < 2
    pad = max(0.12 * (max(accuracies) - min(accuracies)), 2.5)
    axes.set_ylim(min(accuracies) - pad, max(accuracies) + pad)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if narrow else (1.0,)))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}" if value < 1 else tables.count(value)))


def _draw_front(axes: Axes, points: Sequence[tuple[float, float]], colour: str, labels: Labels) -> None:
    best = front(points)
    if not best:
        return
    costs = [best[0][0], *(cost for cost, _ in best), axes.get_xlim()[1]]
    accuracies = [axes.get_ylim()[0], *(accuracy for _, accuracy in best), best[-1][1]]
    axes.plot(costs, accuracies, drawstyle="steps-post", color=colour, linewidth=1.2, alpha=0.6, zorder=1)
    corners = axes.transData.transform([(c, a) for c, a in zip(costs, accuracies, strict=True)])
    for (x, y), (right, above) in pairwise(corners):
        labels.taken.append(Bbox.from_extents(x - 1, y - 1, right + 1, y + 1))
        labels.taken.append(Bbox.from_extents(right - 1, y - 1, right + 1, above + 1))


def _draw_floor(axes: Axes, level: float, colour: str, labels: Labels) -> None:
    axes.axhline(level, color=colour, linewidth=1.1, linestyle=(0, (5, 3)), zorder=1)
    place = axes.get_window_extent().x0 + 5, axes.transData.transform((1.0, level))[1] + 4
    text = axes.text(*place, f"noise floor {level:.1f} dB", transform=None, color=colour, size=8.5)
    inside = axes.get_window_extent().frozen()
    labels.taken += [text.get_window_extent(), Bbox.from_bounds(inside.x0, place[1] - 5, inside.width, 2)]


def _draw_point(axes: Axes, row: Row, key: str, colour: str, labels: Labels) -> None:
    place = getattr(row, key), row.psnr or 0.0
    area = 45.0 if row.bytes is None else min(max(55 * log10(max(row.bytes, 10)) - 130, 45), 420)
    axes.scatter(
        *place, s=area, facecolor="none" if row.bytes is None else colour, edgecolor=colour, alpha=0.85, zorder=3
    )
    radius = (area / pi) ** 0.5 * axes.figure.dpi / 72
    x, y = axes.transData.transform(place)
    labels.taken.append(Bbox.from_extents(x - radius, y - radius, x + radius, y + radius))
    text = tables.method_name(row) + ("" if row.bytes is None else f" · {tables.size(row.bytes)}")
    labels.points.append((x, y, radius, plain(text), colour))


def _draw_sweep_point(axes: Axes, row: Row, key: str, colour: str, labels: Labels, text: str, reach: float) -> None:
    cost, accuracy = getattr(row, key), row.psnr or 0.0
    bar = {"elinewidth": 1.1, "capsize": 3, "capthick": 1.1}
    axes.errorbar(cost, accuracy, reach or None, fmt="o", color=colour, markersize=5.5, alpha=0.9, zorder=3, **bar)
    (x, low), (_, high) = axes.transData.transform([(cost, accuracy - reach), (cost, accuracy + reach)])
    radius = 5.0
    labels.taken.append(Bbox.from_extents(x - radius, low - radius, x + radius, high + radius))
    labels.points.append((x, (low + high) / 2, radius, plain(text), colour))
