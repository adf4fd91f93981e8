"""Labels of a chart, each at a free place beside its point."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import product
from math import cos, hypot, pi, sin

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.transforms import Bbox

Array = np.ndarray
Place = tuple[float, float]

LEADER = 12  # pixels: a label further than this from its point is tied to it by a line
STEP = 4  # pixels between the places at which a line is looked at


@dataclass
class Labels:
    """Labels still to be written beside their points, and the boxes they must keep off. All in pixels."""

    points: list[tuple[float, float, float, str, str]] = field(default_factory=list)  # x, y, radius, text, colour
    taken: list[Bbox] = field(default_factory=list)

    def write(self, axes: Axes) -> None:
        """Each label at the nearest free place around its point, with a thin line to it where that is far."""
        inside = axes.get_window_extent().frozen()
        for x, y, radius, text, colour in self.points:
            written = axes.text(x, y, text, transform=None, color=colour, size=9, ha="left", va="bottom", zorder=4)
            extent = written.get_window_extent()
            places = list(_places(x, y, radius, extent.width, extent.height))
            taken = extents(self.taken)
            costs = [_cost((x, y), radius, place, taken, inside) for place in places]
            box = places[costs.index(min(costs))]
            written.set_position((box.x0, box.y0))
            near, dots = _leader((x, y), radius, box)
            self.taken += [box, *dots]
            if dots:
                axes.plot((x, near[0]), (y, near[1]), transform=None, color=colour, linewidth=0.7, zorder=2)


def overlap(a: Float[Array, "n 4"], b: Float[Array, "m 4"]) -> float:
    """Pixels squared that the boxes (x0, y0, x1, y1) of two lists share."""
    low, high = np.maximum(a[:, None, :2], b[:, :2]), np.minimum(a[:, None, 2:], b[:, 2:])
    return float(np.prod(np.maximum(high - low, 0), axis=-1).sum())


def extents(boxes: Iterable[Bbox]) -> Float[Array, "n 4"]:
    """(x0, y0, x1, y1) of each box."""
    return np.array([box.extents for box in boxes], np.float64).reshape(-1, 4)


def _places(x: float, y: float, radius: float, width: float, height: float) -> Iterator[Bbox]:
    """Boxes around a point, the nearest first: right, above, below, left, then between these."""
    for distance, turn in product((4, 14, 26, 40, 58, 80), (0, 2, 6, 4, 1, 7, 3, 5)):
        right, up = round(cos(turn * pi / 4), 9), round(sin(turn * pi / 4), 9)
        reach = radius + distance
        left = x + right * reach - width * (1 - right) / 2
        bottom = y + up * reach - height * (1 - up) / 2
        yield Bbox.from_bounds(left, bottom, width, height)


def _leader(point: Place, radius: float, box: Bbox) -> tuple[Place, list[Bbox]]:
    """Where the line from a point meets its label, and small boxes along it; none where they are so near that there is
    no line."""
    (x, y), near = point, (min(max(point[0], box.x0), box.x1), min(max(point[1], box.y0), box.y1))
    length = hypot(near[0] - x, near[1] - y)
    if length <= radius + LEADER:
        return near, []
    shares = [reach / length for reach in range(round(radius) + STEP, round(length) - STEP, STEP)]
    return near, [
        Bbox.from_bounds(x + share * (near[0] - x) - 1, y + share * (near[1] - y) - 1, 2, 2) for share in shares
    ]


def _cost(point: Place, radius: float, box: Bbox, taken: Float[Array, "n 4"], inside: Bbox) -> float:
    """Pixels squared that a label and its line would hide, or lose beyond the axes."""
    _, dots = _leader(point, radius, box)
    lost = box.width * box.height - overlap(extents([box]), extents([inside]))
    return overlap(extents([box, *dots]), taken) + 4 * lost
