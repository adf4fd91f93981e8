"""The grids and texels of a net on the graphics card, under the names of the samplers that its GLSL declares."""

from collections.abc import Sequence

import moderngl
import numpy as np
from jaxtyping import Float

from prtnet import gl
from prtnet.encoding import HashGrid
from prtnet.export import grid, hash_grid, texel_grid

Array = np.ndarray


def upload(
    grids: Sequence[Float[Array, "_ _ _ _"]],
    hashes: Sequence[HashGrid],
    texels: Sequence[Float[Array, "_ _ _"]] = (),
) -> dict[str, moderngl.Texture | moderngl.Texture3D]:
    """The textures of `NetSpec.grids`, `NetSpec.hashes` and `NetSpec.texels`."""
    dense = {grid.name(i): gl.upload_volume(grid.texels(values)) for i, values in enumerate(grids)}
    tables = {hash_grid.name(i): hash_grid.texels(each.table) for i, each in enumerate(hashes)}
    tables |= {texel_grid.name(i): texel_grid.texels(each) for i, each in enumerate(texels)}
    return dense | {name: gl.upload_table(image) for name, image in tables.items()}
