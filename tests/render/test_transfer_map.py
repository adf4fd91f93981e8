"""Transfer textures on the driver: mip levels, level of detail, formats and sets, against NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import atlas, atlas_set, mipmap, quantise, texture
from prtnet.data.texture import Page
from prtnet.render import transfer_map
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import shade
from prtnet.render.method import TextureMethod
from prtnet.render.raster import Raster
from tests.render.meshes import atlas_uv, bilinear, quad, scene, sphere

SIZE = 96
FRONT = Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
SIDE = Camera((1.6, 0.7, 3.5), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
LIGHT = np.random.default_rng(3).normal(size=(9, 3)).astype(np.float32)
# levels that have nothing to do with each other, so that none is taken for another
RNG = np.random.default_rng(0)


def unrelated(size: int) -> Page:
    levels = tuple(RNG.normal(size=(side, side, 9)).astype(np.float32) for side in mipmap.sides(size, 99))
    return Page(levels, np.ones((size, size), bool))


@pytest.fixture(scope="module")
def board() -> Raster:
    return Raster(atlas.make(scene(quad([-1, -1, 0], [2, 0, 0], [0, 2, 0])), size=512), SIZE)


@pytest.mark.parametrize("texels", list(quantise.FORMATS))
@pytest.mark.parametrize("size", [64, 100, 512])
def test_level_by_distance_is_the_twins(texels, size):
    """Every pixel of a sphere reads the levels and weights that NumPy does."""
    drawing = Raster(atlas.make(scene(sphere(48)), size=size), SIZE)
    page = unrelated(size)
    drawn = TextureMethod(drawing, [page], texels=texels, level_of_detail="distance").draw(SIDE, LIGHT)
    found = drawing.gbuffer(SIDE)
    away = np.linalg.norm(found.positions - np.array(SIDE.eye), axis=1).astype(np.float64)
    (side,) = transfer_map.texel_sizes(drawing.atlas, [size])
    level = transfer_map.levels_by_distance(away, SIDE, SIZE, side)
    levels = quantise.decode(quantise.encode(page.levels, page.used, texels))
    uv = atlas_uv(drawing.atlas, found.face, found.positions.astype(np.float64))
    expected = shade(found, mipmap.trilinear(levels, uv, level), LIGHT)
    assert {64: level.max() == 0, 100: 0 <= level.max() < 1, 512: level.min() > 1}[size]
    error = np.abs(drawn - expected).max(axis=-1)
    # filters have 8 bits of fraction, of bytes also 8 bits of result
    assert np.median(error[expected.any(axis=-1)]) < (0.02 if texels != "uint8" else 0.04)
    assert np.percentile(error, 99) < 0.15


def test_level_by_derivative_on_a_board_that_faces_the_eye(board):
    """A board of 512 texels, a known number of them to a pixel: both rules choose the same level."""
    page = unrelated(512)
    found = board.gbuffer(FRONT)
    per_pixel = transfer_map.pixel_angle(FRONT, SIZE) * 3.0 / (2 / 512)
    uv = atlas_uv(board.atlas, found.face, found.positions.astype(np.float64))
    level = np.full(len(uv), np.log2(per_pixel))
    expected = shade(found, mipmap.trilinear(page.levels, uv, level), LIGHT)
    drawn = TextureMethod(board, [page]).draw(FRONT, LIGHT)
    error = np.abs(drawn - expected).max(axis=-1)
    # drivers may approximate the logarithm
    assert np.median(error[expected.any(axis=-1)]) < 0.1
    (side,) = transfer_map.texel_sizes(board.atlas, [512])
    assert side == pytest.approx(2 / 512, rel=1e-3)
    wrong = shade(found, mipmap.trilinear(page.levels, uv, level + 1), LIGHT)
    assert np.median(np.abs(drawn - wrong).max(axis=-1)[expected.any(axis=-1)]) > 0.3


def test_without_levels_both_rules_are_bilinear(board):
    image = RNG.normal(size=(64, 64, 9)).astype(np.float32)
    frames = [
        TextureMethod(board, image, level_of_detail=rule).draw(FRONT, LIGHT) for rule in transfer_map.LEVELS_OF_DETAIL
    ]
    np.testing.assert_array_equal(*frames)


@pytest.mark.parametrize("rule", transfer_map.LEVELS_OF_DETAIL)
def test_constant_transfer_has_no_seams_on_any_level(rule):
    """From far away, charts with empty texels between them: no chart border darkens."""
    drawing = Raster(atlas.make(replace(scene(sphere(24)), uv=None), size=256), 48)
    texels = texture.gbuffer(drawing.atlas, 256)
    assert 0.2 < texture.mask(texels).mean() < 0.95
    values = np.tile(sh.cosine_lobe(np.array([[0.0, 0.0, 1.0]]), 1), (len(texels.index), 1))
    white = np.full((1, 3), np.sqrt(4 * np.pi), np.float32)
    for distance in (2.5, 5.0, 10.0):
        eye = Camera((0.0, 0.0, distance), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=20.0)
        found = drawing.gbuffer(eye)
        for levels in (1, 3, 9):
            page = texture.page(texels, values, levels=levels)
            drawn = TextureMethod(drawing, [page], level_of_detail=rule).draw(eye, white)
            np.testing.assert_allclose(drawn.reshape(-1, 3)[found.pixel], found.albedo, rtol=1e-5)


def test_each_part_reads_its_own_page():
    """Two quads with the same coordinates, one texture each of another size."""
    left = quad([-1, -1, 0], [0.9, 0, 0], [0, 2, 0], name="left", albedo=np.ones(3))
    right = quad([0.1, -1, 0], [0.9, 0, 0], [0, 1, 0], name="right", albedo=np.ones(3))
    made = atlas_set.make(scene(left, right), size=128, single_chart=False, unwrap_mode="never", padding=1)
    drawing = Raster(made, SIZE)
    pages = [unrelated(side) for side in made.sides or ()]
    pages = [Page(page.levels[:1], page.used) for page in pages]
    assert len(pages[0].used) > len(pages[1].used)
    found = drawing.gbuffer(FRONT)
    uv = atlas_uv(made, found.face, found.positions.astype(np.float64))
    number = made.page_of_face[found.face]
    assert set(number) == {0, 1}
    values = np.stack([bilinear(page.levels[0], uv) for page in pages])[number, np.arange(len(uv))]
    for texels, bound in (("float32", 0.02), ("uint8", 0.06)):
        method = TextureMethod(drawing, pages, texels=texels)
        error = np.abs(method.draw(FRONT, LIGHT) - shade(found, values, LIGHT)).max(axis=-1).reshape(-1)
        assert np.median(error[found.pixel]) < bound
        size = quantise.FORMATS[texels]
        assert method.bytes == sum(len(page.used) ** 2 for page in pages) * 3 * 4 * size


def test_bytes_count_all_levels(board):
    assert TextureMethod(board, [unrelated(64)]).bytes == sum(side**2 for side in mipmap.sides(64, 99)) * 3 * 16


def test_unknown_rule():
    with pytest.raises(PrtnetError, match=r"atlas\.level_of_detail: found 'size', expected one of derivative, dist"):
        transfer_map.check("size")
