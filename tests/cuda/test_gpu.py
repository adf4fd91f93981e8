"""The way through CUDA on a GPU: `./run gpu-check`, which installs pycuda where it is absent."""

import numpy as np
import pytest

from prtnet import netspec
from prtnet.data import atlas
from prtnet.export import glsl
from prtnet.models.device_net import DeviceNet
from prtnet.render.cuda_device import Device
from prtnet.render.interop import CudaNetMethod
from prtnet.render.method import NetMethod
from prtnet.render.raster import Raster
from tests.cuda.test_interop import EYE, GLOSSY, NETS, OWN, light
from tests.cuda.test_transfer import NETS as ALL_NETS
from tests.nets import random_net
from tests.render.meshes import scene, sphere

pytestmark = pytest.mark.gpu


@pytest.fixture(scope="module")
def device() -> Device:
    return Device()


@pytest.fixture(scope="module")
def drawing() -> Raster:
    return Raster(atlas.make(scene(sphere(32)), size=128), 256)


@pytest.mark.parametrize("in_torch", [False, True], ids=["kernel", "torch"])
@pytest.mark.parametrize("material", [GLOSSY, OWN], ids=["glossy", "parts"])
@pytest.mark.parametrize("name", NETS)
def test_the_picture_is_that_of_the_shader(name, material, in_torch, drawing, device):
    net = random_net(**NETS[name])
    shader = NetMethod(
        drawing,
        glsl.emit(net),
        material=material,
        groups=net.groups,
        grids=net.grids,
        hashes=net.hashes,
        texels=net.texels,
    )
    network = DeviceNet(net) if in_torch else None
    found = CudaNetMethod(drawing, net, material=material, device=device, network=network).draw(EYE, light())
    wanted = shader.draw(EYE, light())
    assert np.abs(found - wanted).max() <= np.abs(wanted).max() / 255


@pytest.mark.parametrize("name", ALL_NETS)
def test_transfer_is_that_of_numpy(name, drawing, device):
    net = random_net(**ALL_NETS[name])
    method = CudaNetMethod(drawing, net, device=device)
    method.draw(EYE, light(net.bands))
    with device.active():
        count = int(method.points.read()[0])
        positions, normals, transfer = (
            array.read()[:count] for array in (method.positions, method.normals, method.transfer)
        )
        uv = method.uv.read()[:count] if method.uv else None
    wanted = netspec.evaluate_unit(net, positions.astype(np.float64), normals, uv=uv)
    assert np.abs(transfer - wanted).max() <= 1e-5
