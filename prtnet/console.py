"""What a person sees while long work runs: an estimate before it, a progress line with rate and ETA during it."""

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

log = logging.getLogger(__name__)


def duration(seconds: float) -> str:
    """3.2 s, 4 min 10 s, 2 h 5 min."""
    if seconds < 60:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


def size(count: float) -> str:
    """Bytes in the largest decimal unit that leaves at least one whole."""
    for unit in ("B", "kB", "MB"):
        if count < 999.5:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} GB"


def estimate(title: str, *, seconds: float, memory: float, disk: float) -> None:
    """One line before long work: time, memory and bytes on disk."""
    log.info("%s: about %s, %s of memory, %s on disk", title, duration(seconds), size(memory), size(disk))


@contextmanager
def progress(title: str, total: int, unit: str) -> Iterator[Callable[[int], None]]:
    """A line with rate and ETA; the block receives `reach(count)`. A log file gets a line every ten seconds."""
    live = sys.stderr.isatty()
    with tqdm(
        total=total,
        desc=title,
        unit=f" {unit}",
        unit_scale=True,
        mininterval=0.2 if live else 10.0,
        leave=False,
        dynamic_ncols=live,
    ) as bar:

        def reach(count: int) -> None:
            bar.update(count - bar.n)

        yield reach
