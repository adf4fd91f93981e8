"""Exported forms other than literals of all digits, run on the driver against NumPy."""

import numpy as np
import pytest

from prtnet import gl, netspec, sh
from prtnet.data import atlas
from prtnet.export import fold, form, glsl, limits, shading, weight_texture
from prtnet.export.bundle import bundle
from prtnet.export.form import Form
from prtnet.render import verify
from prtnet.render.camera import Camera
from prtnet.render.material import Material, irradiance, radiance
from prtnet.render.method import NetMethod
from prtnet.render.pixelwise import Pass
from prtnet.render.raster import Raster
from tests.nets import random_grid, random_hash, random_net
from tests.render.meshes import scene, sphere


def points(count=500, seed=1):
    return verify.random_points(count, np.random.default_rng(seed))


def error_of(net, chosen: Form) -> float:
    """Against the twin of the rounded net."""
    weights = weight_texture.texels(net, chosen.precision) if chosen.storage == "texture" else None
    text = glsl.transfer(net, chosen)
    return verify.glsl_error(form.rounded(net, chosen), text, *points(), weights=weights).highest


@pytest.mark.parametrize(
    "fields",
    [
        {"activation": "gelu", "output": "linear", "residual": True, "bands": 4},
        {"width": 6, "depth": 1, "bands": 3, "groups": 4, "output": "linear"},
        {"grids": (random_grid(3, 2, 2),), "hashes": (random_hash(16, channels=8),), "width": 13},
        {"depth": 0, "encoding": "identity", "residual": True, "output": "linear"},
        {"bands": 7, "activation": "sine"},
    ],
)
@pytest.mark.parametrize("precision", form.PRECISIONS)
def test_a_weight_texture_gives_what_numpy_gives(fields, precision):
    net = random_net(**fields)
    assert error_of(net, Form(storage="texture", precision=precision)) <= verify.TOLERANCE


def test_a_wide_network_is_drawn_from_a_weight_texture():
    net = random_net(width=128, depth=4)
    assert glsl.padded_macs(net) > form.AUTO_LITERAL_MACS
    assert error_of(net, Form().of(net)) <= verify.TOLERANCE


def test_another_weight_in_the_texture_is_seen():
    net = random_net()
    weights = weight_texture.texels(net)
    weights[1, 3, 2] += 1e-3
    text = glsl.emit(net, storage="texture")
    assert verify.glsl_error(net, text, *points(), weights=weights).highest > verify.TOLERANCE


@pytest.mark.parametrize("chosen", [Form(storage="literal", digits=6), Form(storage="literal", precision="float16")])
def test_rounded_literals_are_those_of_the_rounded_net(chosen):
    net = random_net(width=6, depth=1)
    assert error_of(net, chosen) <= verify.TOLERANCE
    # and the rounding is not below what is compared
    positions, normals = points()
    loss = netspec.evaluate_unit(form.rounded(net, chosen), positions, normals) - netspec.evaluate_unit(
        net, positions, normals
    )
    assert np.abs(loss).max() > (1e-7 if chosen.digits == 6 else 1e-4)


def shaded(net, text, light, positions, normals, glossy=False, weights=None, **uniforms):
    found = verify.textures(net, positions, normals, weights)
    known = {"prt_light": light, "albedo": (0.8, 0.5, 0.2), **uniforms}
    drawn = Pass(shading.around(net, text, glossy=glossy), found, known)
    return drawn.read()[: len(positions), :3]


