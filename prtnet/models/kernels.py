"""Trilinear look-ups in a grid of features and their gradient, compiled for the CPU.

torch's own grid_sample takes as long for two small grids as all layers of a 64 x 4 net together; these loops, which
run over the channels of a cell side by side in memory, take a tenth of that. Sums are in the order of the points, so
equal inputs give equal bytes. The plain twin of `gather` is `prtnet.netspec.trilinear`.
"""

import numpy as np
from numba import njit


@njit(nogil=True, cache=True, inline="always")
def _cell(position, size):
    """Of one axis: the two cells between whose middles a position in [-1, 1] lies, and the share of the second."""
    place = (position + np.float32(1)) * np.float32(0.5) * np.float32(size) - np.float32(0.5)
    place = min(max(place, np.float32(0)), np.float32(size - 1))
    low = min(int(place), max(size - 2, 0))
    return low, min(low + 1, size - 1), place - np.float32(low)


@njit(nogil=True, cache=True)
def gather(grid, positions, found):
    depth, height, width, channels = grid.shape
    for point in range(len(positions)):
        x0, x1, x = _cell(positions[point, 0], width)
        y0, y1, y = _cell(positions[point, 1], height)
        z0, z1, z = _cell(positions[point, 2], depth)
        for channel in range(channels):
            found[point, channel] = 0
        for corner in range(8):
            i, j, k = (x1 if corner & 1 else x0), (y1 if corner & 2 else y0), (z1 if corner & 4 else z0)
            weight = (x if corner & 1 else 1 - x) * (y if corner & 2 else 1 - y) * (z if corner & 4 else 1 - z)
            for channel in range(channels):
                found[point, channel] += np.float32(weight) * grid[k, j, i, channel]


@njit(nogil=True, cache=True)
def scatter(gradient, positions, total):
    depth, height, width, channels = total.shape
    for point in range(len(positions)):
        x0, x1, x = _cell(positions[point, 0], width)
        y0, y1, y = _cell(positions[point, 1], height)
        z0, z1, z = _cell(positions[point, 2], depth)
        for corner in range(8):
            i, j, k = (x1 if corner & 1 else x0), (y1 if corner & 2 else y0), (z1 if corner & 4 else z0)
            weight = (x if corner & 1 else 1 - x) * (y if corner & 2 else 1 - y) * (z if corner & 4 else 1 - z)
            for channel in range(channels):
                total[k, j, i, channel] += np.float32(weight) * gradient[point, channel]
