"""Score rows as text: a table for the terminal, the same in Markdown, and the cells that the report lays out.

Rows of one scene, material and light stand together, those against `traced` first, methods by name, the noise floor of
a reference after the methods. The best number of a column is marked where methods compared with the same reference
differ in it.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

from prtnet.score import Row

WIDTH = 120  # characters of the terminal's table
NAME_WIDTH = 36  # characters a name may take in a table

Group = tuple[str, str, str]  # scene, material, light


def decimals(digits: int) -> Callable[[float], str]:
    """A formatter with so many digits after the point."""
    return lambda value: f"{value:.{digits}f}"


def count(value: float) -> str:
    """17300 -> 17.3k: three significant digits and k, M or G."""
    if value < 1000:
        return f"{value:.0f}"
    power = min(int(math.log10(float(f"{value:.3g}")) // 3), 3)
    return f"{value / 1000**power:.3g}{'kMG'[power - 1]}"


def size(value: float) -> str:
    """Bytes in decimal units: 117440512 -> 117 MB."""
    text = count(value)
    return f"{text[:-1]} {text[-1]}B" if text[-1].isalpha() else f"{text} B"


def duration(value: float) -> str:
    """Seconds as 0.52 s, 12.3 s, 3.4 min or 2.1 h."""
    for unit, length in (("h", 3600.0), ("min", 60.0)):
        if value >= 1.5 * length:
            return f"{value / length:.1f} {unit}"
    return f"{value:.3g} s"


def milliseconds(value: float) -> str:
    """Three significant digits, never an exponent."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def ratio(value: float) -> str:
    """16.4 -> 16.4x."""
    return f"{milliseconds(value)}x"


def percent(value: float) -> str:
    """0.0123 -> 1.2 %."""
    return f"{100 * value:.1f} %"


@dataclass(frozen=True)
class Column:
    """A column of the table: which key of the row, its title, how to write it, and which end is best."""

    key: str
    title: str
    write: Callable[[Any], str]
    best: Literal["high", "low"] | None = None


COLUMNS = (
    Column("method", "method", str),
    Column("reference", "against", str),
    Column("psnr", "PSNR", decimals(2), "high"),
    Column("psnr_worst", "worst", decimals(2), "high"),
    Column("psnr_full", "frame", decimals(2), "high"),
    Column("ssim", "SSIM", decimals(4), "high"),
    Column("mae", "MAE", decimals(4), "low"),
    Column("flip", "FLIP", decimals(4), "low"),
    Column("ms", "ms", milliseconds, "low"),
    Column("ms_ratio", "time", ratio, "low"),
    Column("macs", "MACs", count, "low"),
    Column("bytes", "size", size, "low"),
    Column("bake_seconds", "bake", duration, "low"),
    Column("train_seconds", "train", duration, "low"),
    Column("clipped", "clipped", percent),
)
EXPENDABLE = ("mae", "psnr_full", "clipped", "flip", "ms", "ssim", "psnr_worst")  # first to go from a table too wide
LEGEND = (
    "PSNR (dB), SSIM, MAE, FLIP on covered pixels, mean of the views; worst: lowest view; frame: PSNR on the full "
    "frame; time: over texture's, or unshadowed's where there is no atlas; MACs: multiply-adds per pixel; "
    "clipped: covered pixels with a negative channel; "
    "noise floor: a reference with another seed against itself. Exact has no spherical harmonics: traced against exact "
    "is the error of SH itself."
)


SPREAD_LEGEND = (
    "After ±: the sample standard deviation of PSNR over the seeds of training, with their number in brackets; all "
    "figures of such a row are means over them."
)


@dataclass(frozen=True)
class Spread:
    """How far the rows of several seeds of training, shown as one, lie apart."""

    psnr: float  # dB, sample standard deviation
    seeds: int


Spreads = Mapping[Row, Spread | None]
NO_SPREADS: Spreads = MappingProxyType({})


@dataclass(frozen=True)
class Cell:
    """What a table shows of one number."""

    text: str
    best: bool = False


@dataclass(frozen=True)
class Grid:
    """The rows of one scene, material and light, written out: lines[i] shows rows[i]."""

    heading: str
    titles: tuple[str, ...]
    rows: tuple[Row, ...]
    lines: tuple[tuple[Cell, ...], ...]


def group_of(row: Row) -> Group:
    """What rows must share to be compared."""
    return row.scene, row.material, row.light


