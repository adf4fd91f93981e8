import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from prtnet import encoding as twin
from prtnet.data.bilinear import bilinear as of_images
from prtnet.models.encoding import bilinear, encode, hashed, trilinear
from tests.nets import random_grid, random_hash, random_points, random_texels, random_uv


@pytest.mark.parametrize("encoding", twin.ENCODINGS)
@given(st.lists(st.floats(-1, 1, width=32), min_size=3, max_size=3), st.integers(0, 12))
def test_torch_encodes_as_numpy_does(encoding, point, frequencies):
    x = np.array([point], np.float32)
    found = encode(torch.from_numpy(x), frequencies, encoding).numpy()
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, twin.encode(x, frequencies, encoding), rtol=0, atol=1e-6)


def test_torch_reads_grids_as_numpy_does():
    grid = random_grid(5, 3, 2, kind="float32")
    positions = np.concatenate([random_points(500)[0], [[1, 1, 1], [-1, -1, -1], [0, 0, 0]]]).astype(np.float32)
    found = trilinear(torch.from_numpy(grid), torch.from_numpy(positions)).numpy()
    np.testing.assert_allclose(found, twin.trilinear(grid, positions), rtol=0, atol=3e-6)


def test_the_gradient_of_a_grid_is_that_of_a_double_precision_sum():
    grid = torch.from_numpy(random_grid(4, 3, 1, kind="float32")).requires_grad_()
    positions = np.concatenate([random_points(200)[0], [[1, 1, 1], [-1, -1, -1]]]).astype(np.float32)
    towards = np.random.default_rng(1).normal(size=(len(positions), grid.shape[3]))
    trilinear(grid, torch.from_numpy(positions)).backward(torch.from_numpy(towards.astype(np.float32)))
    assert grid.grad is not None
    # the look-up is linear in the grid: its derivative is what a grid of a single 1 gives
    for place in np.ndindex(*grid.shape[:3]):
        one = np.zeros((*grid.shape[:3], 4), np.float32)
        one[place] = 1
        expected = twin.trilinear(one, positions)[:, 0] @ towards
        np.testing.assert_allclose(grid.grad[place].numpy(), expected, rtol=0, atol=2e-5)


CORNERS = [[0, 0], [1, 1], [0, 1], [1, 0], [0.5, 0.5]]


@pytest.mark.parametrize(("x", "y"), [(5, 3), (1, 1), (64, 2)])
def test_texels_are_read_as_images_are(x, y):
    texels = random_texels(x, y, kind="float32")
    uv = np.concatenate([random_uv(500), CORNERS]).astype(np.float32)
    expected = of_images(texels, uv, repeat=False)
    np.testing.assert_allclose(twin.bilinear(texels, uv), expected, rtol=0, atol=1e-12)
    found = bilinear(torch.from_numpy(texels), torch.from_numpy(uv)).numpy()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * x)
    # the top row of the image is at v = 1
    np.testing.assert_allclose(twin.bilinear(texels, np.array([[0.0, 1.0]]))[0], texels[0, 0], rtol=0, atol=1e-12)


def test_the_gradient_of_texels_is_that_of_torch_itself():
    texels, uv = random_texels(6, 4, kind="float32"), np.concatenate([random_uv(300), CORNERS]).astype(np.float32)
    towards = torch.from_numpy(np.random.default_rng(1).normal(size=(len(uv), 4)).astype(np.float32))
    ours, torchs = (torch.from_numpy(texels.copy()).requires_grad_() for _ in range(2))
    bilinear(ours, torch.from_numpy(uv)).backward(towards)
    places = torch.from_numpy(uv)[None, None] * torch.tensor([2.0, -2.0]) + torch.tensor([-1.0, 1.0])
    image = torchs.permute(2, 0, 1)[None]
    found = torch.nn.functional.grid_sample(image, places, padding_mode="border", align_corners=False)
    found[0, :, 0].T.backward(towards)
    assert ours.grad is not None
    assert torchs.grad is not None
    np.testing.assert_allclose(ours.grad.numpy(), torchs.grad.numpy(), rtol=0, atol=2e-5)


@pytest.mark.parametrize(("cells", "channels"), [(48, 4), (1000, 8)])
def test_torch_reads_hashed_grids_as_numpy_does(cells, channels):
    grid = random_hash(cells, channels=channels, kind="float32")
    positions = np.concatenate([random_points(500)[0], [[1, 1, 1], [-1, -1, -1], [0, 0, 0]]]).astype(np.float32)
    table = torch.from_numpy(grid.table).requires_grad_()
    found = hashed(table, cells, torch.from_numpy(positions))
    np.testing.assert_allclose(found.detach().numpy(), twin.hashed(grid, positions), rtol=0, atol=4e-7 * cells)
    towards = np.random.default_rng(1).normal(size=found.shape)
    found.backward(torch.from_numpy(towards.astype(np.float32)))
    assert table.grad is not None
    for entry in range(0, 256, 17):
        one = np.zeros((256, 4), np.float32)
        one[entry] = 1
        expected = twin.hashed(twin.HashGrid(cells, one), positions)[:, 0] @ towards
        np.testing.assert_allclose(table.grad[entry].numpy(), expected, rtol=0, atol=2e-6 * cells)


def test_high_octaves_stay_exact_in_float32():
    """The naive sin(2^j pi x) in float32 is off by 1e-3 here."""
    x = np.float32(0.9999) * np.ones((1, 3), np.float32)
    naive = np.sin(np.float32(np.pi) * np.float32(2.0**15) * x)
    exact = twin.encode(x, 16)[:, -6:-3]
    assert np.abs(naive - exact).max() > 1e-3
    assert np.abs(encode(torch.from_numpy(x), 16).numpy()[:, -6:-3] - exact).max() < 1e-6