@pytest.mark.parametrize("groups", [1, 4])
def test_shading_functions_agree_with_the_material(groups):
    net = random_net(bands=3, groups=groups, residual=True, output="linear", width=6, depth=1)
    light = np.random.default_rng(2).normal(size=(9, 3)).astype(np.float32)
    positions, normals = points()
    transfer = netspec.evaluate_unit(net, positions.astype(np.float64), normals)
    text = glsl.emit(net) + shading.functions(net)
    for glossy in (False, True):
        eye, specular, exponent = (0.5, 1.5, 2.0), (0.5, 0.25, 0.125), 12.0
        material = Material(specular=specular, exponent=exponent, product="full") if glossy else Material()
        albedo = np.tile([0.8, 0.5, 0.2], (len(positions), 1))
        expected = radiance(material, albedo, transfer, light, normals, np.array(eye) - positions, groups=groups)
        more = {"eye": eye, "specular": specular, "exponent": exponent} if glossy else {}
        found = shaded(net, text, light, positions, normals, glossy, **more)
        np.testing.assert_allclose(found, expected, atol=2e-5)


@pytest.mark.parametrize("storage", ["literal", "texture"])
@pytest.mark.parametrize("fields", [{"residual": True}, {"groups": 4, "residual": True}, {"depth": 0, "groups": 4}])
def test_folded_light_gives_the_irradiance_of_the_coefficients(storage, fields):
    net = random_net(output="linear", bands=3, **{"width": 6, "depth": 1, **fields})
    positions, normals = points()
    transfer = netspec.evaluate_unit(net, positions.astype(np.float64), normals)
    chosen = Form(storage=storage)
    text = fold.irradiance(net, chosen) + shading.diffuse_on_irradiance(net)
    weights = weight_texture.texels(net) if storage == "texture" else None
    # a light of fewer bands, and one of more
    for count in (4, 9, 16):
        light = np.random.default_rng(count).normal(size=(count, 3))
        found = shaded(net, text, light, positions, normals, weights=weights, **fold.uniforms(net, light))
        expected = irradiance(transfer, light, net.groups) * [0.8, 0.5, 0.2] / np.pi
        np.testing.assert_allclose(found, expected, atol=2e-5)


def test_folding_is_exact_to_rounding():
    """Of h at any point: a random one stands for it."""
    net = random_net(output="linear", bands=4)
    light = np.random.default_rng(0).normal(size=(16, 3))
    weights, biases = fold.fold(net, light)
    h = np.random.default_rng(1).normal(size=8)
    coefficients = net.output_scale * (net.weights[-1] @ h + net.biases[-1])
    np.testing.assert_allclose(weights @ h + biases, light.T @ coefficients, rtol=1e-5)
    assert sh.count(net.bands) * 8 > weights.size


def test_the_driver_at_hand_has_what_opengl_promises():
    found, least = limits.of_driver(gl.context().info), limits.MINIMUM["330"]
    for field in ("block_bytes", "blocks", "components", "texture_side", "volume_side", "samplers"):
        assert getattr(found, field) >= getattr(least, field), field
    assert found.name


@pytest.mark.parametrize("storage", ["literal", "texture"])
@pytest.mark.parametrize("groups", [1, 4])
def test_a_net_is_drawn_with_the_light_folded_as_without(storage, groups):
    """And anew at a change of the light; a glossy material takes the coefficients."""
    raster = Raster(atlas.make(scene(sphere(24)), size=64), 48)
    eye = Camera((0.4, 0.9, 2.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
    net = random_net(bands=3, groups=groups, output="linear", residual=True, width=6, depth=1)
    made = bundle(net, Form(storage=storage))
    assert made.irradiance
    both = {"weights": made.weights, "groups": groups}
    plain = NetMethod(raster, made.transfer, **both)
    folded = NetMethod(raster, made.transfer, folding=(made.net, made.irradiance), **both)
    for seed in (0, 1):
        light = np.random.default_rng(seed).normal(size=(9, 3)).astype(np.float32)
        expected = plain.draw(eye, light)
        assert expected.any()
        np.testing.assert_allclose(folded.draw(eye, light), expected, atol=2e-5)
    shiny = Material(specular=(0.5, 0.5, 0.5), product="full")
    pair = [
        NetMethod(raster, made.transfer, material=shiny, folding=folding, **both).draw(eye, light)
        for folding in (None, (made.net, made.irradiance))
    ]
    np.testing.assert_array_equal(*pair)
