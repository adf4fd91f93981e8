"""Albedo at points of surfaces: the part's factor times its texture, as the shaders see it close by (bilinear)."""

import numpy as np
from jaxtyping import Float, Float32, Int

from prtnet.data.scene import Scene

Array = np.ndarray


def albedo(scene: Scene, face: Int[Array, " n"], weights: Float[Array, "n 3"]) -> Float32[Array, "n 3"]:
    """Linear RGB at barycentric weights of faces of `scene`, whole or split into sides."""
    part = scene.part[face]
    out = np.stack([material.albedo for material in scene.materials])[part].astype(np.float32)
    if scene.uv is None:
        return out
    uv = np.einsum("ni,nij->nj", weights, scene.uv[scene.faces[face]].astype(np.float64))
    for index, material in enumerate(scene.materials):
        if material.texture is not None:
            here = part == index
            out[here] *= bilinear(material.texture, uv[here])
    return out


def bilinear(image: Float[Array, "h w c"], uv: Float[Array, "n 2"]) -> Float[Array, "n c"]:
    """A repeated image between its four nearest texel centres, which lie at half-integers; row 0 is v = 1."""
    height, width = image.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    across, down = (x - column)[:, None], (y - row)[:, None]
    above, below = (
        (1 - across) * image[r % height, column % width] + across * image[r % height, (column + 1) % width]
        for r in (row, row + 1)
    )
    return ((1 - down) * above + down * below).astype(image.dtype)
