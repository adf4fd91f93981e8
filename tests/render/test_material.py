"""Gloss: identities and closed forms in NumPy, GLSL against NumPy, the place of a highlight, refusals."""

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prtnet import PrtnetError, sh
from prtnet.data import atlas, light, texture
from prtnet.export import gloss, glsl
from prtnet.render import material as materials
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import shade
from prtnet.render.material import Material
from prtnet.render.method import NetMethod, TextureMethod
from prtnet.render.raster import Raster
from tests.nets import random_net
from tests.render.meshes import scene, sphere

SIZE = 96
EYE = Camera((0.4, 0.9, 2.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
PRODUCTS = [Material(0.5, (0.5, 0.25, 1.0), 20.0, product) for product in materials.PRODUCTS]


def unit(count: int, seed: int = 0) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def random_coefficients(rows: int, columns: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(rows, columns))


@pytest.fixture(scope="module")
def ball() -> Raster:
    return Raster(atlas.make(scene(sphere(64)), size=256), SIZE)


def open_texture(drawing: Raster) -> np.ndarray:
    """Transfer of a ball that nothing occludes."""
    texels = texture.gbuffer(drawing.atlas, 256)
    return texture.assemble(texels, sh.cosine_lobe(texels.normals, 5))


@pytest.mark.parametrize("bands", [2, 5])
def test_tau_is_symmetric_in_all_its_orders(bands):
    tau = sh.triple_product(bands, bands, bands)
    for axes in [(0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)]:
        np.testing.assert_allclose(tau.transpose(axes), tau, atol=1e-12)
    # the pairs of gloss.py rest on the matrix of a light being symmetric, too
    matrix = materials.fixed_light_matrix(random_coefficients(bands**2, 3), bands)
    np.testing.assert_allclose(matrix, matrix.transpose(0, 2, 1), atol=1e-12)


@given(st.integers(1, 5), st.integers(1, 5), st.data())
def test_the_full_product_is_the_fixed_lights_matrix(bands, bands_light, data):
    bands_out = data.draw(st.integers(1, bands + bands_light - 1))
    transfer, sun = random_coefficients(20, bands**2), random_coefficients(bands_light**2, 3, 2)
    facing = materials.lobe(unit(20), 12.0, bands_out)
    matrix, whole = (materials.reflected(transfer, sun, facing, product) for product in materials.PRODUCTS)
    np.testing.assert_allclose(matrix, whole, atol=1e-12)


def test_transferred_radiance_is_the_product_of_two_functions():
    """Values of transfer times values of light, projected by quadrature: no tau in it."""
    transfer, sun = random_coefficients(1, 25), random_coefficients(25, 3, 2)
    directions, weights = sh.quadrature(12)
    basis = sh.evaluate(directions, 5)
    expected = sh.project((basis @ transfer[0])[:, None] * (basis @ sun), directions, weights, 5)
    found = np.stack([transfer[0] @ colour for colour in materials.fixed_light_matrix(sun, 5)], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("product", materials.PRODUCTS)
def test_a_constant_light_reflects_the_transfers_own_expansion(product):
    transfer, facing = random_coefficients(30, 25), materials.lobe(unit(30), 9.0, 5)
    constant = np.zeros((25, 3))
    constant[0] = np.array([1.0, 2.0, 0.5]) * np.sqrt(4 * pi)
    expected = np.sum(transfer * facing, axis=1)[:, None] * [1.0, 2.0, 0.5]
    np.testing.assert_allclose(materials.reflected(transfer, constant, facing, product), expected, atol=1e-12)


@pytest.mark.parametrize("exponent", [1.0, 5.0, 20.0])
@pytest.mark.parametrize("bands", [3, 5, 9])
def test_white_light_straight_on_gives_e_plus_1_by_e_plus_2(exponent, bands):
    """Unoccluded, r = n: sum_l s_l A_l (2l+1)/4pi, which tends to the integral of lobe times cosine."""
    normals = unit(10)
    white = np.zeros((bands**2, 3))
    white[0] = np.sqrt(4 * pi)
    shiny = Material(0.0, (0.5, 0.5, 0.5), exponent)
    found = materials.radiance(shiny, np.ones((10, 3)), sh.cosine_lobe(normals, bands), white, normals, 3.0 * normals)
    l = np.arange(bands)
    series = np.sum(sh.phong_lobe(exponent, bands) * sh.cosine_zonal(bands) * (2 * l + 1)) / (4 * pi)
    np.testing.assert_allclose(found, 0.5 * series, rtol=1e-9)
    # the band error is what the bands that are cut would add
    cut = np.arange(bands, 400)
    left_out = (sh.phong_lobe(exponent, 400) * sh.cosine_zonal(400))[bands:] * (2 * cut + 1) / (4 * pi)
    closed = (exponent + 1) / (exponent + 2)
    assert series + left_out.sum() == pytest.approx(closed, abs=1e-8)
    assert abs(series - closed) < 0.05


def test_gloss_is_the_blurred_light_seen_in_the_mirror():
    """Without occlusion and with a lobe that is wide: quadrature of the truncated functions, no SH products."""
    normals, towards = unit(6, 3), unit(6, 4)
    sun = random_coefficients(25, 3, 5)
    directions, weights = sh.quadrature(40)
    basis = sh.evaluate(directions, 5)
    shiny = Material(0.0, (1.0, 1.0, 1.0), 4.0)
    found = materials.radiance(shiny, np.ones((6, 3)), sh.cosine_lobe(normals, 5), sun, normals, towards)
    for i in range(6):
        reflected = 2 * (normals[i] @ towards[i]) * normals[i] - towards[i]
        incoming = (basis @ sh.cosine_lobe(normals[i], 5))[:, None] * (basis @ sun)
        cut = basis @ sh.project(incoming, directions, weights, 5)
        series = sh.phong_lobe(4.0, 5) * (2 * np.arange(5) + 1) / (4 * pi)
        zonal = np.polynomial.legendre.legval(directions @ reflected, series)
        np.testing.assert_allclose(found[i], (weights * zonal) @ cut, atol=1e-9)


def test_mirrored_directions():
    normals, towards = 5 * unit(50, 1), 2 * unit(50, 2)
    found = materials.mirrored(towards, normals)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)
    half = found + towards / 2
    # the two directions have the normal between them, and the same angle to it
    np.testing.assert_allclose(np.cross(half, normals), 0, atol=1e-12)
    np.testing.assert_allclose(np.sum(found * normals, 1), np.sum(towards / 2 * normals, 1), atol=1e-12)


@pytest.mark.parametrize("shiny", PRODUCTS, ids=lambda m: m.product)
@pytest.mark.parametrize("bands", [1, 2, 4, 5])
def test_texture_shader_agrees_with_numpy(ball, shiny, bands):
    """One transfer in all texels, so that nothing but shading is compared; a different random light each time."""
    own = random_coefficients(1, bands**2).astype(np.float32)
    method = TextureMethod(ball, np.broadcast_to(own, (16, 16, bands**2)), material=shiny)
    found = ball.gbuffer(EYE)
    transfer = np.broadcast_to(own, (len(found.pixel), bands**2))
    for seed in (2, 3):
        sun = random_coefficients(bands**2, 3, seed).astype(np.float32)
        drawn, expected = method.draw(EYE, sun), shade(found, transfer, sun, shiny)
        error = np.abs(drawn - expected)
        assert np.percentile(error, 99) < 2e-5 * np.abs(expected).max()
        # pixels whose centre lies a hair outside of its triangle
        assert error.max() < 0.03 * np.abs(expected).max()


@pytest.mark.parametrize("shiny", PRODUCTS, ids=lambda m: m.product)
def test_net_shader_agrees_with_numpy(ball, shiny):
    from prtnet import netspec

    net = random_net(width=8, bands=5, position_frequencies=1, normal_frequencies=1, output_scale=0.5)
    sun = random_coefficients(25, 3).astype(np.float32)
    found = ball.gbuffer(EYE)
    transfer = netspec.evaluate_unit(net, found.positions, found.normals)
    drawn = NetMethod(ball, glsl.emit(net), material=shiny).draw(EYE, sun)
    expected = shade(found, transfer, sun, shiny)
    error = np.abs(drawn - expected)
    assert np.percentile(error, 99) < 5e-5 * np.abs(expected).max()
    assert error.max() < 0.03 * np.abs(expected).max()


def test_both_products_draw_the_same_and_a_new_light_is_seen(ball):
    image = open_texture(ball)
    methods = [TextureMethod(ball, image, material=shiny) for shiny in PRODUCTS]
    first, second = (light.project(one_texel(*at), 5) for at in ((4, 4), (10, 20)))
    before = [method.draw(EYE, first) for method in methods]
    after = [method.draw(EYE, second) for method in methods]
    again = [method.draw(EYE, first) for method in methods]
    for pair in (before, after):
        np.testing.assert_allclose(pair[0], pair[1], atol=2e-5 * pair[0].max())
    assert np.abs(before[0] - after[0]).max() > 0.1 * before[0].max()
    for one, other in zip(before, again, strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_same_light_is_compiled_once(ball):
    method = TextureMethod(ball, open_texture(ball), material=PRODUCTS[0])
    sun = random_coefficients(25, 3)
    method.set_light(sun)
    program = method.program
    method.draw(EYE, sun)
    assert method.program is program
    method.set_light(2 * sun)
    assert method.program is not program


def one_texel(row: int, column: int) -> np.ndarray:
    image = np.zeros((16, 32, 3), np.float32)
    image[row, column] = 100.0
    return image


@pytest.mark.parametrize(("row", "column"), [(4, 16), (5, 11), (6, 24), (9, 19), (3, 5)])
@pytest.mark.parametrize("product", materials.PRODUCTS)
def test_the_highlight_is_where_the_mirror_shows_the_lamp(ball, row, column, product):
    """A unit ball, one bright texel: the brightest pixel's normal halves the angle between lamp and eye."""
    lamp = light.directions(16, 32)[row, column]
    away = np.array([-lamp[2], 0.0, lamp[0]]) / np.hypot(lamp[0], lamp[2])
    # 60 degrees from the lamp: the mirror point lies well inside the ball's disc
    eye = 3.0 * (0.5 * lamp + np.sqrt(0.75) * away)
    camera = Camera((eye[0], eye[1], eye[2]), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
    shiny, sun = Material(0.0, (1.0, 1.0, 1.0), 50.0, product), light.project(one_texel(row, column), 5)
    drawn = TextureMethod(ball, open_texture(ball), material=shiny).draw(camera, sun)
    place = np.array(np.unravel_index(np.argmax(drawn[..., 0]), (SIZE, SIZE)))
    # where the lamp is in the mirror, by search over points of the ball: no harmonics, no shader
    points = unit(100_000, 9)
    points = points[points @ eye > 1]
    mirror = points[np.argmax(np.sum(materials.mirrored(eye - points, points) * lamp, axis=1))]
    assert np.abs(place - pixel_of(camera, mirror)).max() < 2


def pixel_of(camera: Camera, point: np.ndarray) -> np.ndarray:
    """(row, column), fractional, of a point in unit coordinates."""
    x, y, _, w = camera.matrix() @ np.array([*point, 1.0])
    return np.array([(1 - y / w) / 2, (x / w + 1) / 2]) * SIZE - 0.5


def test_diffuse_weight_scales_and_parts_add(ball):
    image, sun = open_texture(ball), light.project(light.sky(), 5)
    shaded = [
        TextureMethod(ball, image, material=each).draw(EYE, sun)
        for each in (Material(0.25), Material(0.0, (0.5, 0.5, 0.5), 20.0), Material(0.25, (0.5, 0.5, 0.5), 20.0))
    ]
    np.testing.assert_allclose(shaded[0] + shaded[1], shaded[2], atol=1e-5)
    np.testing.assert_allclose(4 * shaded[0], TextureMethod(ball, image).draw(EYE, sun), rtol=1e-5)


def test_multiply_adds():
    # one band: y t, three colours; or y t, one tau, three colours of one coefficient
    assert gloss.macs(1, "fixed_light") == 4
    assert gloss.macs(1, "full") == 5
    text = gloss.full(sh.phong_lobe(20, 3))
    body = text[text.index("float p0_0") :]
    assert gloss.macs(3, "full") == body.count("*") + 2 * 9
    assert Material().gloss_macs(5) == 0
    assert PRODUCTS[0].gloss_macs(5) == 625 + 3 * 325


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"exponent": 0.0}, r"material\.exponent: found 0\.0, expected a finite number above 0"),
        ({"exponent": float("nan")}, r"material\.exponent"),
        ({"exponent": float("inf")}, r"material\.exponent"),
        ({"specular": (0.5, 0.5)}, r"material\.specular: found \[0\.5, 0\.5\], expected 3"),
        ({"specular": (0.5, 0.5, -1.0)}, r"material\.specular"),
        ({"diffuse": -0.1}, r"material\.diffuse: found -0\.1"),
        ({"product": "triple"}, r"material\.product: found 'triple', expected one of fixed_light, full"),
    ],
)
def test_what_cannot_be_is_refused_by_name(fields, message):
    with pytest.raises(PrtnetError, match=message):
        Material(**fields)


def test_orders_that_the_product_cannot_have_are_refused(ball):
    with pytest.raises(PrtnetError, match="found 6 bands of radiance, expected at most 5"):
        materials.fixed_light_matrix(np.zeros((9, 3)), 3, 6)
    with pytest.raises(PrtnetError, match=r"transfer\.bands: found 9, expected at most 8"):
        gloss.full(sh.phong_lobe(20, 9))
    with pytest.raises(PrtnetError, match="square number"):
        TextureMethod(ball, np.zeros((4, 4, 5), np.float32), material=PRODUCTS[1])
