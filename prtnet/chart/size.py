"""A search for a size as a table for the terminal, the same in Markdown, and a chart of accuracy against cost."""

from pathlib import Path

from matplotlib.axes import Axes

from prtnet.chart import plot, tables
from prtnet.size import Candidate, Found

TITLES = ("network", "MACs", "size", "trained", "PSNR", "in full", "CPU", "verdict")


def table(found: Found, target: float | None) -> str:
    """Text for a terminal: a line for each candidate, the cheapest first, with its longest trial."""
    lines = [list(TITLES), *_lines(found, target)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(TITLES))]
    left = (0, len(TITLES) - 1)
    text = [
        "  ".join(
            cell.ljust(width) if i in left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
    return "\n".join([text[0], "-" * max(map(len, text)), *text[1:]])


def markdown(found: Found, target: float | None) -> str:
    """The same table in Markdown."""
    lines = [list(TITLES), [":--", *["--:"] * (len(TITLES) - 2), ":--"]]
    lines += [[tables.escape_markdown(cell) for cell in line] for line in _lines(found, target)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def verdict(found: Found, candidate: Candidate, target: float | None) -> str:
    """What the search says of a candidate."""
    if candidate == found.choice:
        return "chosen"
    last = found.longest(candidate)
    if target is None:
        return "" if last is None or last.share == 1 else f"left after {_share(last.share)}"
    if last is not None and last.share == 1:
        return "meets the target" if last.psnr >= target else "misses"
    if not found.expected:
        return ""
    likely = found.expected[candidate.name][0] >= target
    places = {each.name: place for place, each in enumerate(found.candidates)}
    if found.choice is not None and places[candidate.name] > places[found.choice.name]:
        return "costs more than the chosen"
    return "in doubt" if likely else "expected to miss"


def picture(path: Path, found: Found, *, target: float | None, floor: float | None, cost: str = "macs") -> None:
    """Write a PNG of PSNR against cost: trials, what is expected of each candidate, the target, the noise floor."""
    figure = plot.canvas(9.0, 5.4)
    axes = figure.add_axes((0.085, 0.115, 0.885, 0.8))
    plot.dress(axes)
    costs = {each.name: getattr(each, cost) for each in found.candidates}
    levels = [each.psnr for each in found.tried] + [value for value, _ in found.expected.values()]
    levels += [level for level in (target, floor) if level is not None]
    plot.fit(axes, list(costs.values()), levels)
    _draw_expected(axes, found, costs)
    _draw_tried(axes, found, costs)
    for level, words, style in ((target, "target", "-"), (floor, "noise floor", (0, (5, 3)))):
        if level is not None:
            axes.axhline(level, color=plot.FAINT, linewidth=1.1, linestyle=style, zorder=1)
            place = axes.get_xlim()[0] * 1.05, level
            axes.annotate(
                f"{words} {level:.1f} dB", place, (0, 3), textcoords="offset points", color=plot.FAINT, size=8.5
            )
    axes.set_xlabel("multiply-adds per pixel" if cost == "macs" else "bytes", color=plot.INK)
    axes.set_ylabel("PSNR against traced, dB", color=plot.INK)
    if found.tried:
        axes.legend(loc="lower right", frameon=False, fontsize=9, labelcolor=plot.INK)
    plot.save(figure, path)


def _draw_expected(axes: Axes, found: Found, costs: dict[str, int]) -> None:
    names = [name for name, (_, spread) in found.expected.items() if spread > 0]
    if names:
        values, spreads = zip(*(found.expected[name] for name in names), strict=True)
        where = [costs[name] for name in names]
        options = {"color": "#aeb5c0", "fmt": "_", "linewidth": 1, "zorder": 2, "label": "expected in full"}
        axes.errorbar(where, values, spreads, **options)


def _draw_tried(axes: Axes, found: Found, costs: dict[str, int]) -> None:
    for place, share in enumerate(sorted({each.share for each in found.tried})):
        trials = [each for each in found.tried if each.share == share]
        where, values = [costs[each.candidate.name] for each in trials], [each.psnr for each in trials]
        colour = plot.COLOURS[0] if share == 1 else "white"
        label = f"trained {_share(share)}"
        size = 22.0 + 14 * place
        axes.scatter(where, values, s=size, facecolor=colour, edgecolor=plot.COLOURS[0], zorder=3, label=label)
    if found.choice is not None and found.best is not None:
        last = found.longest(found.choice)
        assert last is not None
        at = costs[found.choice.name], last.psnr
        axes.scatter(*at, s=220, facecolor="none", edgecolor=plot.COLOURS[1], linewidth=1.6, zorder=4)
        words = plot.plain(found.choice.name)
        axes.annotate(words, at, (10, -14), textcoords="offset points", color=plot.COLOURS[1], size=9.5)


def _lines(found: Found, target: float | None) -> list[list[str]]:
    return [_line(found, candidate, target) for candidate in found.candidates]


def _line(found: Found, candidate: Candidate, target: float | None) -> list[str]:
    last, expected = found.longest(candidate), found.expected.get(candidate.name)
    if expected is None:
        inferred = "-"
    else:
        inferred = f"{expected[0]:.1f} +- {expected[1]:.1f}" if expected[1] else f"{expected[0]:.2f}"
    return [
        candidate.name,
        tables.count(candidate.macs),
        tables.size(candidate.bytes),
        _share(last.share) if last else "-",
        f"{last.psnr:.2f}" if last else "-",
        inferred,
        tables.duration(last.trial.cpu_seconds) if last else "-",
        verdict(found, candidate, target),
    ]


def _share(share: float) -> str:
    return "in full" if share == 1 else f"1/{1 / share:.0f}"
