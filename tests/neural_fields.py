"""Networks with random weights that are something like a distance, for the tests of everything that reads a Neural."""

from itertools import pairwise

import numpy as np

from prtnet.data.implicit.neural import Neural


def random_field(width: int = 13, depth: int = 2, seed: int = 0, **fields: object) -> Neural:
    """Waves across the box, of both signs."""
    rng = np.random.default_rng(seed)
    sizes = [3, *[width] * depth, 1]
    weights = [
        (rng.normal(size=(rows, columns)) * (4 if columns == 3 else 1) / np.sqrt(columns)).astype(np.float32)
        for columns, rows in pairwise(sizes)
    ]
    biases = [rng.uniform(-3, 3, rows).astype(np.float32) for rows in sizes[1:]]
    biases[-1] = np.zeros(1, np.float32)
    return Neural(tuple(weights), tuple(biases), **fields)  # pyright: ignore[reportArgumentType]


def waves(amplitude: float = 0.05, turns: float = 16.0, **fields: object) -> Neural:
    """The floor y = amplitude sin(turns x), as near as sines come; the slope is up to hypot(1, amplitude turns)."""
    # y from one slow wave
    slow = 0.05
    weight = np.array([[0, slow, 0], [turns, 0, 0]], np.float32)
    last = np.array([[1 / slow, -amplitude]], np.float32)
    return Neural((weight, last), (np.zeros(2, np.float32), np.zeros(1, np.float32)), **fields)  # pyright: ignore[reportArgumentType]
