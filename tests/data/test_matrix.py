"""Transfer matrices against direct quadrature with visibility by brute force, and against products of other orders."""

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import matrix
from prtnet.data.tracer import Tracer
from prtnet.render import material as materials
from tests.render.meshes import quad, scene

UP = np.array([0.0, 1.0, 0.0])


def directions(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A Fibonacci sphere, uniform, and the solid angle of each."""
    index = np.arange(count) + 0.5
    y, turn = 1 - 2 * index / count, np.pi * (1 + np.sqrt(5)) * index
    radius = np.sqrt(1 - y**2)
    return np.stack([radius * np.cos(turn), y, radius * np.sin(turn)], axis=1), np.full(count, 4 * np.pi / count)


def by_quadrature(free: np.ndarray, normal: np.ndarray, towards: np.ndarray, weights: np.ndarray, bands: int):
    """(matrix, transfer of 2 bands - 1) of one visibility, the matrix without tau."""
    seen = weights * free * np.clip(towards @ normal, 0, None)
    basis = sh.evaluate(towards, bands)
    return basis.T @ (seen[:, None] * basis), seen @ sh.evaluate(towards, 2 * bands - 1)


@pytest.mark.parametrize("bands", [1, 3, 5])
def test_the_matrix_is_the_product_of_a_longer_transfer_exactly(bands):
    """Half-space occluders at random, any normal: the same sum over the same directions, in two ways."""
    rng = np.random.default_rng(bands)
    towards, weights = directions(5000)
    for _ in range(4):
        normal, wall = rng.normal(size=3), rng.normal(size=3)
        wanted, transfer = by_quadrature(towards @ wall < 0.3, normal / np.linalg.norm(normal), towards, weights, bands)
        found = matrix.from_transfer(transfer[None], bands)[0]
        np.testing.assert_allclose(found, wanted, atol=1e-6)
        # one band fewer is not enough
        if bands > 1:
            short = transfer.copy()
            short[(2 * bands - 2) ** 2 :] = 0
            assert np.abs(matrix.from_transfer(short[None], bands)[0] - wanted).max() > 1e-3


def test_a_longer_transfer_than_needed_gives_the_same():
    transfer = np.random.default_rng(0).normal(size=(7, 49))
    np.testing.assert_array_equal(matrix.from_transfer(transfer, 3), matrix.from_transfer(transfer[:, :25], 3))


@pytest.mark.parametrize("kind", ["fused", "embreex"])
def test_baked_before_a_wall_without_end(kind):
    """A floor's points before a wall a thousand times as high as they are far: half of the sky is gone."""
    floor = quad([0, 0, 500], [500, 0, 0], [0, 0, -1000], name="floor")
    stage = scene(floor, quad([0, 0, 500], [0, 0, -1000], [0, 500, 0], name="wall"))
    corner = stage.vertices.min(axis=0)
    points = corner + np.array([[0.002, 0, 1.0], [0.001, 0, 0.9]])
    normals = np.tile(UP.astype(np.float32), (2, 1))
    baked = matrix.bake(
        Tracer(stage, kind=kind), points, normals, bands=3, directions=4096, rng=np.random.default_rng(0)
    )
    towards, weights = directions(400_000)
    wanted, _ = by_quadrature(towards[:, 0] > 0, UP, towards, weights, 3)
    assert np.abs(baked - wanted).max() < 2e-3
    open_sky, _ = by_quadrature(np.ones(len(towards)), UP, towards, weights, 3)
    assert np.abs(open_sky - wanted).max() > 0.1


@pytest.mark.parametrize("product", materials.PRODUCTS)
@pytest.mark.parametrize("bands", [2, 4])
def test_the_matrix_is_the_triple_product_where_orders_suffice(bands, product):
    """Transfer of 2b - 1 bands, light and radiance of b: nothing is cut but what the matrix has not either."""
    rng = np.random.default_rng(0)
    transfer, light = rng.normal(size=(20, (2 * bands - 1) ** 2)), rng.normal(size=(bands**2, 3))
    facing = materials.lobe(sh.quadrature(10)[0][:20], rng.uniform(1, 90, 20), bands)
    arriving = matrix.transferred(matrix.from_transfer(transfer, bands), light)
    wanted = np.einsum("nkc,nk->nc", arriving, facing)
    np.testing.assert_allclose(materials.reflected(transfer, light, facing, product), wanted, atol=2e-5)
    cut = materials.reflected(transfer[:, : bands**2], light, facing, product)
    assert np.abs(cut - wanted).max() > 0.01


def test_under_a_constant_light_matrix_and_transfer_are_one():
    transfer = np.random.default_rng(0).normal(size=(5, 25))
    constant = np.zeros((9, 1))
    constant[0] = np.sqrt(4 * np.pi)
    found = matrix.transferred(matrix.from_transfer(transfer, 3), constant)[..., 0]
    np.testing.assert_allclose(found, transfer[:, :9], atol=1e-5)


def test_errors():
    with pytest.raises(PrtnetError, match=r"found 100000 points of 5 bands, 250 MB, expected at most 40000 of them"):
        matrix.check(100_000, 5, 100_000_000)
    with pytest.raises(PrtnetError, match="found 4 bands of transfer, expected 5 for 3 of matrix"):
        matrix.from_transfer(np.zeros((2, 16)), 3)
    floor = scene(quad([0, 0, 1], [1, 0, 0], [0, 0, -1]))
    points = np.zeros((10, 3))
    with pytest.raises(PrtnetError, match="transfer matrix: found 10 points"):
        matrix.bake(Tracer(floor), points, points, bands=5, memory=1000, rng=np.random.default_rng(0))
