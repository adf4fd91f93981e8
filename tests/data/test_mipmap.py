"""Mip levels: means of valid children, sides of any parity, and the trilinear twin."""

import numpy as np
import pytest

from prtnet.data import mipmap, texture
from tests.render.meshes import bilinear

RNG = np.random.default_rng(0)


def full(size: int) -> np.ndarray:
    return np.ones((size, size), bool)


@pytest.mark.parametrize("size", [16, 20, 25, 37])
def test_whole_textures_keep_their_mean(size):
    """The weights of odd sides are those of area: a level has the mean of the one before it."""
    image = RNG.normal(size=(size, size, 3)).astype(np.float32)
    levels = mipmap.pyramid(image, full(size), 99)
    assert [len(valid) for _, valid in levels] == mipmap.sides(size, 99)
    assert len(levels[-1][1]) == 1
    for found, valid in levels:
        assert valid.all()
        np.testing.assert_allclose(found.mean(axis=(0, 1)), image.mean(axis=(0, 1)), atol=1e-6)


def test_even_sides_are_means_of_four():
    image = RNG.normal(size=(8, 8, 2)).astype(np.float32)
    found, _ = mipmap.pyramid(image, full(8), 2)[1]
    np.testing.assert_allclose(found, image.reshape(4, 2, 4, 2, 2).mean(axis=(1, 3)), atol=1e-6)


@pytest.mark.parametrize("size", [16, 25])
def test_empty_texels_never_darken_a_level(size):
    """A constant on scattered texels is that constant on all levels, and empty stays empty."""
    valid = RNG.random((size, size)) < 0.15
    image = np.where(valid[..., None], np.float32(0.7), np.float32(0))
    for found, some in mipmap.pyramid(image, valid, 99):
        np.testing.assert_allclose(found[some], 0.7, rtol=1e-6)
        assert not found[~some].any()
    assert some.all()


def test_levels_of_a_page_are_dilated_each():
    valid = np.zeros((32, 32), bool)
    valid[:8, :8] = True
    normals = np.tile(np.float32([0, 1, 0]), (64, 1))
    index = np.flatnonzero(valid)
    texels = texture.Texels(np.zeros((64, 3)), normals, normals, np.zeros(64, np.int32), index, 32)
    page = texture.page(texels, np.full((64, 1), 2.0), dilation=1, levels=6)
    assert [np.count_nonzero(level) for level in page.levels] == [81, 25, 9, 4, 4, 1]
    bare = texture.page(texels, np.full((64, 1), 2.0), dilation=0, levels=6)
    assert [np.count_nonzero(level) for level in bare.levels] == [64, 16, 4, 1, 1, 1]
    plain = texture.page(texels, np.full((64, 1), 2.0), dilation=1)
    assert len(plain.levels) == 1
    np.testing.assert_array_equal(plain.levels[0], page.levels[0])


def test_trilinear_is_bilinear_on_whole_levels_and_between_them():
    image = RNG.normal(size=(16, 16, 2)).astype(np.float32)
    levels = [level for level, _ in mipmap.pyramid(image, full(16), 99)]
    uv = RNG.random((50, 2))
    for level in (0, 1, 4):
        found = mipmap.trilinear(levels, uv, np.full(50, float(level)))
        np.testing.assert_allclose(found, bilinear(levels[level], uv), atol=1e-6)
    half = mipmap.trilinear(levels, uv, np.full(50, 1.25))
    np.testing.assert_allclose(half, 0.75 * bilinear(levels[1], uv) + 0.25 * bilinear(levels[2], uv), atol=1e-6)
    np.testing.assert_array_equal(mipmap.trilinear(levels, uv, np.full(50, 9.0))[:1], levels[-1][0])


@pytest.mark.parametrize(("padding", "levels"), [(1, 1), (2, 2), (3, 2), (4, 3), (64, 7)])
def test_padding_bounds_the_levels(padding, levels):
    assert mipmap.level_count(padding) == levels
    assert mipmap.sides(1024, levels) == [1024 >> level for level in range(levels)]
    assert mipmap.sides(20, 99) == [20, 10, 5, 2, 1]
