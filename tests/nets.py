"""Nets with random weights, for the tests of everything that reads a NetSpec."""

from itertools import pairwise

import numpy as np

from prtnet import sh
from prtnet.encoding import HashGrid, encoded_size
from prtnet.netspec import NetSpec


def random_net(
    *,
    width: int = 8,
    depth: int = 2,
    position_frequencies: int = 3,
    normal_frequencies: int = 2,
    bands: int = 5,
    groups: int = 1,
    encoding: str = "frequency",
    grids: tuple[np.ndarray, ...] = (),
    hashes: tuple[HashGrid, ...] = (),
    texels: tuple[np.ndarray, ...] = (),
    seed: int = 0,
    **fields: object,
) -> NetSpec:
    """He-scaled weights: values keep their size through the layers, as in a trained net."""
    rng = np.random.default_rng(seed)
    inputs = encoded_size(position_frequencies, normal_frequencies, encoding)
    inputs += sum(grid.shape[3] for grid in grids) + sum(each.table.shape[1] for each in hashes)
    inputs += sum(each.shape[2] for each in texels)
    sizes = [inputs, *[width] * depth, groups * sh.count(bands)]
    weights = tuple(
        (rng.normal(size=(rows, columns)) * np.sqrt(2 / columns)).astype(np.float32)
        for columns, rows in pairwise(sizes)
    )
    biases = tuple((0.1 * rng.normal(size=rows)).astype(np.float32) for rows in sizes[1:])
    return NetSpec(
        weights=weights,
        biases=biases,
        position_frequencies=position_frequencies,
        normal_frequencies=normal_frequencies,
        bands=bands,
        groups=groups,
        encoding=encoding,
        grids=grids,
        hashes=hashes,
        texels=texels,
        **fields,  # pyright: ignore[reportArgumentType]
    )


def random_grid(x: int, y: int, z: int, channels: int = 8, kind: str = "float16", seed: int = 0) -> np.ndarray:
    """A grid of features of a NetSpec."""
    return np.random.default_rng(seed).normal(size=(z, y, x, channels)).astype(kind)


def random_hash(cells: int, entries: int = 256, channels: int = 4, kind: str = "float16", seed: int = 0) -> HashGrid:
    """A hashed grid of features of a NetSpec."""
    return HashGrid(cells, np.random.default_rng(seed).normal(size=(entries, channels)).astype(kind))


def random_texels(x: int, y: int, channels: int = 4, kind: str = "float16", seed: int = 0) -> np.ndarray:
    """An image of features of a NetSpec."""
    return random_grid(x, y, 1, channels, kind, seed)[0]


def random_uv(count: int, seed: int = 0) -> np.ndarray:
    """Coordinates in [0, 1]^2, float32."""
    return np.random.default_rng(seed).random((count, 2), np.float32)


def random_points(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Positions in [-1, 1]^3 and unit normals, float32."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return rng.uniform(-1, 1, (count, 3)).astype(np.float32), normals.astype(np.float32)
