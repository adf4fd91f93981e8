"""What a renderer of lightmaps gives, whichever it is."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Rendered:
    """Lightmaps of c configurations at t texels, linear RGB: irradiance from other surfaces, or radiance."""

    values: Float32[Array, "c t 3"]
    # standard error of a texel: root mean square over configurations and colours
    noise: Float32[Array, " t"]
    # estimate of what bounces beyond the last one would add, as a share of the sum of `values`
    left_out: float = 0.0


def of_halves(first: Float[Array, "c t 3"], second: Float[Array, "c t 3"], left_out: float = 0.0) -> Rendered:
    """The mean of two independent renderings of equal effort, and its standard error: half their difference."""
    values, squares = np.empty(first.shape, np.float32), np.zeros(first.shape[1])
    for configuration, (one, other) in enumerate(zip(first, second, strict=True)):
        values[configuration] = (one + other) / 2
        squares += np.sum(np.square(one - other, dtype=np.float64), axis=1) / 4
    return Rendered(values, np.sqrt(squares / max(3 * len(first), 1)).astype(np.float32), left_out)
