"""A trained net back in torch, to be held against what was exported of it."""

import numpy as np
import torch
from jaxtyping import Float, Float32

from prtnet import PrtnetError
from prtnet.models.mlp import SCALE, Mlp
from prtnet.models.recipe import ModelOptions, TrainOptions
from prtnet.netspec import NetSpec

Array = np.ndarray


def of_spec(net: NetSpec, model: ModelOptions, head: TrainOptions) -> Mlp:
    """The module that `net` came from, with its weights. Inverse of `Mlp.spec`.

    Raises PrtnetError where the options are those of another net.
    """
    made = Mlp(model, head, net.bands, torch.Generator(), net.groups)
    arrays = [*net.weights, *net.biases, *net.grids, *(each.table for each in net.hashes), *net.texels]
    own = list(made.parameters())
    shapes = [tuple(each.shape) for each in own]
    if [array.shape for array in arrays] != shapes:
        raise PrtnetError(f"net: found arrays of {[array.shape for array in arrays]}, expected {shapes}")
    hidden = len(net.weights) - 1
    with torch.no_grad():
        for index, (parameter, array) in enumerate(zip(own, arrays, strict=True)):
            parameter.copy_(torch.from_numpy(array.astype(np.float32)))
            # the file has no omega: sin(omega (W h + b)) is sin(W h + b) of larger weights
            if head.activation == "sine" and index not in (hidden, 2 * hidden + 1) and index < 2 * hidden + 2:
                parameter /= head.sine_omega
    return made


def transfer(
    made: Mlp, positions: Float[Array, "n 3"], normals: Float[Array, "n 3"], uv: Float[Array, "n 2"] | None = None
) -> Float32[Array, "n c"]:
    """The coefficients at centred positions, in float32."""
    points, directions = torch.from_numpy(positions), torch.from_numpy(normals)
    places = None if uv is None else torch.from_numpy(uv)
    with torch.no_grad():
        return (SCALE * (made(points, directions, places) + made.unlearned(directions))).numpy()
