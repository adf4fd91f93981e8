from itertools import chain

import pytest
import torch

from prtnet.models import optimiser
from prtnet.models.mlp import Mlp
from prtnet.models.recipe import ModelOptions, TrainOptions


def _rates(steps=200, **options):
    return [optimiser.rate(TrainOptions(**options), step, steps) for step in range(steps)]


def test_constant_is_constant():
    assert set(_rates(schedule="constant", warmup=0.5)) == {1.0}


def test_cosine_climbs_then_falls_to_nothing():
    rates = _rates(schedule="cosine", warmup=0.1)
    assert rates[:20] == pytest.approx([(step + 1) / 20 for step in range(20)])
    assert rates[109] == pytest.approx(0.5)
    assert rates[19:] == sorted(rates[19:], reverse=True)
    assert rates[-1] == 0


def test_one_cycle_has_its_peak_at_three_tenths():
    rates = _rates(schedule="one_cycle")
    assert rates.index(max(rates)) == 59
    assert max(rates) == pytest.approx(1)
    assert rates[0] == pytest.approx(0.04, abs=0.001)
    assert rates[-1] == 0


@pytest.mark.parametrize("depth", [0, 1])
def test_muon_leaves_a_net_of_one_hidden_layer_or_none_to_adam(depth):
    net = Mlp(ModelOptions(8, depth), TrainOptions(grid_cells=[], hash_cells=[]), 3, torch.Generator().manual_seed(0))
    (adam,) = optimiser.make(net, TrainOptions(optimiser="muon"))
    assert len(adam.param_groups[0]["params"]) == 2 + 2 * depth


def test_muon_turns_a_gradient_into_one_of_equal_singular_values():
    """Jordan et al. 2024: the step is the gradient's orthogonal factor, which Newton-Schulz finds to within a third."""
    options = TrainOptions(optimiser="muon", matrix_rate=1.0)
    net = Mlp(ModelOptions(16, 2), options, 3, torch.Generator().manual_seed(0))
    matrix = net.weights[1]
    before = matrix.detach().clone()
    for parameter in net.parameters():
        parameter.grad = torch.zeros_like(parameter)
    matrix.grad = torch.randn(16, 16, generator=torch.Generator().manual_seed(1))
    left, values, right = torch.linalg.svd(matrix.grad)
    optimiser.make(net, options)[1].step()
    turned = left.T @ (before - matrix.detach()) @ right.T
    assert values.max() > 20 * values.min()
    torch.testing.assert_close(turned, torch.eye(16), rtol=0, atol=0.4)


@pytest.mark.parametrize("depth", [0, 4])
@pytest.mark.parametrize(("name", "hidden"), [("adam", slice(0)), ("muon", slice(1, -1)), ("soap", slice(None))])
def test_each_parameter_has_one_optimiser(name, hidden, depth):
    options = TrainOptions(optimiser=name, learning_rate=0.02, matrix_rate=0.3)
    net = Mlp(ModelOptions(8, depth), options, 5, torch.Generator().manual_seed(0))
    optimisers = optimiser.make(net, options)
    groups = [[id(p) for group in each.param_groups for p in group["params"]] for each in optimisers]
    assert sorted(chain(*groups)) == sorted(id(parameter) for parameter in net.parameters())
    matrices = len(net.weights[hidden]) > 0
    assert len(groups) == 1 + matrices
    if matrices:
        assert groups[1] == [id(weight) for weight in net.weights[hidden]]
    optimiser.set_rate(optimisers, 0.5)
    assert [each.param_groups[0]["lr"] for each in optimisers] == [0.01, 0.15][: len(optimisers)]
