"""Weights of vectors on screen against their NumPy twins, and against the methods that keep the whole transfer."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import texture, vertex
from prtnet.data.atlas import make
from prtnet.data.bilinear import bilinear
from prtnet.data.scene import Scene
from prtnet.export import linear as texts
from prtnet.models import pca
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import shade
from prtnet.render.linear import LinearTextureMethod, LinearVertexMethod, Table, decoded_page
from prtnet.render.material import DIFFUSE, Material, OfPart
from prtnet.render.method import TextureMethod
from prtnet.render.raster import Raster
from prtnet.render.vertex import VertexMethod, shade_vertices
from tests.render.meshes import quad, scene, sphere

SIZE, SIDE = 64, 64
EYE = Camera((0.4, 0.9, 2.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
GLOSSY = Material(diffuse=0.6, specular=(0.4, 0.3, 0.2), exponent=9.0)


def random_light(count: int) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(count, 3)).astype(np.float32)


def toy() -> Scene:
    return scene(sphere(12, radius=0.5), quad([-1, -0.5, 1], [2, 0, 0], [0, 0, -2], name="ground"))


@pytest.fixture(scope="module")
def drawing() -> Raster:
    return Raster(make(replace(toy(), uv=None), size=SIDE), SIZE)


def transfer_at(positions: np.ndarray, normals: np.ndarray, channels: int) -> np.ndarray:
    """Lobes with waves over the surface, which no few vectors hold, and different ones in each group of nine."""
    groups = channels // 9
    waves = 1 + 0.5 * np.sin(9 * positions @ np.random.default_rng(1).normal(size=(3, channels)))
    return (np.tile(sh.cosine_lobe(normals, 3), (1, groups)) * waves).astype(np.float32)


@pytest.fixture(scope="module")
def pages(drawing):
    """By channels: a page of transfer, 36 of them."""
    texels = texture.gbuffer(drawing.atlas, SIDE)
    return texture.page(texels, transfer_at(texels.positions, texels.normals, 36), dilation=3)


def few(page, channels: int):
    return replace(page, levels=tuple(level[..., :channels] for level in page.levels))


def fitted(page, elements: int, clusters: int) -> pca.Linear:
    values = page.levels[0][page.used]
    return pca.fit(values, np.ones(len(values)), elements=elements, clusters=clusters, rng=np.random.default_rng(0))


def twin(drawing: Raster, linear: pca.Linear, page, light, material, groups: int) -> np.ndarray:
    found = drawing.gbuffer(EYE)
    assert found.uv is not None
    transfer = bilinear(decoded_page(linear, page), found.uv, repeat=False)
    if groups == 3:  # of four the first is the direct one, which only gloss looks at
        transfer = np.concatenate([np.zeros((len(transfer), 9)), transfer], axis=1)
    return shade(found, transfer, light, material, groups=1 if groups == 1 else 4)


@pytest.mark.parametrize("clusters", [1, 12])
@pytest.mark.parametrize(("groups", "material"), [(1, DIFFUSE), (3, DIFFUSE), (1, GLOSSY), (4, GLOSSY)])
def test_texels_agree_with_numpy(drawing, pages, clusters, groups, material):
    page, light = few(pages, 9 * groups), random_light(9)
    linear = fitted(page, 6, clusters)
    method = LinearTextureMethod(drawing, linear, [page], groups=groups, material=material)
    expected = twin(drawing, linear, page, light, material, groups)
    assert (expected != 0).any(axis=-1).mean() > 0.3
    for lit in (random_light(9)[::-1], light):
        drawn = method.draw(EYE, lit)
    error = np.abs(drawn - expected)
    # where snapped edges show another chart, the look-ups are elsewhere
    assert np.percentile(error, 99) < 3e-4 * np.abs(expected).max()


def test_look_ups_across_clusters_are_no_means_of_weights(drawing, pages):
    """Most pixels lie between texels of different clusters here."""
    page, light = few(pages, 9), random_light(9)
    linear = fitted(page, 2, 200)
    method = LinearTextureMethod(drawing, linear, [page])
    expected = twin(drawing, linear, page, light, DIFFUSE, 1)
    error = np.abs(method.draw(EYE, light) - expected)
    assert np.percentile(error, 99) < 3e-4 * np.abs(expected).max()


def test_all_vectors_are_the_texture(drawing, pages):
    page, light = few(pages, 9), random_light(9)
    wanted = TextureMethod(drawing, [page]).draw(EYE, light)
    for clusters in (1, 300):  # of which the second has an index of two bytes
        method = LinearTextureMethod(drawing, fitted(page, 9, clusters), [page])
        np.testing.assert_allclose(method.draw(EYE, light), wanted, atol=2e-4 * np.abs(wanted).max())
        index = {1: 0, 300: 2}[clusters]
        assert method.bytes == SIDE**2 * (3 * 16 + index) + clusters * 10 * 9 * 4


@pytest.mark.parametrize(("texels", "limit"), [("float16", 3e-3), ("uint8", 2e-2)])
@pytest.mark.parametrize("clusters", [1, 8])
def test_formats(drawing, pages, clusters, texels, limit):
    page, light = few(pages, 9), random_light(9)
    linear = fitted(page, 4, clusters)
    exact = LinearTextureMethod(drawing, linear, [page]).draw(EYE, light)
    method = LinearTextureMethod(drawing, linear, [page], texels=texels)
    error = np.abs(method.draw(EYE, light) - exact)
    assert 0 < np.percentile(error, 99) < limit * np.abs(exact).max()
    width = {"float16": 2, "uint8": 1}[texels]
    assert method.bytes == SIDE**2 * (4 * width + (clusters > 1)) + clusters * 5 * 9 * 4


def test_mip_levels_of_weights(drawing):
    """A small picture of a fine texture: levels of weights are the weights of levels."""
    texels = texture.gbuffer(drawing.atlas, SIDE)
    values = transfer_at(texels.positions, texels.normals, 9)
    page = texture.page(texels, values, dilation=3, levels=3)
    small, light = Raster(drawing.atlas, 16), random_light(9)
    wanted = TextureMethod(small, [page]).draw(EYE, light)
    found = LinearTextureMethod(small, fitted(page, 9, 1), [page]).draw(EYE, light)
    np.testing.assert_allclose(found, wanted, atol=2e-4 * np.abs(wanted).max())
    flat = TextureMethod(small, [replace(page, levels=page.levels[:1])]).draw(EYE, light)
    assert np.abs(flat - wanted).max() > 2e-2 * np.abs(wanted).max()


@pytest.fixture(scope="module")
def mesh():
    return vertex.mesh(toy(), ["ground"], 3)


@pytest.mark.parametrize("clusters", [1, 12])
@pytest.mark.parametrize(("groups", "material"), [(1, DIFFUSE), (3, DIFFUSE), (1, GLOSSY), (4, GLOSSY)])
def test_vertices_agree_with_numpy(mesh, clusters, groups, material):
    transfer, light = transfer_at(mesh.vertices, mesh.normals, 9 * groups), random_light(9)
    linear = pca.fit(
        transfer, np.ones(len(transfer)), elements=6, clusters=clusters, rng=np.random.default_rng(0)
    )  # fmt: skip
    method = LinearVertexMethod(mesh, linear, transfer, SIZE, groups=groups, material=material)
    decoded = pca.decode(linear, pca.encode(linear, transfer))
    if groups == 3:
        decoded = np.concatenate([np.zeros((len(decoded), 9)), decoded], axis=1)
    expected = shade_vertices(method.raster, EYE, decoded, light, material, groups=1 if groups == 1 else 4)
    assert (expected != 0).any(axis=-1).mean() > 0.2
    error = np.abs(method.draw(EYE, light) - expected)
    assert np.percentile(error, 99) < 1e-3 * np.abs(expected).max()
    index = clusters > 1
    assert method.bytes == len(transfer) * (2 * 16 + index) + clusters * 7 * 9 * groups * 4


def test_all_vectors_are_the_vertices(mesh):
    transfer, light = transfer_at(mesh.vertices, mesh.normals, 9), random_light(9)
    linear = pca.fit(transfer, np.ones(len(transfer)), elements=9, rng=np.random.default_rng(0))
    drawn = LinearVertexMethod(mesh, linear, transfer, SIZE).draw(EYE, light)
    wanted = VertexMethod(mesh, transfer, SIZE).draw(EYE, light)
    np.testing.assert_allclose(drawn, wanted, atol=2e-4 * np.abs(wanted).max())


def test_a_material_that_varies_at_vertices(mesh):
    """The vertex shader multiplies what it finds by the diffuse weight of the part."""
    name = mesh.materials[0].name
    material = Material(parts={name: OfPart(diffuse=0.25)})
    transfer, light = transfer_at(mesh.vertices, mesh.normals, 9), random_light(9)
    linear = pca.fit(transfer, np.ones(len(transfer)), elements=4, clusters=3, rng=np.random.default_rng(0))
    method = LinearVertexMethod(mesh, linear, transfer, SIZE, material=material)
    decoded = pca.decode(linear, pca.encode(linear, transfer))
    expected = shade_vertices(method.raster, EYE, decoded, light, material)
    error = np.abs(method.draw(EYE, light) - expected)
    assert np.percentile(error, 99) < 1e-3 * np.abs(expected).max()


def test_one_short_table_is_uniforms(drawing, pages):
    small, large = (Table(fitted(few(pages, 9), 4, clusters), 1, glossy=False) for clusters in (1, 2))
    assert texts.in_uniforms(small.values)
    assert "texelFetch" not in small.text
    assert not texts.in_uniforms(large.values)
    assert "texelFetch" in large.text
    # gloss over four groups in many vectors
    assert not texts.in_uniforms(Table(fitted(pages, 20, 1), 4, glossy=True).values)


def test_a_light_of_other_bands_is_refused(drawing, pages):
    page = few(pages, 9)
    method = LinearTextureMethod(drawing, fitted(page, 4, 2), [page])
    with pytest.raises(PrtnetError, match="found 16 SH coefficients, expected 9"):
        method.draw(EYE, random_light(16))
    wide = LinearTextureMethod(drawing, fitted(page, 4, 2), [page], material=Material(light_bands=4))
    # what the transfer has no band for is dark
    cut = method.draw(EYE, random_light(16)[:9])
    np.testing.assert_allclose(wide.draw(EYE, random_light(16)), cut, atol=1e-6 * np.abs(cut).max())
    with pytest.raises(PrtnetError, match="found 9 SH coefficients, expected 16"):
        wide.draw(EYE, random_light(9))
