"""Nets in torch against their plain twin."""

import numpy as np
import pytest

from prtnet import PrtnetError, netspec
from prtnet.models import inference
from prtnet.models.inference import Inference
from prtnet.netspec import ACTIVATIONS
from tests.nets import random_grid, random_hash, random_net, random_points, random_texels


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("output", ["tanh", "linear"])
def test_every_activation_is_its_twins(activation, output):
    net = random_net(width=16, activation=activation, output=output, negative_slope=0.2)
    points = random_points(500)
    np.testing.assert_allclose(Inference(net)(*points), netspec.evaluate_unit(net, *points), atol=1e-5)


@pytest.mark.parametrize(
    "fields",
    [
        {"encoding": "frequency", "position_frequencies": 10, "normal_frequencies": 4},
        {"encoding": "triangle", "position_frequencies": 10, "normal_frequencies": 4},
        {"encoding": "identity"},
        {"grids": (random_grid(5, 4, 3), random_grid(1, 2, 7, channels=4, kind="float32"))},
        {"hashes": (random_hash(48, channels=8), random_hash(7, kind="float32"))},
        {"grids": (random_grid(3, 3, 3),), "hashes": (random_hash(16),), "output": "linear", "residual": True},
        {"groups": 4, "bands": 3, "residual": True},
        {"bands": 7, "depth": 0, "output": "linear", "output_scale": 1.0, "residual": True},
    ],
    ids=lambda fields: ", ".join(fields),
)
def test_every_part_of_a_net_is_its_twins(fields):
    net = random_net(width=16, **fields)
    points = random_points(700)
    np.testing.assert_allclose(Inference(net)(*points), netspec.evaluate_unit(net, *points), atol=1e-5)


def test_texels_are_looked_up():
    net, points = random_net(width=16, texels=(random_texels(9, 7),)), random_points(700)
    uv = np.random.default_rng(1).random((700, 2), np.float32)
    wanted = netspec.evaluate_unit(net, *points, uv=uv)
    np.testing.assert_allclose(Inference(net)(*points, uv), wanted, atol=1e-5)
    with pytest.raises(PrtnetError, match="found no uv"):
        Inference(net)(*points)


def test_wide_nets_and_more_points_than_one_chunk(monkeypatch):
    monkeypatch.setattr(inference, "POINTS", 100)
    net = random_net(width=512, depth=2, activation="hard_gelu")
    points = random_points(250)
    found = Inference(net)(*points)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, netspec.evaluate_unit(net, *points), atol=1e-5)


def test_no_points_have_no_transfer():
    assert Inference(random_net())(*random_points(0)).shape == (0, 25)


def test_a_wrong_weight_is_seen():
    net, points = random_net(), random_points(100)
    wrong = tuple(weight + np.float32(1e-4) for weight in net.weights)
    found = Inference(netspec.NetSpec(**{**vars(net), "weights": wrong}))(*points)
    assert np.abs(found - netspec.evaluate_unit(net, *points)).max() > 1e-5
