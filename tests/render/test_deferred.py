"""The deferred net against the one in a shader and against its plain twin on the same pixels."""

import numpy as np
import pytest

from prtnet import PrtnetError, gl, netspec, sh
from prtnet.data import atlas, builtin
from prtnet.export import glsl
from prtnet.render.camera import Camera
from prtnet.render.deferred import DeferredMethod
from prtnet.render.gbuffer import shade
from prtnet.render.material import DIFFUSE, Material, OfPart
from prtnet.render.method import NetMethod
from prtnet.render.raster import Raster
from tests.nets import random_grid, random_hash, random_net, random_texels

SIZE = 48
EYE = Camera((0.4, 0.9, 2.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
GLOSSY = {"diffuse": 0.5, "specular": (0.5, 0.25, 0.5), "exponent": 12.0}
MATERIALS = {
    "diffuse": DIFFUSE,
    "fixed light": Material(**GLOSSY),
    "full": Material(**GLOSSY, product="full"),
    "parts": Material(**GLOSSY, parts={"floor": OfPart(exponent=3.0), "ceiling": OfPart(diffuse=0.1)}),
    "fewer bands of light": Material(**GLOSSY, light_bands=2),
}


@pytest.fixture(scope="module")
def raster() -> Raster:
    return Raster(atlas.make(builtin.make("cornell", tessellation=0.25).centred(), size=64), SIZE)


def light_of(material: Material, bands: int) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(sh.count(material.orders(bands)[0]), 3)).astype(np.float32)


@pytest.mark.parametrize("groups", [1, 4])
@pytest.mark.parametrize("material", MATERIALS.values(), ids=list(MATERIALS))
def test_it_draws_what_the_shader_draws(raster, material, groups):
    net = random_net(bands=3, groups=groups, residual=True, output="linear", grids=(random_grid(3, 4, 5),))
    light = light_of(material, 3)
    deferred = DeferredMethod(raster, net, material=material).draw(EYE, light)
    shader = NetMethod(raster, glsl.emit(net), material=material, groups=groups, grids=net.grids).draw(EYE, light)
    scale = np.abs(shader).max()
    # points of the G-buffer are found in float64, those of the shader by the rasteriser
    np.testing.assert_allclose(deferred, shader, atol=1e-4 * scale)
    assert np.abs(deferred - shader).mean() < 1e-6 * scale


def test_it_is_the_plain_twin_of_net_and_shading(raster):
    net = random_net(width=16, hashes=(random_hash(8),), texels=(random_texels(9, 7),))
    light, gbuffer = light_of(DIFFUSE, 5), raster.gbuffer(EYE)
    transfer = netspec.evaluate_unit(net, gbuffer.positions, gbuffer.normals, uv=gbuffer.uv)
    wanted = shade(gbuffer, transfer, light)
    found = DeferredMethod(raster, net).draw(EYE, light)
    np.testing.assert_allclose(found, wanted, atol=1e-5 * np.abs(wanted).max())


def test_nets_that_no_shader_holds_are_drawn(raster):
    net = random_net(width=256, depth=4, activation="hard_gelu")
    with pytest.raises(PrtnetError):
        glsl.emit(net)
    method, light = DeferredMethod(raster, net), light_of(DIFFUSE, 5)
    image = method.draw(EYE, light)
    assert np.isfinite(image).all()
    assert np.abs(image).max() > 0.01
    assert method.milliseconds(EYE, light, repeats=1) > 0


def test_frames_need_not_be_square(raster):
    """A wide frame shows in its middle what a square one of the same height shows, and the alpha of what it covers."""
    net, light = random_net(bands=2), light_of(DIFFUSE, 2)
    square = DeferredMethod(raster, net).draw(EYE, light)
    wide = Raster(raster.atlas, 16)
    wide.resize(2 * SIZE, SIZE)
    method = DeferredMethod(wide, net)
    found = method.draw(EYE, light)
    assert found.shape == (SIZE, 2 * SIZE, 3)
    np.testing.assert_allclose(found[:, SIZE // 2 : -SIZE // 2], square, atol=5e-4 * np.abs(square).max())
    covered = wide.faces(EYE)[..., 0] > 0
    method.render(EYE)
    np.testing.assert_array_equal(wide.target.read()[..., 3] > 0, covered)


def test_another_order_of_light_is_refused(raster):
    with pytest.raises(PrtnetError, match="light: found 16 SH coefficients, expected 25"):
        DeferredMethod(raster, random_net()).draw(EYE, np.zeros((16, 3), np.float32))


def test_a_frame_written_is_read_back():
    image, target = np.random.default_rng(0).random((5, 7, 4), np.float32), gl.target(7, 5)
    target.write(image)
    np.testing.assert_array_equal(target.read(), image)
