"""Cuts a scene into leaves that may have a network each: cells of a box, parts, or as many as are asked for."""

import numpy as np
from jaxtyping import Bool, Float, Float64, Int

from prtnet import PrtnetError
from prtnet.clusters import Plane, Split, leaf_weights
from prtnet.data.scene import Scene

Array = np.ndarray

CHUNK = 1 << 22  # weights of points in leaves that are held at a time
# unit lengths between boxes that touch: cells as float32 is coarse, parts as things are modelled a hair above the floor
_CELLS_TOUCH, _PARTS_TOUCH = 1e-6, 0.01


def grid(low: Float[Array, " 3"], high: Float[Array, " 3"], cells: tuple[int, int, int]) -> Split:
    """Equal cells of a box in unit coordinates, so many along x, y and z. Leaves are counted x first, z last."""
    if min(cells) < 1:
        raise PrtnetError(f"split.cells: found {list(cells)}, expected three numbers of at least 1")
    planes: list[Plane] = []

    def cut(first: tuple[int, ...], counts: tuple[int, ...]) -> int:
        """The tree over `counts` cells from the cell `first` on."""
        axis = int(np.argmax(counts))
        if counts[axis] == 1:
            return -1 - int(np.ravel_multi_index(first[::-1], cells[::-1]))
        half = counts[axis] // 2
        at = low[axis] + (high[axis] - low[axis]) * (first[axis] + half) / cells[axis]
        index = len(planes)
        planes.append(Plane(axis, float(at), 0, 0))
        below = cut(first, _with(counts, axis, half))
        above = cut(_with(first, axis, first[axis] + half), _with(counts, axis, counts[axis] - half))
        planes[index] = planes[index]._replace(below=below, above=above)
        return index

    cut((0, 0, 0), cells)
    return Split(tuple(planes))


def _with(values: tuple[int, ...], axis: int, value: int) -> tuple[int, ...]:
    return (*values[:axis], value, *values[axis + 1 :])


def by_count(positions: Float[Array, "n 3"], count: int) -> Split:
    """`count` leaves of about as many points each, which area-uniform points make leaves of about the same area.

    Each cut is across the longest axis of the points' box, at their median, or where an odd number of leaves is to
    come, at the same share of them: the k-d tree of Bentley 1975.
    """
    if not 1 <= count <= len(positions):
        raise PrtnetError(f"split.count: found {count}, expected 1 to {len(positions)}, the number of points")
    planes: list[Plane] = []
    leaves = 0

    def cut(points: Array, count: int) -> int:
        nonlocal leaves
        if count == 1:
            leaves += 1
            return -leaves
        axis, place = int(np.argmax(np.ptp(points, axis=0))), len(points) * (count // 2) // count
        order = np.argsort(points[:, axis], kind="stable")
        at = float(points[order[place - 1 : place + 1], axis].mean())
        index = len(planes)
        planes.append(Plane(axis, at, 0, 0))
        below, above = cut(points[order[:place]], count // 2), cut(points[order[place:]], count - count // 2)
        planes[index] = planes[index]._replace(below=below, above=above)
        return index

    cut(np.asarray(positions, np.float64), count)
    return Split(tuple(planes))


def leaf_of(split: Split, positions: Float[Array, "n 3"], part: Int[Array, " n"]) -> Int[Array, " n"]:
    """The leaf in which each point lies."""
    found, size = np.empty(len(positions), np.int64), max(1, CHUNK // split.leaves)
    for start in range(0, len(positions), size):
        chunk = slice(start, start + size)
        found[chunk] = leaf_weights(split, 0.0, positions[chunk], part[chunk]).argmax(axis=1)
    return found


def boxes(split: Split, scene: Scene) -> Float64[Array, "leaves 2 3"]:
    """Lowest and highest corner of each leaf in unit coordinates: cells fill the scene's box; parts have their own,
    infinite and inside out where a part has no triangles."""
    if split.parts:
        found = np.stack([np.full((split.parts, 3), np.inf), np.full((split.parts, 3), -np.inf)], axis=1)
        corners = scene.vertices[scene.faces]
        np.minimum.at(found[:, 0], scene.part, corners.min(axis=1))
        np.maximum.at(found[:, 1], scene.part, corners.max(axis=1))
        return found
    found = np.empty((split.leaves, 2, 3))
    found[0] = whole = np.stack([scene.vertices.min(axis=0), scene.vertices.max(axis=0)])
    arriving = {0: whole}
    for index, plane in enumerate(split.planes):
        low, high = arriving.pop(index)
        middle = np.clip(plane.at, low[plane.axis], high[plane.axis])
        for child, corner in ((plane.below, 1), (plane.above, 0)):
            box = np.stack([low, high])
            box[corner, plane.axis] = middle
            if child >= 0:
                arriving[child] = box
            else:
                found[-1 - child] = box
    return found


def touching(split: Split, boxes: Float64[Array, "leaves 2 3"]) -> Bool[Array, "leaves leaves"]:
    """Whether two cells share a face, or the boxes of two parts touch, an edge or a corner being enough for them."""
    low, high = boxes[:, 0], boxes[:, 1]
    overlap = np.minimum(high[:, None], high) - np.maximum(low[:, None], low)
    near = np.asarray((overlap >= -(_PARTS_TOUCH if split.parts else _CELLS_TOUCH)).all(axis=2))
    if not split.parts:
        # a scene without height has cells without height
        flat = (high - low <= _CELLS_TOUCH).all(axis=0)
        near = near & ((overlap > _CELLS_TOUCH)[..., ~flat].sum(axis=2) >= (~flat).sum() - 1)
    np.fill_diagonal(near, False)
    return near


def nearest(boxes: Float64[Array, "leaves 2 3"], occupied: Bool[Array, " leaves"]) -> Int[Array, " leaves"]:
    """Each occupied leaf itself, and for each other one the occupied leaf whose box is nearest, the middles of the
    boxes deciding between equals."""
    low, high, found = boxes[:, 0], boxes[:, 1], np.arange(len(boxes))
    some = np.flatnonzero(occupied)
    for leaf in np.flatnonzero(~occupied):
        gap = np.linalg.norm(np.clip(np.maximum(low[leaf] - high[some], low[some] - high[leaf]), 0, None), axis=1)
        if np.isfinite(low[leaf]).all():
            middles = np.linalg.norm((low[leaf] + high[leaf] - low[some] - high[some]) / 2, axis=1)
            found[leaf] = some[np.lexsort((middles, gap.round(6)))[0]]
        else:
            found[leaf] = some[0]
    return found
