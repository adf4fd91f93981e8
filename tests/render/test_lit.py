"""Transfer textures with the light between surfaces, against NumPy."""

import numpy as np
import pytest

from prtnet.data import texture
from prtnet.render.gbuffer import shade
from prtnet.render.lit import LitTextureMethod
from prtnet.render.material import Material
from prtnet.render.raster import Raster
from tests.render.meshes import atlas_uv, bilinear
from tests.render.test_raster import EYE, ball, random_light


@pytest.fixture(scope="module")
def drawing() -> Raster:
    return ball()


def smooth(rng, channels):
    """A texture whose neighbours are alike, so that the 8 bits of the blending weights do not show."""
    x, y = np.meshgrid(np.linspace(0, 1, 64), np.linspace(0, 1, 64))
    a, b, c = rng.normal(size=(3, channels))
    return (a + b * x[..., None] + c * y[..., None]).astype(np.float32)


def split(drawing, image, count):
    """(G-buffer, transfer, incident light) of the pixels."""
    found = drawing.gbuffer(EYE)
    values = bilinear(image, atlas_uv(drawing.atlas, found.face, found.positions.astype(np.float64)))
    return found, values[:, :count], values[:, count:].reshape(-1, 3, count).transpose(0, 2, 1)


@pytest.mark.parametrize("bands", [1, 2, 3, 5])
@pytest.mark.parametrize("specular", [0.0, 0.5])
@pytest.mark.parametrize("texels", ["float32", "uint8"])
def test_it_draws_what_numpy_says(drawing, bands, specular, texels):
    count, material = bands * bands, Material(0.8, (specular,) * 3, 12.0)
    image, light = smooth(np.random.default_rng(bands), 4 * count), random_light(count)
    method = LitTextureMethod(drawing, [texture.page_of(image)], material=material, texels=texels)
    found, transfer, incident = split(drawing, image, count)
    expected = shade(found, transfer, light, material, incident=incident)
    error = np.abs(method.draw(EYE, light) - expected)
    assert np.percentile(error, 99) < (0.02 if texels == "uint8" else 2e-3) * np.abs(expected).max()
    layers = -(-count // 4)
    assert method.bytes == 64 * 64 * 4 * (4 * layers if specular else layers + 1) * (1 if texels == "uint8" else 4)


@pytest.mark.parametrize("product", ["fixed_light", "full"])
def test_orders_that_differ(drawing, product):
    material = Material(0.5, (0.4, 0.3, 0.2), 9.0, product, {}, "config", 2, 3)
    image, light = smooth(np.random.default_rng(0), 64), random_light(4)
    found, transfer, incident = split(drawing, image, 16)
    expected = shade(found, transfer, light, material, incident=incident)
    drawn = LitTextureMethod(drawing, [texture.page_of(image)], material=material).draw(EYE, light)
    assert np.percentile(np.abs(drawn - expected), 99) < 2e-3 * np.abs(expected).max()
