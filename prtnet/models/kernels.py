"""Trilinear look-ups in grids of features and their gradients, compiled for the CPU.

torch's own grid_sample takes as long for two small grids as all layers of a 64 x 4 net together; these loops, which
run over the channels of a cell side by side in memory, take a tenth of that. Sums are in the order of the points, so
equal inputs give equal bytes. The plain twins of `gather` and `gather_hashed` are `trilinear` and `hashed` of
`prtnet.encoding`.
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


@njit(nogil=True, cache=True, inline="always")
def _weight(right, upper, further, x, y, z):
    """Of a corner of the cell, from the shares of the further corner of each axis."""
    return (x if right else 1 - x) * (y if upper else 1 - y) * (z if further else 1 - z)


@njit(nogil=True, cache=True)
def gather(grid, positions, found):
    depth, height, width, channels = grid.shape
    corners = 8 if depth > 1 else 4  # one slice is an image
    for point in range(len(positions)):
        x0, x1, x = _cell(positions[point, 0], width)
        y0, y1, y = _cell(positions[point, 1], height)
        z0, z1, z = _cell(positions[point, 2], depth)
        for channel in range(channels):
            found[point, channel] = 0
        for corner in range(corners):
            i, j, k = (x1 if corner & 1 else x0), (y1 if corner & 2 else y0), (z1 if corner & 4 else z0)
            weight = _weight(corner & 1, corner & 2, corner & 4, x, y, z)
            for channel in range(channels):
                found[point, channel] += np.float32(weight) * grid[k, j, i, channel]


@njit(nogil=True, cache=True)
def scatter(gradient, positions, total):
    depth, height, width, channels = total.shape
    corners = 8 if depth > 1 else 4
    for point in range(len(positions)):
        x0, x1, x = _cell(positions[point, 0], width)
        y0, y1, y = _cell(positions[point, 1], height)
        z0, z1, z = _cell(positions[point, 2], depth)
        for corner in range(corners):
            i, j, k = (x1 if corner & 1 else x0), (y1 if corner & 2 else y0), (z1 if corner & 4 else z0)
            weight = _weight(corner & 1, corner & 2, corner & 4, x, y, z)
            for channel in range(channels):
                total[k, j, i, channel] += np.float32(weight) * gradient[point, channel]


@njit(nogil=True, cache=True, inline="always")
def _corner(position, half):
    """Of one axis: the corner at or below a position, counted from the cube's middle, and the share of the next one."""
    place = position * half
    low = np.floor(place)
    return np.int32(low), place - low


@njit(nogil=True, cache=True, inline="always")
def _slot(x, y, z, mask):
    """`prtnet.encoding.slot`."""
    return (np.uint32(x) ^ (np.uint32(y) * np.uint32(2654435761)) ^ (np.uint32(z) * np.uint32(805459861))) & mask


@njit(nogil=True, cache=True)
def gather_hashed(table, cells, positions, found):
    entries, channels = table.shape
    half, mask = np.float32(cells) * np.float32(0.5), np.uint32(entries - 1)
    for point in range(len(positions)):
        x0, x = _corner(positions[point, 0], half)
        y0, y = _corner(positions[point, 1], half)
        z0, z = _corner(positions[point, 2], half)
        for channel in range(channels):
            found[point, channel] = 0
        for corner in range(8):
            i, j, k = corner & 1, (corner >> 1) & 1, (corner >> 2) & 1
            weight = _weight(i, j, k, x, y, z)
            entry = _slot(x0 + i, y0 + j, z0 + k, mask)
            for channel in range(channels):
                found[point, channel] += np.float32(weight) * table[entry, channel]


@njit(nogil=True, cache=True)
def scatter_hashed(gradient, cells, positions, total):
    entries, channels = total.shape
    half, mask = np.float32(cells) * np.float32(0.5), np.uint32(entries - 1)
    for point in range(len(positions)):
        x0, x = _corner(positions[point, 0], half)
        y0, y = _corner(positions[point, 1], half)
        z0, z = _corner(positions[point, 2], half)
        for corner in range(8):
            i, j, k = corner & 1, (corner >> 1) & 1, (corner >> 2) & 1
            weight = _weight(i, j, k, x, y, z)
            entry = _slot(x0 + i, y0 + j, z0 + k, mask)
            for channel in range(channels):
                total[entry, channel] += np.float32(weight) * gradient[point, channel]
