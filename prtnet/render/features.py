"""The feature grids of a net on the graphics card, under the names of the samplers that its GLSL declares."""

from collections.abc import Sequence

import moderngl
import numpy as np
from jaxtyping import Float

from prtnet import gl
from prtnet.encoding import HashGrid
from prtnet.export import grid, hash_grid

Array = np.ndarray


def upload(
    grids: Sequence[Float[Array, "_ _ _ _"]], hashes: Sequence[HashGrid]
) -> dict[str, moderngl.Texture | moderngl.Texture3D]:
    """The textures of `NetSpec.grids` and `NetSpec.hashes`."""
    dense = {grid.name(i): gl.upload_volume(grid.texels(values)) for i, values in enumerate(grids)}
    return dense | {hash_grid.name(i): gl.upload_table(hash_grid.texels(each.table)) for i, each in enumerate(hashes)}
