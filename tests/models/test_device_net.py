"""A net in torch against the NumPy evaluator, on the processor; on a GPU: tests/cuda/test_gpu.py."""

import numpy as np
import pytest
import torch

from prtnet import PrtnetError, netspec
from prtnet.models.device_net import DeviceNet
from tests.cuda.test_transfer import NETS
from tests.nets import random_net, random_points, random_texels, random_uv


@pytest.mark.parametrize("name", NETS)
def test_torch_computes_what_numpy_computes(name):
    net = random_net(**NETS[name])
    network = DeviceNet(net, "cpu", torch.from_numpy)
    positions, normals = random_points(400)
    uv = random_uv(400)
    transfer = np.full((500, len(net.biases[-1])), 7, np.float32)
    network(positions, normals, transfer, 300, uv)
    wanted = netspec.evaluate_unit(net, positions[:300].astype(np.float64), normals[:300], uv=uv[:300])
    np.testing.assert_allclose(transfer[:300], wanted, atol=1e-5)
    assert (transfer[300:] == 7).all()


def test_texels_without_their_places_are_refused():
    net, points = random_net(texels=(random_texels(9, 7),)), random_points(40)
    with pytest.raises(PrtnetError, match="found no uv"):
        DeviceNet(net, "cpu", torch.from_numpy)(*points, np.empty((40, 25), np.float32), 40)
