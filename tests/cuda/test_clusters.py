"""Clusters by CUDA's kernels, compiled for the processor: a launch for each net at the points of its weight."""

import numpy as np

from prtnet import clusters
from prtnet.clusters import ClusterSpec, Plane, Split
from tests.cuda.host import TOLERANCE, compiled, needs_compiler
from tests.nets import random_hash, random_net, random_points


@needs_compiler
def test_a_launch_for_each_net_gives_the_blend(tmp_path):
    """Nets of other sizes, in cubes of their own."""
    nets = (
        random_net(width=8, depth=1, bands=3, centre=(-0.5, 0.0, 0.0), scale=1.2),
        random_net(width=16, depth=2, bands=3, seed=1, centre=(0.4, 0.1, 0.0), scale=1.5, hashes=(random_hash(8),)),
    )
    spec = ClusterSpec(Split((Plane(0, 0.1, -1, -2),)), (0, 1), 0.2, nets)
    kernels = []
    for index, net in enumerate(nets):
        folder = tmp_path / str(index)
        folder.mkdir()
        kernels.append(compiled(net, folder))
    positions, normals = random_points(700)
    share, launched = clusters.weights(spec, positions), []

    def run(index, own, turned):
        launched.append(len(own))
        return kernels[index].transfer(own, turned)

    found = clusters.blended(spec, share, positions, normals, run)
    np.testing.assert_allclose(found, clusters.evaluate_unit(spec, positions, normals), atol=TOLERANCE)
    # no net runs where it does not count
    assert launched == [(share[:, 0] > 0).sum(), (share[:, 1] > 0).sum()]
    assert 700 < sum(launched) < 1000
