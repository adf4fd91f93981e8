"""The whole way from OpenGL through CUDA and back, with pycuda as it is and an emulated driver: `./run cuda-test`."""

import numpy as np
import pytest
import torch

from experiments import bench_interop
from prtnet import PrtnetError, gl, netspec
from prtnet.data import atlas
from prtnet.export import glsl
from prtnet.models.device_net import DeviceNet
from prtnet.render.camera import Camera
from prtnet.render.cuda_device import Device, SharedTexture
from prtnet.render.interop import STAGES, CudaNetMethod
from prtnet.render.material import Material, OfPart
from prtnet.render.method import NetMethod
from prtnet.render.raster import Raster
from tests.cuda import emulated
from tests.cuda.test_transfer import DEFAULT
from tests.nets import random_net, random_texels
from tests.render.meshes import quad, scene, sphere

pytestmark = pytest.mark.cuda
SIZE = 96
EYE = Camera((0.4, 0.9, 2.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
AWAY = Camera((0.0, 0.0, 9.0), (0.0, 0.0, 20.0), fov_y=45.0, near=0.1, far=10.0)
GLOSSY = Material(0.5, (0.5, 0.25, 1.0), 20.0, radiance_bands=4)
OWN = Material(0.5, (0.2, 0.2, 0.2), 8.0, parts={"sphere": OfPart(0.9, (0.8, 0.6, 0.2), 40.0)})


@pytest.fixture(scope="module")
def device(tmp_path_factory):
    reason = emulated.missing()
    if reason:
        pytest.skip(reason)
    emulated.install(tmp_path_factory.mktemp("driver"))
    return Device()


@pytest.fixture(scope="module")
def drawing() -> Raster:
    floor = quad((-1.5, -0.7, 1.5), (3, 0, 0), (0, 0, -3))
    return Raster(atlas.make(scene(sphere(32, radius=0.7), floor), size=128), SIZE)


def light(bands: int = 3) -> np.ndarray:
    made = np.random.default_rng(4).normal(size=(bands**2, 3))
    made[0] += 3
    return made


def fused(drawing, device, folder, net, **more) -> CudaNetMethod:
    return CudaNetMethod(drawing, net, device=device, build=emulated.HostBuild(folder), **more)


def in_glsl(drawing, net, material) -> NetMethod:
    features = {"grids": net.grids, "hashes": net.hashes, "texels": net.texels}
    return NetMethod(drawing, glsl.emit(net), material=material, groups=net.groups, **features)


NETS = {
    "default recipe": {"width": 32, "depth": 2, "bands": 3, **DEFAULT},
    "groups": {"width": 8, "bands": 3, "groups": 4, "residual": True, "output": "linear"},
    "texels": {"width": 8, "bands": 3, "output": "linear", "texels": (random_texels(40, 30),)},
}


@pytest.mark.parametrize("material", [Material(0.8), GLOSSY, OWN], ids=["diffuse", "glossy", "parts"])
@pytest.mark.parametrize("name", NETS)
def test_the_picture_is_that_of_the_shader(name, material, drawing, device, tmp_path):
    net = random_net(**NETS[name])
    wanted = in_glsl(drawing, net, material).draw(EYE, light())
    method = fused(drawing, device, tmp_path, net, material=material)
    found = method.draw(EYE, light())
    covered = drawing.faces(EYE)[..., 0] > 0
    assert 0.2 < covered.mean() < 0.9
    white = np.abs(wanted).max()
    assert np.abs(found - wanted).max() <= white / 255
    # a pixel or two on an edge may fall to either side; the rest agrees to rounding
    assert np.quantile(np.abs(found - wanted), 0.999) <= 1e-4 * white
    assert method.texture.components == 4
    assert (found[~covered] == 0).all()


@pytest.mark.parametrize("name", ["default recipe", "texels"])
def test_transfer_is_that_of_numpy(name, drawing, device, tmp_path):
    net = random_net(**NETS[name])
    method = fused(drawing, device, tmp_path, net)
    method.draw(EYE, light())
    with device.active():
        count = int(method.points.read()[0])
        positions, normals, transfer = (
            array.read()[:count] for array in (method.positions, method.normals, method.transfer)
        )
        uv = method.uv.read()[:count] if method.uv else None
    assert count == (drawing.faces(EYE)[..., 0] > 0).sum()
    wanted = netspec.evaluate_unit(net, positions.astype(np.float64), normals, uv=uv)
    assert np.abs(transfer - wanted).max() <= 1e-5


@pytest.mark.parametrize("name", ["default recipe", "texels"])
def test_torch_takes_the_place_of_the_kernel_without_a_copy(name, drawing, device, tmp_path):
    net = random_net(**NETS[name])
    network = DeviceNet(net, "cpu", lambda array: torch.from_numpy(emulated.view(array)))
    kernel = fused(drawing, device, tmp_path, net, material=GLOSSY).draw(EYE, light())
    found = fused(drawing, device, tmp_path, net, material=GLOSSY, network=network).draw(EYE, light())
    np.testing.assert_allclose(found, kernel, atol=1e-4 * np.abs(kernel).max())


def test_methods_live_side_by_side(drawing, device, tmp_path):
    """Each with kernels of its own."""
    nets = [random_net(**NETS[name]) for name in NETS]
    methods = [fused(drawing, device, tmp_path, net) for net in nets]
    for net, method in zip(nets, methods, strict=True):
        wanted = in_glsl(drawing, net, Material()).draw(EYE, light())
        assert np.quantile(np.abs(method.draw(EYE, light()) - wanted), 0.999) <= 1e-4 * np.abs(wanted).max()


def test_buffers_stay_and_frames_follow_the_light_and_the_camera(drawing, device, tmp_path):
    net = random_net(**NETS["default recipe"])
    method, plain = fused(drawing, device, tmp_path, net, material=GLOSSY), in_glsl(drawing, net, GLOSSY)
    addresses = method.transfer.address, method.positions.address
    first = method.draw(EYE, light())
    dark = method.draw(EYE, 0 * light())
    assert (dark == 0).all()
    side = Camera((2.0, 0.3, 1.0), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
    moved, wanted = method.draw(side, light()[::-1]), plain.draw(side, light()[::-1])
    assert np.quantile(np.abs(moved - wanted), 0.999) <= 1e-4 * np.abs(wanted).max()
    np.testing.assert_array_equal(method.draw(EYE, light()), first)
    assert (method.transfer.address, method.positions.address) == addresses


def test_a_frame_of_nothing_is_black(drawing, device, tmp_path):
    method = fused(drawing, device, tmp_path, random_net(**NETS["default recipe"]))
    method.draw(EYE, light())
    assert (method.draw(AWAY, light()) == 0).all()
    with device.active():
        assert method.points.read() == 0


def test_every_stage_is_timed(drawing, device, tmp_path):
    method = fused(drawing, device, tmp_path, random_net(**NETS["default recipe"]))
    method.draw(EYE, light())
    assert tuple(method.stages()) == STAGES
    assert all(taken >= 0 for taken in method.median_stages(EYE, 2).values())
    assert method.milliseconds(EYE, light(), 1) > 0


def test_the_bench_has_a_row_for_each_width(device, tmp_path):
    table = bench_interop.table(
        bench_interop.rows(
            device, widths=(8, 300), depth=1, size=24, build=emulated.HostBuild(tmp_path), torch_too=False
        )
    )
    small, large = ([cell.strip() for cell in line.split("|")[1:]] for line in table.splitlines()[2:])
    assert (small[0], small[2]) == ("8", "literal")
    # literals have a limit, which neither a texture nor the kernels share
    assert (large[0], large[2]) == ("300", "texture")
    assert all(float(each) > 0 for row in (small, large) for each in row[3:5])


def test_a_texture_of_three_channels_is_refused(device):
    texture = gl.context().texture((8, 8), 3, dtype="f4")
    with device.active(), pytest.raises(PrtnetError, match="found a texture of 3 channels of f4, expected 4 of f4"):
        SharedTexture(device, texture)


def test_textures_that_the_driver_refuses_are_said(device, monkeypatch):
    register = device.gl.RegisteredImage
    monkeypatch.setattr(device.gl, "RegisteredImage", lambda name, *rest: register(0xFFFFFF, *rest))
    texture = gl.context().texture((8, 8), 4, dtype="f4")
    with device.active(), pytest.raises(PrtnetError, match=r"emulated cannot share .* OpenGL on .*NVIDIA's EGL"):
        SharedTexture(device, texture)


def test_memory_that_is_not_there_is_said(device):
    with device.active(), pytest.raises(PrtnetError, match=r"no room for \d+ bytes.*render\.size"):
        device.array(1 << 20, 1 << 30)


def test_a_light_of_other_bands_is_refused(drawing, device, tmp_path):
    method = fused(drawing, device, tmp_path, random_net(**NETS["default recipe"]))
    with pytest.raises(PrtnetError, match="found 16 SH coefficients, expected 9"):
        method.set_light(light(4))
