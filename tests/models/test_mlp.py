import numpy as np
import pytest
import torch

from prtnet import netspec, sh
from prtnet.encoding import ENCODINGS
from prtnet.models.mlp import SCALE, Mlp
from prtnet.models.recipe import ModelOptions, TrainOptions, published
from tests.nets import random_points, random_uv


def _net(head, width=12, depth=3, bands=4, seed=0):
    return Mlp(ModelOptions(width, depth), head, bands, torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("activation", netspec.ACTIVATIONS)
@pytest.mark.parametrize("output", netspec.OUTPUTS)
@pytest.mark.parametrize("residual", [False, True])
def test_torch_and_its_spec_agree(activation, output, residual):
    net = _net(TrainOptions(activation=activation, output=output, residual=residual))
    positions, normals = random_points(200)
    with torch.no_grad():
        learned = net(torch.from_numpy(positions), torch.from_numpy(normals))
        found = SCALE * (learned + net.unlearned(torch.from_numpy(normals))).numpy()
    expected = netspec.evaluate_unit(net.spec(), positions, normals)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("activation", ["hard_gelu", "sine", "relu"])
@pytest.mark.parametrize("output", netspec.OUTPUTS)
def test_without_a_hidden_layer_the_net_is_linear(activation, output):
    grids = {"grid_cells": [[2, 3, 4]], "hash_cells": []}
    net = _net(TrainOptions(activation=activation, output=output, sine_omega=30.0, **grids), depth=0)
    positions, normals = random_points(200)
    with torch.no_grad():
        found = SCALE * net(torch.from_numpy(positions), torch.from_numpy(normals)).numpy()
    assert [weight.shape for weight in net.spec().weights] == [(16, 6 + 6 * (6 + 2) + 8)]
    np.testing.assert_allclose(found, netspec.evaluate_unit(net.spec(), positions, normals), rtol=0, atol=1e-5)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_torch_and_its_spec_agree_on_the_encoding(encoding):
    net = _net(TrainOptions(encoding=encoding, activation="relu"))
    positions, normals = random_points(200)
    with torch.no_grad():
        found = SCALE * net(torch.from_numpy(positions), torch.from_numpy(normals)).numpy()
    assert net.spec().encoding == encoding
    np.testing.assert_allclose(found, netspec.evaluate_unit(net.spec(), positions, normals), rtol=0, atol=1e-5)


@pytest.mark.parametrize(("kind", "activation"), [("float16", "hard_gelu"), ("float32", "sine")])
def test_torch_and_its_spec_agree_on_grids(kind, activation):
    head = TrainOptions(grid_cells=[[2, 3, 4], [5, 1, 2]], grid_channels=4, grid_format=kind, activation=activation)
    net = _net(head)
    with torch.no_grad():
        for grid in net.grids:
            assert 0 < grid.abs().max() <= 1e-4
            # quarters, which float16 has
            grid.copy_((4 * torch.randn(grid.shape, generator=torch.Generator().manual_seed(0))).round() / 4)
    positions, normals = random_points(200)
    with torch.no_grad():
        found = SCALE * net(torch.from_numpy(positions), torch.from_numpy(normals)).numpy()
    spec = net.spec()
    assert [grid.shape for grid in spec.grids] == [(4, 3, 2, 4), (2, 1, 5, 4)]
    assert {str(grid.dtype) for grid in spec.grids} == {kind}
    np.testing.assert_allclose(found, netspec.evaluate_unit(spec, positions, normals), rtol=0, atol=1e-5)


def test_torch_and_its_spec_agree_on_texels():
    head = TrainOptions(grid_cells=[[2, 3, 4]], hash_cells=[9], hash_entries=256, texel_size=5, texel_channels=8)
    net = _net(head)
    with torch.no_grad():
        (texels,) = net.texels
        assert 0 < texels.abs().max() <= 1e-4
        texels.copy_((4 * torch.randn(texels.shape, generator=torch.Generator().manual_seed(0))).round() / 4)
    (positions, normals), uv = random_points(200), random_uv(200)
    with torch.no_grad():
        found = SCALE * net(*map(torch.from_numpy, (positions, normals, uv))).numpy()
    spec = net.spec()
    assert [each.shape for each in spec.texels] == [(5, 5, 8)]
    np.testing.assert_allclose(found, netspec.evaluate_unit(spec, positions, normals, uv=uv), rtol=0, atol=3e-5)


def test_torch_and_its_spec_agree_on_hashed_grids():
    net = _net(TrainOptions(grid_cells=[[2, 3, 4]], hash_cells=[9, 30], hash_entries=256, hash_channels=8))
    with torch.no_grad():
        for table in net.tables:
            assert 0 < table.abs().max() <= 1e-4
            table.copy_((4 * torch.randn(table.shape, generator=torch.Generator().manual_seed(0))).round() / 4)
    positions, normals = random_points(200)
    with torch.no_grad():
        found = SCALE * net(torch.from_numpy(positions), torch.from_numpy(normals)).numpy()
    spec = net.spec()
    assert [(each.cells, each.table.shape) for each in spec.hashes] == [(9, (256, 8)), (30, (256, 8))]
    np.testing.assert_allclose(found, netspec.evaluate_unit(spec, positions, normals), rtol=0, atol=3e-5)


@pytest.mark.parametrize("omega", [1.0, 30.0])
def test_sine_layers_begin_with_the_spread_of_siren(omega):
    """Sitzmann et al. 2020, theorem 1.8: what enters each sine is about normal, of twice the mean square before it."""
    head = TrainOptions(activation="sine", sine_omega=omega, encoding="frequency")
    net = _net(head, width=256, depth=4).spec()
    assert np.abs(net.weights[0]).max() <= omega / net.weights[0].shape[1]
    hidden = np.sin(np.random.default_rng(0).uniform(-np.pi, np.pi, (2000, 256)))
    variance = 1.0
    for weight in net.weights[1:-1]:
        inner = hidden @ weight.T
        assert inner.var() == pytest.approx(variance, rel=0.03)
        # of normal numbers 4.6 % lie beyond two standard deviations
        assert np.mean(np.abs(inner) > 2 * inner.std()) == pytest.approx(0.046, abs=0.01)
        hidden, variance = np.sin(inner), 1 - np.exp(-2 * variance)


@pytest.mark.parametrize("omega", [1.0, 30.0])
def test_the_file_holds_omega_in_its_weights(omega):
    net = _net(TrainOptions(activation="sine", sine_omega=omega, output="linear"))
    positions, normals = random_points(200)
    with torch.no_grad():
        found = SCALE * net(torch.from_numpy(positions), torch.from_numpy(normals)).numpy()
    np.testing.assert_allclose(found, netspec.evaluate_unit(net.spec(), positions, normals), rtol=0, atol=1e-5)


def test_the_residual_is_the_transfer_of_an_open_point():
    net = _net(TrainOptions(residual=True, output="linear"))
    with torch.no_grad():
        net.weights[-1].zero_()
        net.biases[-1].zero_()
    positions, normals = random_points(50)
    found = netspec.evaluate_unit(net.spec(), positions, normals)
    np.testing.assert_allclose(found, sh.cosine_lobe(normals, 4), rtol=0, atol=1e-6)


def test_spec_carries_the_recipes_head_and_the_frame():
    head = published()
    net = _net(head).spec(centre=(1.0, 2.0, 3.0), scale=0.5, name="x")
    for field in ("activation", "negative_slope", "output", "residual", "position_frequencies", "normal_frequencies"):
        assert getattr(net, field) == getattr(head, field)
    assert (net.centre, net.scale, net.name, net.output_scale) == ((1.0, 2.0, 3.0), 0.5, "x", np.pi)
    assert [weight.shape for weight in net.weights] == [(12, 90), (12, 12), (12, 12), (16, 12)]


def test_initial_weights_follow_from_the_generator_alone():
    torch.manual_seed(1)
    before = torch.get_rng_state()
    first, second, other = _net(published()), _net(published()), _net(published(), seed=1)
    assert torch.equal(torch.get_rng_state(), before)
    assert all(torch.equal(a, b) for a, b in zip(first.parameters(), second.parameters(), strict=True))
    assert not torch.equal(first.weights[0], other.weights[0])


def test_initial_weights_have_the_spread_of_torchs_linear_layer():
    weight = _net(published(), width=64).weights[1]
    assert weight.abs().max() <= 1 / np.sqrt(64)
    assert weight.std().item() == pytest.approx(1 / np.sqrt(3 * 64), rel=0.03)
