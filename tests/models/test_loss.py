import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from prtnet import sh
from prtnet.models import loss

errors = st.floats(-2, 2)
deltas = st.floats(1e-3, 1)


def _rho(kind, error, delta=1.0):
    predicted = torch.tensor([[error]], dtype=torch.float64)
    return loss.rho(kind, predicted, torch.zeros_like(predicted), delta).item()


@given(errors, deltas)
def test_norms_are_the_written_formulas(error, delta):
    assert _rho("l1", error) == pytest.approx(abs(error))
    assert _rho("l2", error) == pytest.approx(error**2)
    huber = error**2 / (2 * delta) if abs(error) < delta else abs(error) - delta / 2
    assert _rho("huber", error, delta) == pytest.approx(huber)


@given(deltas)
def test_huber_is_smooth_at_delta_and_parallel_to_l1_beyond(delta):
    assert _rho("huber", delta * (1 - 1e-9), delta) == pytest.approx(_rho("huber", delta, delta))
    assert _rho("huber", delta + 1.5, delta) - _rho("huber", delta + 0.5, delta) == pytest.approx(1.0)


def test_band_weights_fall_as_written_and_have_mean_one():
    weights = loss.band_weights(3, 2.0).numpy()
    np.testing.assert_allclose(weights / weights[0], [1] + [1 / 4] * 3 + [1 / 9] * 5, rtol=1e-6)
    assert weights.mean() == pytest.approx(1)
    np.testing.assert_array_equal(loss.band_weights(5, 0.0).numpy(), np.ones(25))


def test_point_weights_rise_in_the_dark():
    full = sh.cosine_lobe(np.array([[0.0, 1.0, 0.0]]), 1)[0, 0]
    transfer = torch.tensor([[1.0], [0.5], [0.0]]) * full
    weights = loss.point_weights(transfer, 0.5).numpy()
    expected = np.array([1.05, 0.55, 0.05]) ** -0.5
    np.testing.assert_allclose(weights, expected / expected.mean(), rtol=1e-5)
    np.testing.assert_array_equal(loss.point_weights(transfer, 0.0).numpy(), np.ones(3))


def test_loss_is_the_weighted_mean():
    rng = np.random.default_rng(0)
    predicted, target = (torch.from_numpy(rng.normal(size=(6, 4)).astype(np.float32)) for _ in range(2))
    bands, points = torch.tensor([1.0, 0.5, 0.5, 0.5]), torch.arange(6.0)
    found = loss.loss(predicted, target, kind="l1", delta=1.0, bands=bands, points=points)
    by_hand = np.mean(np.abs((predicted - target).numpy()) * bands.numpy() * points.numpy()[:, None])
    assert found.item() == pytest.approx(by_hand, rel=1e-6)


@pytest.mark.parametrize("kind", ["l1", "l2", "huber"])
def test_no_weights_are_weights_of_one(kind):
    rng = np.random.default_rng(0)
    predicted, target = (torch.from_numpy(rng.normal(size=(6, 4)).astype(np.float32)) for _ in range(2))
    plain = loss.loss(predicted, target, kind=kind, delta=0.5)
    ones = loss.loss(predicted, target, kind=kind, delta=0.5, bands=torch.ones(4), points=torch.ones(6))
    assert plain.item() == pytest.approx(ones.item(), rel=1e-6)
