"""Images between their texel centres, as graphics cards see them close by."""

import numpy as np
from jaxtyping import Float

Array = np.ndarray


def bilinear(image: Float[Array, "h w c"], uv: Float[Array, "n 2"], *, repeat: bool = True) -> Float[Array, "n c"]:
    """A blend of the four texels round each point, whose centres lie at half-integers; row 0 is v = 1.

    Beyond [0, 1] the image is repeated, or its border goes on.
    """
    height, width = image.shape[:2]
    exact = uv.astype(np.float64)
    x, y = exact[:, 0] * width - 0.5, (1 - exact[:, 1]) * height - 0.5
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right, down = (x - column)[:, None], (y - row)[:, None]
    rows, columns = (
        [(first + step) % size if repeat else np.clip(first + step, 0, size - 1) for step in (0, 1)]
        for first, size in ((row, height), (column, width))
    )
    above, below = ((1 - right) * image[r, columns[0]] + right * image[r, columns[1]] for r in rows)
    return (1 - down) * above + down * below
