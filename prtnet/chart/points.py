"""The rows of a sweep side by side: each row once, under the words that tell its point from the others of its group."""

import re
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from prtnet.chart import tables
from prtnet.chart.tables import Spread
from prtnet.score import Row

SEED = "train.seed"  # points that differ in it alone are the same measured several times
# what differs between two measurements of the same thing
MEASURED = ("point", "ms", "ms_ratio", "bake_seconds", "train_seconds")


def side_by_side(rows: Iterable[Row]) -> dict[Row, Spread | None]:
    """Rows for a table or a chart. `point` is what the point varies inside its group (scene, material, light), and None
    where it varies nothing. Points that differ in the seed of training alone are one row, with its spread. Rows that
    several points share, a baseline say, are listed once. Milliseconds are left out: points ran at different times, and
    only the ratio to the baseline of the same run means something."""
    groups: dict[tables.Group, list[Row]] = {}
    for row in rows:
        groups.setdefault(tables.group_of(row), []).append(row)
    return {row: spread for members in groups.values() for row, spread in _distinct(_joined(members))}


def mean(rows: Sequence[Row]) -> tuple[Row, Spread | None]:
    """One row of rows that differ in their figures alone: the mean of each figure, None where one of them lacks it. The
    spread is None where there is nothing to spread: one row, or rows that are the same."""
    figures: dict[str, Any] = {}
    for key, first in asdict(rows[0]).items():
        values = [getattr(row, key) for row in rows]
        if any(value != first for value in values):
            total = None if None in values else statistics.fmean(values)
            figures[key] = round(total) if total is not None and isinstance(first, int) else total
    joined = replace(rows[0], **figures)
    if joined.psnr is None or not figures.keys() - set(MEASURED):
        return joined, None
    return joined, Spread(statistics.stdev(row.psnr or 0.0 for row in rows), len(rows))


def _joined(rows: Iterable[Row]) -> list[tuple[Row, Spread | None]]:
    alike: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        point = ",".join(word for word in _split(row.point or "") if not word.startswith(f"{SEED}="))
        alike.setdefault((row.method, row.reference, point), []).append(replace(row, point=point))
    return [mean(members) for members in alike.values()]


def _distinct(rows: Sequence[tuple[Row, Spread | None]]) -> Iterator[tuple[Row, Spread | None]]:
    own = own_words(row.point or "" for row, _ in rows)
    same: dict[tuple[Any, ...], list[tuple[Row, Spread | None]]] = {}
    for row, spread in rows:
        values = (value for key, value in asdict(row).items() if key not in MEASURED)
        same.setdefault((*values, spread), []).append((row, spread))
    for alike in same.values():
        first, spread = alike[0]
        yield replace(first, point=_name([own[row.point or ""] for row, _ in alike], len(own)), ms=None), spread


def _name(points: Sequence[tuple[str, ...]], count: int) -> str | None:
    """The words that points with the same row share; two names of one point, `a = b`, where they share none though
    others of the `count` points have other rows."""
    words = common(points)
    if words or len(set(points)) == count:
        return ", ".join(words) or None
    return " = ".join(", ".join(each) for each in dict.fromkeys(points))


def own_words(points: Iterable[str]) -> Mapping[str, tuple[str, ...]]:
    """Point's name (`a.x=1,b=2`) -> the words that not all of them have, as `x=1`, or a value that is a name."""
    words = {point: tuple(_split(point)) for point in points}
    shared = set(common(words.values()))
    return {point: tuple(_short(w) for w in found if w not in shared) for point, found in words.items()}


def common(words: Iterable[Sequence[str]]) -> list[str]:
    """The words that are in all of the lists, in the order of the first."""
    lists = list(words)
    return [word for word in lists[0] if all(word in other for other in lists)] if lists else []


def options(point: str) -> dict[str, str | float]:
    """What a point's name (`a.x=1,b=2`) says of each key, numbers as numbers."""
    pairs = (word.partition("=") for word in _split(point))
    return {key: _number(value) for key, _, value in pairs}


def _number(value: str) -> str | float:
    try:
        return float(value)
    except ValueError:
        return value


def _split(point: str) -> list[str]:
    """At commas, but not at those inside of brackets."""
    return re.split(r",(?![^\[({]*[\])}])", point) if point else []


def _short(word: str) -> str:
    key, equals, value = word.partition("=")
    # a name speaks for itself: the value of `train` or of `transfer.kind`
    telling = re.fullmatch(r"\w+", value) and not re.fullmatch(r"[\d_]*|\d+e\d+|true|false|null", value)
    return value if telling else f"{key.split('.')[-1]}{equals}{value}"
