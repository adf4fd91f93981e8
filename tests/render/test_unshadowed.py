"""Transfer of open points in the shader against `sh.cosine_lobe` at the same pixels."""

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import atlas
from prtnet.export import unshadowed
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import shade
from prtnet.render.marched import Drawing, Marched
from prtnet.render.material import DIFFUSE, Material, OfPart
from prtnet.render.raster import Raster
from prtnet.render.unshadowed import UnshadowedMethod
from tests.render.meshes import scene, sphere
from tests.render.surfaces import still_life

SIZE = 48
EYE = Camera((1.4, 1.2, 2.6), (0.0, 0.0, 0.0))
GLOSSY = {"diffuse": 0.5, "specular": (0.5, 0.25, 0.5), "exponent": 12.0}
MATERIALS = {
    "diffuse": DIFFUSE,
    "fixed light": Material(**GLOSSY),
    "full": Material(**GLOSSY, product="full"),
    "fewer bands of light": Material(**GLOSSY, light_bands=2),
}


@pytest.fixture(scope="module", params=["mesh", "implicit"])
def drawing(request) -> Drawing:
    if request.param == "implicit":
        return Marched(still_life(), SIZE)
    return Raster(atlas.make(scene(sphere(24)), size=64), SIZE)


def light_of(bands: int) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(sh.count(bands), 3)).astype(np.float32)


def compared(drawing: Drawing, bands: int, material: Material) -> None:
    found, light = drawing.gbuffer(EYE), light_of(material.orders(bands)[0])
    image = UnshadowedMethod(drawing, bands, material=material).draw(EYE, light)
    wanted = shade(found, sh.cosine_lobe(found.normals, bands), light, material)
    assert np.abs(wanted).max() > 0.1
    np.testing.assert_allclose(image, wanted, atol=1e-4 * np.abs(wanted).max())


@pytest.mark.parametrize("material", MATERIALS.values(), ids=list(MATERIALS))
def test_it_is_the_cosine_lobe(drawing, material):
    compared(drawing, 3, material)


@pytest.mark.parametrize("bands", [1, 2, 5])
def test_all_orders_are(bands):
    compared(Marched(still_life(), SIZE), bands, DIFFUSE)


def test_parts_reflect_otherwise():
    parts = {"part 1": OfPart(exponent=3.0), "part 2": OfPart(diffuse=0.1)}
    compared(Marched(still_life(), SIZE), 3, Material(**GLOSSY, parts=parts))


def test_it_costs_a_few_products_and_no_bytes(drawing):
    assert UnshadowedMethod(drawing, 3).bytes == 0
    counts = [unshadowed.macs(bands) for bands in range(1, 7)]
    assert counts[0] == 1  # the constant and its weight
    assert counts == sorted(counts)
    assert counts[-1] < 150


def test_another_order_of_light_is_refused(drawing):
    with pytest.raises(PrtnetError, match="light: found 4 SH coefficients, expected 9"):
        UnshadowedMethod(drawing, 3).draw(EYE, light_of(2))
