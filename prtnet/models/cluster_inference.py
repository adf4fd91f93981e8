"""Several nets that share one scene, evaluated in torch: the fast twin of `clusters.evaluate_unit`."""

import numpy as np
from jaxtyping import Float, Float64

from prtnet import clusters
from prtnet.clusters import ClusterSpec
from prtnet.models.inference import Inference

Array = np.ndarray


class ClusterInference:
    """The nets on a device, each evaluated where its weight is above 0."""

    def __init__(self, spec: ClusterSpec, device: str = "cpu"):
        self.spec, self._nets = spec, [Inference(net, device) for net in spec.nets]

    def __call__(
        self, share: Float[Array, "n c"], positions: Float[Array, "n 3"], normals: Float[Array, "n 3"]
    ) -> Float64[Array, "n k"]:
        """Their blend by these weights at unit positions with unit normals."""
        return clusters.blended(
            self.spec, share, positions, normals, lambda index, own, turned: self._nets[index](own, turned)
        )
