import numpy as np
import pytest
import torch

from prtnet import sh
from prtnet.data import analytic_light
from prtnet.models import functional, loss

BANDS, COUNT = 4, 16


def _errors(rows=50, groups=1, seed=0):
    rng = np.random.default_rng(seed)
    return (torch.from_numpy(rng.normal(size=(rows, groups * COUNT)).astype(np.float32)) for _ in range(2))


def _gradient(predicted, target, functionals, **options):
    predicted = predicted.clone().requires_grad_()
    value = functional.loss(predicted, target, functionals, **options)
    value.backward()
    return value.item(), predicted.grad


def test_the_mean_square_over_the_sphere_is_that_of_the_coefficients():
    """Parseval: l2 of `projection` over all of its directions is the loss l2."""
    predicted, target = _errors()
    found = functional.loss(predicted, target, functional.pool("projection", BANDS, 0), kind="l2", delta=1.0)
    assert found.item() == pytest.approx(loss.loss(predicted, target, kind="l2", delta=1.0).item(), rel=1e-3)
    bands = loss.band_weights(BANDS, 2.0)
    weighted = functional.loss(
        predicted, target, functional.pool("projection", BANDS, 0), kind="l2", delta=1.0, bands=bands
    )
    expected = loss.loss(predicted, target, kind="l2", delta=1.0, bands=bands)
    assert weighted.item() == pytest.approx(expected.item(), rel=1e-3)


@pytest.mark.parametrize("kind", ["l1", "huber"])
def test_other_norms_do_not_depend_on_the_axes_as_those_of_coefficients_do(kind):
    (predicted, _), target = _errors(), torch.zeros(50, COUNT)
    predicted[:, 5:] = 0
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    turned = torch.from_numpy(sh.rotate(predicted.numpy()[..., None], turn)[..., 0])
    everywhere = functional.pool("projection", BANDS, 0)
    before, after = (functional.loss(e, target, everywhere, kind=kind, delta=0.5) for e in (predicted, turned))
    assert after.item() == pytest.approx(before.item(), rel=2e-3)
    plain = [loss.loss(e, target, kind=kind, delta=0.5).item() for e in (predicted, turned)]
    assert abs(plain[1] / plain[0] - 1) > 0.05


def test_values_of_projection_are_those_of_the_function():
    """The mean of |sum_i e_i Y_i(w)| by a quadrature of its own."""
    predicted, target = _errors(3)
    directions, weights = sh.quadrature(200)
    values = (predicted - target).numpy() @ sh.evaluate(directions, BANDS).T * np.sqrt(4 * np.pi / COUNT)
    expected = (np.abs(values) @ weights).mean() / (4 * np.pi)
    found = functional.loss(predicted, target, functional.pool("projection", BANDS, 0), kind="l1", delta=1.0)
    assert found.item() == pytest.approx(expected, rel=2e-3)


def test_discs_have_the_coefficients_of_the_light_by_formula():
    radius = np.radians([2.0, 25.0, 90.0])
    found = functional._disc_zonal(radius, 6)
    for angle, row in zip(radius, found, strict=True):
        disc = analytic_light.Lobe(analytic_light.UP, (1.0, 1.0, 1.0), depth=float(1 - np.cos(angle)))
        np.testing.assert_allclose(row, analytic_light.zonal(disc, 6), rtol=0, atol=1e-12)


def test_lights_give_radiance_one_to_what_faces_them_and_less_to_all_else():
    lights = functional.lights(2000, 12, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    radiance = sh.cosine_lobe(normals, 12) @ lights.T / np.pi
    assert radiance.max() == pytest.approx(1, abs=0.01)
    assert radiance.min() > -0.01
    # half of the sky's share, and of the disc's a quarter: the mean of max(0, cos) over the sphere
    assert radiance.mean() == pytest.approx(0.5 + 0.5 / 4, abs=0.02)
    # no direction is preferred: coefficients do not depend on each other, and have one variance in each band
    spread = lights.T @ lights / len(lights)
    bands = sh.band_index(12)
    power = np.array([np.diag(spread)[bands == l].mean() for l in range(12)])
    assert np.abs(spread / np.sqrt(power[bands] * power[bands][:, None]) - np.eye(144)).max() < 0.25


def test_chunks_change_neither_value_nor_gradient(monkeypatch):
    (predicted, target), functionals = _errors(50, groups=2), functional.pool("radiance", BANDS, 3)[:30]
    options = {"kind": "huber", "delta": 0.3, "points": torch.rand(50, generator=torch.Generator().manual_seed(0))}
    whole = _gradient(predicted, target, functionals, **options)
    monkeypatch.setattr(functional, "_CHUNK", 30 * 7)
    parts = _gradient(predicted, target, functionals, **options)
    assert parts[0] == pytest.approx(whole[0], rel=1e-6)
    torch.testing.assert_close(parts[1], whole[1], rtol=1e-5, atol=1e-9)
    values = ((predicted - target).reshape(100, COUNT) @ functionals.T).abs()
    by_hand = torch.where(values < 0.3, values**2 / 0.6, values - 0.15).reshape(50, -1)
    assert whole[0] == pytest.approx((by_hand * options["points"][:, None]).mean().item(), rel=1e-5)


@pytest.mark.parametrize(("chunk", "kept"), [(1 << 22, True), (1 << 14, False)])
def test_values_beyond_a_chunk_are_not_kept_for_the_gradient(chunk, kept, monkeypatch):
    monkeypatch.setattr(functional, "_CHUNK", chunk)
    predicted, target = _errors(2000)
    predicted.requires_grad_()
    sizes = {}  # by address: parts share most of what they keep

    def note(saved):
        sizes[saved.data_ptr()] = saved.numel()
        return saved

    with torch.autograd.graph.saved_tensors_hooks(note, lambda saved: saved):
        functional.loss(predicted, target, functional.pool("projection", BANDS, 0)[:500], kind="l2", delta=1.0)
    assert (sum(sizes.values()) >= 2000 * 500) == kept
    assert kept or sum(sizes.values()) <= 4 * 2000 * COUNT


def test_the_draw_follows_from_seed_and_step():
    everything = functional.pool("projection", BANDS, 0)
    first, again, other = (functional.draw(everything, 8, 1, step) for step in (4, 4, 5))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
