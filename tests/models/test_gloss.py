import numpy as np
import pytest
import torch

from prtnet import sh
from prtnet.models import functional, gloss
from prtnet.render import material
from prtnet.render.material import Material

BANDS, EXPONENT = 5, 12.0


def _unit(count, seed):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_the_functional_is_what_the_renderer_draws():
    """The specular part by triple product, seen by an eye whose mirrored direction is r."""
    rng = np.random.default_rng(0)
    transfer, lights = rng.normal(size=(20, 25)), functional.lights(20, BANDS, rng)
    normals, eyes = _unit(20, 1), _unit(20, 2)
    mirrored = material.mirrored(eyes, normals)
    found = np.sum(gloss.mirrored_light(lights, mirrored, EXPONENT) * transfer / np.pi, axis=1)
    glossy = Material(diffuse=0.0, specular=(1.0, 1.0, 1.0), exponent=EXPONENT, product="full")
    for i in range(20):
        light = np.repeat(lights[i][:, None], 3, 1)
        one = slice(i, i + 1)
        expected = material.shine(glossy, transfer[one], light, normals[one], eyes[one])
        np.testing.assert_allclose(found[i], expected[0], rtol=1e-9)


def test_the_functional_is_the_integral_of_transfer_light_and_lobe():
    rng = np.random.default_rng(3)
    transfer, lights, mirrored = rng.normal(size=(4, 16)), functional.lights(4, 4, rng), _unit(4, 4)
    directions, weights = sh.quadrature(40)
    basis = sh.evaluate(directions, 4)
    lobes = (sh.evaluate(mirrored, 4) * sh.phong_lobe(EXPONENT, 4)[sh.band_index(4)]) @ basis.T
    expected = ((transfer @ basis.T) * (lights @ basis.T) * lobes) @ weights
    found = np.sum(gloss.mirrored_light(lights, mirrored, EXPONENT) * transfer / np.pi, axis=1)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_open_surfaces_show_as_much_in_both_halves():
    rows, mirrored = gloss.pool(BANDS, EXPONENT, 0)
    assert rows.shape == (functional.POOL, 25)
    glossy = mirrored.any(1)
    assert glossy.sum() == functional.POOL // 2
    normals = _unit(2000, 5)
    shown = torch.from_numpy(sh.cosine_lobe(normals, BANDS) / np.pi).float() @ rows.T
    counts = gloss.counts(torch.from_numpy(normals).float(), mirrored, 1)
    squares = shown.square() * counts
    assert squares[:, glossy].mean().item() == pytest.approx(squares[:, ~glossy].mean().item(), rel=0.02)
    # an eye sees half of the directions, which count twice
    assert counts[:, glossy].mean().item() == pytest.approx(1, abs=0.01)
    assert torch.all(counts[:, ~glossy] == 1)


def test_directions_that_no_eye_sees_do_not_count():
    normals = torch.from_numpy(_unit(30, 6)).float()
    rows, mirrored = (each[4096:4126] for each in gloss.pool(BANDS, EXPONENT, 0))
    generator = torch.Generator().manual_seed(0)
    predicted, target = (torch.randn(30, 25, generator=generator) for _ in range(2))
    found = functional.loss(predicted, target, rows, kind="l1", delta=1.0, counts=gloss.counts(normals, mirrored, 1))
    values = np.abs((predicted - target).numpy() @ rows.numpy().T)
    seen = normals.numpy() @ mirrored.numpy().T >= 0
    assert 0.2 < seen.mean() < 0.8
    assert found.item() == pytest.approx(np.where(seen, 2 * values, 0).mean(), rel=1e-5)


def test_gloss_is_of_the_first_group():
    counts = gloss.counts(torch.tensor([[0.0, 1.0, 0.0]]), torch.tensor([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]), 4)
    assert counts.tolist() == [[2.0, 1.0], [0.0, 1.0], [0.0, 1.0], [0.0, 1.0]]


def test_chunks_count_as_the_whole(monkeypatch):
    normals = torch.from_numpy(_unit(40, 7)).float()
    rows, mirrored = (each[4080:4110] for each in gloss.pool(BANDS, EXPONENT, 0))
    generator = torch.Generator().manual_seed(0)
    predicted, target = (torch.randn(40, 50, generator=generator) for _ in range(2))
    options = {"kind": "huber", "delta": 0.3, "counts": gloss.counts(normals, mirrored, 2)}
    whole = functional.loss(predicted, target, rows, **options)
    monkeypatch.setattr(functional, "_CHUNK", 30 * 7)
    assert functional.loss(predicted, target, rows, **options).item() == pytest.approx(whole.item(), rel=1e-6)
