"""Charts of the study of data-driven transfer."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from prtnet.chart import plot
from prtnet.score import Row

CURVES = {
    "elements": "elements of the basis",
    "points": "measurement points",
    "ridge": "lambda",
    "configurations": "configurations learned from",
    "noise": "noise of a texel, over the lightmaps' RMS",
}
ACROSS = {"noise": "noise"}  # the figure that stands for what varies, where it is not of the same name
KINDS = ("spot", "point", "directional", "environment")
MOST = 2.0  # what errors are shown up to: without a lambda they are millions
Curves = dict[str, dict[str, list[dict[str, Any]]]]


def curves(path: Path, found: Curves) -> None:
    """Write a PNG: a panel for all that varies, with a colour for each database that was learned from; solid on unseen
    lights, dashed the projection, dotted on the lights learned from."""
    words = [word for word in found if word.startswith("trained_on_")]
    figure = plot.canvas(14.4, 7.6)
    for place, (what, label) in enumerate(CURVES.items()):
        column, row = place % 3, place // 3
        axes = figure.add_axes((0.06 + 0.325 * column, 0.575 - 0.49 * row, 0.265, 0.385))
        plot.dress(axes)
        for colour, word in zip(plot.COLOURS, words, strict=False):
            _curve(axes, found[word].get(what, []), ACROSS.get(what, what), colour)
        axes.set_xscale("symlog", linthresh=1e-4) if what == "ridge" else axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_ylim(top=min(axes.get_ylim()[1], MOST))
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_minor_formatter(NullFormatter())
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        values = sorted({line[what] for word in words for line in found[word].get(what, [])})
        if what not in ACROSS and what != "ridge":
            axes.set_xticks(values)
        axes.set_xlabel(label, color=plot.INK)
        if column == 0:
            axes.set_ylabel("error, over the lightmaps' RMS", color=plot.INK)
    _legend(figure, words)
    plot.save(figure, path)


def _curve(axes: Axes, lines: Sequence[dict[str, Any]], across: str, colour: str) -> None:
    values = [line[across] for line in lines]
    for name, style in (("unseen", "-o"), ("projection", "--"), ("training", ":")):
        axes.plot(values, [line[name] for line in lines], style, color=colour, linewidth=1.4, markersize=3.5)


def _legend(figure: Any, words: Sequence[str]) -> None:
    """In the place of the sixth panel."""
    axes = figure.add_axes((0.7, 0.085, 0.275, 0.385))
    axes.set_axis_off()
    for colour, word in zip(plot.COLOURS, words, strict=False):
        axes.plot([], [], "-o", color=colour, markersize=3.5, label=word.replace("_", " "))
    for style, label in (("-", "unseen lights"), ("--", "their projection on the basis"), (":", "lights learned from")):
        axes.plot([], [], style, color=plot.FAINT, label=label)
    axes.legend(frameon=False, labelcolor=plot.INK, loc="center")


def failure(path: Path, found: Curves) -> None:
    """Write a PNG: for each database a group of bars, a bar for each kind of light that it is lit by; the dark part is
    what the projection leaves. The axis ends at 1.2: an error of 1 is that of no indirect light at all."""
    words = [word for word in found if word.startswith("trained_on_") and found[word].get("lights")]
    figure = plot.canvas(10.2, 3.8)
    axes = figure.add_axes((0.07, 0.16, 0.91, 0.79))
    plot.dress(axes)
    axes.axhline(1, color=plot.FAINT, linestyle="--", linewidth=1)
    for place, word in enumerate(words):
        by_kind = {line["kind"]: line for line in found[word]["lights"]}
        for number, kind in enumerate(KINDS):
            if kind in by_kind:
                at, line = place + 0.2 * (number - 1.5), by_kind[kind]
                label = f"lit by {kind}" if place == 0 else None
                axes.bar(at, min(line["unseen"], 1.2), 0.18, color=plot.COLOURS[number], alpha=0.55, label=label)
                axes.bar(at, min(line["projection"], 1.2), 0.18, color=plot.COLOURS[number])
                high = min(line["unseen"], 1.2)
                axes.text(at, high + 0.01, f"{line['unseen']:.2f}", ha="center", size=7, color=plot.FAINT)
    axes.set_xticks(range(len(words)), [word.removeprefix("trained_on_") for word in words])
    axes.set_xlabel("trained on", color=plot.INK)
    axes.set_ylim(0, 1.3)
    axes.set_ylabel("error, over the lightmaps' RMS", color=plot.INK)
    axes.legend(frameon=False, labelcolor=plot.INK, ncols=4, loc="upper center", fontsize=9)
    plot.save(figure, path)


def methods(path: Path, rows: Sequence[Row]) -> None:
    """Write a PNG: PSNR of every method against multiply-adds, bytes and time, a line of panels for each scene."""
    plot.panels(path, dict.fromkeys(rows), title="Light between surfaces, under light from far away")