def ordered(rows: Iterable[Row]) -> list[Row]:
    """Groups by name; in each the rows against `traced` first; methods by name, noise floors after them."""

    def place(row: Row) -> tuple[object, ...]:
        against = row.reference != "traced", row.reference
        return group_of(row), against, row.is_noise_floor, row.method, row.macs or 0, row.point or ""

    return sorted(rows, key=place)


def method_name(row: Row) -> str:
    """The method as it is shown, in a sweep with what its point varies."""
    return ", ".join(filter(None, (row.method.replace("_", " "), row.point)))


def grids(rows: Sequence[Row], without: Sequence[str] = (), spreads: Spreads = NO_SPREADS) -> list[Grid]:
    """One grid per group, all with the same columns: those that some row has a value for."""
    columns = [
        column
        for column in COLUMNS
        if column.key not in without and any(getattr(row, column.key) is not None for row in rows)
    ]
    groups: dict[Group, list[Row]] = {}
    for row in ordered(rows):
        groups.setdefault(group_of(row), []).append(row)
    return [_grid(group, members, columns, spreads) for group, members in groups.items()]


def _grid(group: Group, rows: list[Row], columns: Sequence[Column], spreads: Spreads) -> Grid:
    views = "/".join(str(count) for count in sorted({row.views for row in rows if not row.is_noise_floor} or {1}))
    heading = f"{' · '.join(group)} ({views} view{'s' * (views != '1')})"
    lines = tuple(tuple(_cell(row, column, rows, spreads.get(row)) for column in columns) for row in rows)
    return Grid(heading, tuple(column.title for column in columns), tuple(rows), lines)


def _cell(row: Row, column: Column, rows: Sequence[Row], spread: Spread | None) -> Cell:
    value = method_name(row) if column.key == "method" else getattr(row, column.key)
    if value is None:
        return Cell("-")
    text = column.write(value)
    if spread and column.key == "psnr":
        text += f" ± {column.write(spread.psnr)} ({spread.seeds})"
    if column.best is None:
        return Cell(_shorten(text) if isinstance(value, str) else text)
    rivals = [other for other in rows if other.reference == row.reference and other.is_method]
    values = [each for each in (getattr(rival, column.key) for rival in rivals) if each is not None]
    if len(set(values)) < 2 or not row.is_method:
        return Cell(text)
    return Cell(text, value == (max(values) if column.best == "high" else min(values)))


def _shorten(text: str, width: int = NAME_WIDTH) -> str:
    line = " ".join(text.split())
    return line if len(line) <= width else line[: width - 1] + "…"


def table(rows: Sequence[Row]) -> str:
    """The rows as aligned text, at most WIDTH characters wide: less important columns are left out where it must be.

    A `*` follows the best number of a column.
    """
    lines, dropped = [" " * (WIDTH + 1)], 0
    while max(map(len, lines), default=0) > WIDTH and dropped <= len(EXPENDABLE):
        lines = [line for grid in grids(rows, EXPENDABLE[:dropped]) for line in _text(grid)]
        dropped += 1
    return "\n".join(lines)


def _text(grid: Grid) -> list[str]:
    body = [[cell.text + ("*" if cell.best else " ") for cell in line] for line in grid.lines]
    names = 2 if "against" in grid.titles else 1
    cells = [[title + " " for title in grid.titles], *body]
    widths = [max(len(line[i]) for line in cells) for i in range(len(grid.titles))]
    lines = [
        " ".join(
            cell.ljust(width) if i < names else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in cells
    ]
    rule = "-" * max(map(len, lines))
    return [_shorten(grid.heading, WIDTH), lines[0], rule, *lines[1:], ""]


def markdown(rows: Sequence[Row], spreads: Spreads = NO_SPREADS) -> str:
    """The rows as Markdown tables, one per scene, material and light, the best numbers bold, and a legend."""
    parts = []
    for grid in grids(rows, spreads=spreads):
        marks = [":--" if title in ("method", "against") else "--:" for title in grid.titles]
        lines = [
            [f"**{cell.text}**" if cell.best else escape_markdown(cell.text) for cell in line] for line in grid.lines
        ]
        body = "\n".join(f"| {' | '.join(line)} |" for line in (grid.titles, marks, *lines))
        parts.append(f"{escape_markdown(grid.heading)}\n\n{body}\n")
    legend = f"{LEGEND} {SPREAD_LEGEND}" if any(spreads.values()) else LEGEND
    return "\n".join([*parts, legend + "\n"])


def escape_markdown(text: str) -> str:
    """Text that Markdown shows as it is, in a table too."""
    text = " ".join(text.split()).replace("&", "&amp;").replace("<", "&lt;")
    return "".join("\\" + letter if letter in "\\|*_`[]" else letter for letter in text)
