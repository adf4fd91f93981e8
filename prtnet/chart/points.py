"""The rows of a sweep side by side: each row once, under the words that tell its point from the others of its group."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from prtnet.chart import tables
from prtnet.score import Row

# what differs between two measurements of the same thing
MEASURED = ("point", "ms", "ms_ratio", "bake_seconds", "train_seconds")


def side_by_side(rows: Iterable[Row]) -> list[Row]:
    """Rows for a table or a chart. `point` is what the point varies inside its group (scene, material, light), and None
    where it varies nothing. Rows that several points share, a baseline say, are listed once. Milliseconds are left out:
    points ran at different times, and only the ratio to the texture of the same run means something."""
    groups: dict[tables.Group, list[Row]] = {}
    for row in rows:
        groups.setdefault(tables.group_of(row), []).append(row)
    return [row for members in groups.values() for row in _distinct(members)]


def _distinct(rows: Sequence[Row]) -> list[Row]:
    own = own_words(row.point or "" for row in rows)
    same: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        same.setdefault(tuple(v for key, v in asdict(row).items() if key not in MEASURED), []).append(row)
    return [
        replace(alike[0], point=", ".join(common(own[row.point or ""] for row in alike)) or None, ms=None)
        for alike in same.values()
    ]


def own_words(points: Iterable[str]) -> Mapping[str, tuple[str, ...]]:
    """Point's name (`a.x=1,b=2`) -> the words that not all of them have, as `x=1`, or a value that is a name."""
    words = {point: tuple(_split(point)) for point in points}
    shared = set(common(words.values()))
    return {point: tuple(_short(w) for w in found if w not in shared) for point, found in words.items()}


def common(words: Iterable[Sequence[str]]) -> list[str]:
    """The words that are in all of the lists, in the order of the first."""
    lists = list(words)
    return [word for word in lists[0] if all(word in other for other in lists)] if lists else []


def _split(point: str) -> list[str]:
    """At commas, but not at those inside of brackets."""
    return re.split(r",(?![^\[({]*[\])}])", point) if point else []


def _short(word: str) -> str:
    key, equals, value = word.partition("=")
    # a name speaks for itself: the value of `train` or of `transfer.kind`
    telling = value.isidentifier() and value not in ("true", "false", "null")
    return value if telling else f"{key.split('.')[-1]}{equals}{value}"
