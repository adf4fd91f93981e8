"""Reflectance that varies over the scene: per part, by the file's roughness; orders that differ. GLSL against NumPy."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from prtnet import PrtnetError, netspec, sh
from prtnet.data import atlas, roughness
from prtnet.data.scene import Scene
from prtnet.export import gloss, glsl
from prtnet.render import material as materials
from prtnet.render import reflectance
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import shade
from prtnet.render.material import Material, OfPart, Reflectance
from prtnet.render.method import NetMethod, TextureMethod
from prtnet.render.raster import Raster
from tests.nets import random_net
from tests.render.meshes import quad, scene, sphere

SIZE = 96
EYE = Camera((0.4, 0.9, 2.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
PARTS = {"ground": OfPart(exponent=3.0), "sphere": OfPart(diffuse=0.1, specular=(0.2, 0.9, 0.4))}


def unit(count: int, seed: int = 0) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def random_coefficients(rows: int, columns: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(rows, columns)).astype(np.float32)


def stage(**ground) -> Scene:
    """A ball over a ground and a wall: three parts."""
    floor = quad([-1, -0.5, 1], [2, 0, 0], [0, 0, -2], name="ground", **ground)
    return scene(sphere(24, radius=0.45), floor, quad([-1, -0.5, -1], [2, 0, 0], [0, 1, 0], name="wall"))


@pytest.fixture(scope="module")
def plain() -> Raster:
    return Raster(atlas.make(stage(), size=128), SIZE)


@pytest.fixture(scope="module")
def rough() -> Raster:
    """A map and a factor on the ground, roughness of vertices on the ball, nothing on the wall."""
    image = np.random.default_rng(0).uniform(0.3, 1, (8, 8))
    made = stage(roughness_factor=0.8, roughness_map=image)
    part = roughness.part_of_vertices(made)
    own = np.where(part == 0, 0.5 + 0.4 * made.vertices[:, 1], -1).astype(np.float32)
    return Raster(atlas.make(replace(made, roughness=own), size=128), SIZE)


def assert_agree(drawn: np.ndarray, expected: np.ndarray, typical: float = 5e-5) -> None:
    """Everywhere but where a pixel's centre lies a hair outside of its triangle."""
    assert (expected != 0).any(axis=-1).mean() > 0.2
    error = np.abs(drawn - expected)
    assert np.percentile(error, 99) < typical * np.abs(expected).max()
    assert error.max() < 0.05 * np.abs(expected).max()


def drawn_and_expected(drawing: Raster, shiny: Material, bands: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """One transfer in all texels, under a random light: nothing but shading is compared."""
    bands_light, _ = shiny.orders(bands)
    own, sun = random_coefficients(1, bands**2), random_coefficients(bands_light**2, 3, 2)
    method = TextureMethod(drawing, np.broadcast_to(own, (16, 16, bands**2)), material=shiny)
    found = drawing.gbuffer(EYE)
    return method.draw(EYE, sun), shade(found, np.broadcast_to(own, (len(found.pixel), bands**2)), sun, shiny)


@pytest.mark.parametrize("bands", [1, 2, 3, 8])
def test_the_lobes_of_many_exponents_are_those_of_each(bands):
    exponents = np.random.default_rng(0).uniform(0, 200, (3, 4))
    found = sh.phong_lobe(exponents, bands)
    assert found.shape == (3, 4, bands)
    for index in np.ndindex(3, 4):
        np.testing.assert_array_equal(found[index], sh.phong_lobe(exponents[index], bands))
    with pytest.raises(PrtnetError, match=r"Phong exponent: found -1\.0"):
        sh.phong_lobe(np.array([1.0, -1.0]), bands)


def test_white_light_straight_on_gives_each_point_its_own_e_plus_1_by_e_plus_2():
    exponents, normals = np.array([1.0, 3.0, 8.0]), unit(3)
    own = Reflectance(np.zeros(3), np.full((3, 3), 0.5), exponents)
    white = np.zeros((81, 3))
    white[0] = np.sqrt(4 * pi)
    shiny = Material(0.0, (0.5, 0.5, 0.5), parts=PARTS)
    found = materials.radiance(shiny, np.ones((3, 3)), sh.cosine_lobe(normals, 9), white, normals, normals, own)
    closed = 0.5 * (exponents + 1) / (exponents + 2)
    np.testing.assert_allclose(found, np.repeat(closed[:, None], 3, axis=1), atol=2e-3)
    assert np.ptp(closed) > 0.1


@pytest.mark.parametrize("product", materials.PRODUCTS)
@pytest.mark.parametrize(
    "changes",
    [
        {"parts": PARTS},
        {"parts": {"wall": OfPart(diffuse=0.0, specular=(1.0, 0.5, 0.0))}},
        {"specular": (0.0, 0.0, 0.0), "parts": {"ground": OfPart(specular=(0.5, 0.5, 0.5), exponent=0.5)}},
    ],
    ids=["exponents", "weights", "one part glossy"],
)
def test_parts_in_the_texture_shader_agree_with_numpy(plain, product, changes):
    shiny = replace(Material(0.5, (0.5, 0.25, 1.0), 20.0, product), **changes)
    drawn, expected = drawn_and_expected(plain, shiny)
    assert_agree(drawn, expected)
    # what the parts say is seen
    without = drawn_and_expected(plain, replace(shiny, parts={}))[1]
    assert np.abs(expected - without).max() > 0.05 * np.abs(expected).max()


def test_diffuse_parts_need_no_gloss(plain):
    drawn, expected = drawn_and_expected(plain, Material(parts={"wall": OfPart(diffuse=0.25)}))
    assert_agree(drawn, expected)


def test_parts_that_say_the_same_as_the_rest_change_nothing(plain):
    """The shader with exponents per point draws what the one with literals draws."""
    shiny = Material(0.5, (0.5, 0.25, 1.0), 20.0)
    same = replace(shiny, parts={"wall": OfPart(exponent=30.0), "sphere": OfPart(0.5, (0.5, 0.25, 1.0), 20.0)})
    pair = [drawn_and_expected(plain, each)[0] for each in (shiny, same)]
    seen = plain.gbuffer(EYE)
    image_of = np.full(SIZE * SIZE, -1)
    image_of[seen.pixel] = seen.part
    ball = (image_of == 0).reshape(SIZE, SIZE)
    np.testing.assert_allclose(pair[0][ball], pair[1][ball], atol=2e-5 * np.abs(pair[0]).max())
    assert np.abs(pair[0] - pair[1]).max() > 0.01 * np.abs(pair[0]).max()


@pytest.mark.parametrize("product", materials.PRODUCTS)
def test_parts_in_the_net_shader_agree_with_numpy(plain, product):
    net = random_net(width=8, bands=5, position_frequencies=1, normal_frequencies=1, output_scale=0.5)
    shiny, sun = Material(0.5, (0.5, 0.25, 1.0), 20.0, product, PARTS), random_coefficients(25, 3)
    found = plain.gbuffer(EYE)
    transfer = netspec.evaluate_unit(net, found.positions, found.normals)
    assert_agree(NetMethod(plain, glsl.emit(net), material=shiny).draw(EYE, sun), shade(found, transfer, sun, shiny))


def test_exponents_follow_from_roughness():
    np.testing.assert_allclose(roughness.exponent(np.array([0.5, 2 ** (-0.25)])), [30.0, 2.0], rtol=1e-6)
    np.testing.assert_allclose(roughness.exponent(np.array([0.0, 0.1, 0.95, 1.0])), [1e4, 1e4, 1.0, 1.0])


def test_roughness_of_pixels(rough):
    """Factor, vertices and map, by an independent look-up; the wall says nothing."""
    seen = rough.gbuffer(EYE)
    assert seen.roughness is not None
    ball, ground, wall = (seen.part == part for part in range(3))
    np.testing.assert_allclose(seen.roughness[ball], 0.5 + 0.4 * seen.positions[ball, 1], atol=2e-3)
    np.testing.assert_allclose(seen.roughness[wall], roughness.UNKNOWN, rtol=1e-5)
    image = rough.scene.materials[1].roughness_map
    assert image is not None
    low, high = rough.scene.vertices[rough.scene.faces[rough.scene.part == 1]].reshape(-1, 3).min(axis=0), 2.0
    u, v = (seen.positions[ground, 0] - low[0]) / high, (-low[2] - seen.positions[ground, 2]) / high
    padded = np.pad(image, 1, mode="wrap")
    x, y = u * 8 + 0.5, (1 - v) * 8 + 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - column, y - row
    above = (1 - fx) * padded[row, column] + fx * padded[row, column + 1]
    below = (1 - fx) * padded[row + 1, column] + fx * padded[row + 1, column + 1]
    error = np.abs(seen.roughness[ground] - 0.8 * ((1 - fy) * above + fy * below))
    # 8 bits of weights in filters, 16 bits of the map
    assert np.percentile(error, 99) < 5e-3


@pytest.mark.parametrize("product", materials.PRODUCTS)
def test_roughness_in_the_shader_agrees_with_numpy(rough, product):
    shiny = Material(0.5, (0.5, 0.25, 1.0), 20.0, product, roughness="file")
    drawn, expected = drawn_and_expected(rough, shiny)
    assert_agree(drawn, expected, 1e-4)
    without = drawn_and_expected(rough, replace(shiny, roughness="config"))[1]
    assert np.abs(expected - without).max() > 0.05 * np.abs(expected).max()


def test_an_exponent_of_a_part_stands_above_the_file(rough):
    both = Material(0.5, (0.5, 0.5, 0.5), 20.0, parts={"ground": OfPart(exponent=7.0)}, roughness="file")
    seen = rough.gbuffer(EYE)
    own = reflectance.of_points(both, seen.parts, seen.part, seen.roughness)
    assert own is not None
    assert (own.exponent[seen.part == 1] == 7.0).all()
    assert (own.exponent[seen.part == 2] == 20.0).all()
    assert np.ptp(own.exponent[seen.part == 0]) > 1
    assert_agree(*drawn_and_expected(rough, both), 1e-4)


@pytest.mark.parametrize("product", materials.PRODUCTS)
@pytest.mark.parametrize(("bands", "light", "out"), [(5, 3, 4), (3, 5, 7), (4, 4, 7), (5, 6, 2), (1, 4, 4), (4, 1, 3)])
def test_orders_that_differ_in_the_shader_agree_with_numpy(plain, product, bands, light, out):
    shiny = Material(0.5, (0.5, 0.25, 1.0), 20.0, product, PARTS, light_bands=light, radiance_bands=out)
    assert_agree(*drawn_and_expected(plain, shiny, bands))
    assert_agree(*drawn_and_expected(plain, replace(shiny, parts={}), bands))


@pytest.mark.parametrize("light", [2, 5])
def test_the_diffuse_part_uses_the_bands_that_both_have(plain, light):
    transfer, sun = random_coefficients(20, 9), random_coefficients(light**2, 3)
    found = materials.radiance(Material(light_bands=light), np.ones((20, 3)), transfer, sun, unit(20), unit(20))
    both = min(9, light**2)
    np.testing.assert_allclose(found, transfer[:, :both] @ sun[:both] / pi, rtol=1e-5)
    assert_agree(*drawn_and_expected(plain, Material(light_bands=light), 3))


def test_a_net_whose_last_layer_is_not_full_ignores_what_the_light_has_more(plain):
    """25 coefficients fill 6.25 vec4: the light's next ones meet what the function leaves in the rest."""
    function = glsl.emit(random_net(width=8, bands=5, position_frequencies=1, normal_frequencies=1))
    dirty = function.rstrip().removesuffix("}") + "  t6.yzw = vec3(1e3);\n}\n"
    sun = random_coefficients(36, 3)
    pair = [NetMethod(plain, text, material=Material(light_bands=6)).draw(EYE, sun) for text in (function, dirty)]
    np.testing.assert_array_equal(*pair)


@pytest.mark.parametrize("product", materials.PRODUCTS)
def test_multiply_adds_of_other_orders(product):
    """Against the text: every product of it, less those with the lobe's literals."""
    light = random_coefficients(36, 3)  # all bands that the product of 3 and 4 has: no column is zero
    matrix = materials.fixed_light_matrix(light, 3, 4)
    lobe = sh.phong_lobe(20.0, 4)
    text = gloss.full(lobe, 3, 6) if product == "full" else gloss.fixed_light(matrix, lobe)
    body = text[text.index("float p0_0") :] if product == "full" else text[text.index("vec3 sum") :]
    # a colour's product is three multiply-adds
    colours = body.count("sum +=")
    assert gloss.macs(3, product, 6, 4) == body.count("*") + 2 * colours


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: Material(parts={"a": OfPart(exponent=0.0)}), r"material\.parts\.a\.exponent: found 0\.0"),
        (lambda: Material(parts={"a": OfPart(specular=(1.0,))}), r"material\.parts\.a\.specular: found \[1\.0\]"),
        (lambda: Material(parts={"a": OfPart(diffuse=-1.0)}), r"material\.parts\.a\.diffuse: found -1\.0"),
        (lambda: reflectance.of_part("a", {"shine": 2}), r"parts\.a: found shine, expected some of diffuse, specular"),
        (lambda: reflectance.of_part("a", {"exponent": "hard"}), r"parts\.a: found .*hard.*, expected numbers"),
        (lambda: reflectance.of_part("a", {"specular": 0.5}), r"parts\.a: found .*, expected numbers, and three"),
        (lambda: Material(roughness="map"), r"material\.roughness: found 'map', expected one of config, file"),
        (lambda: Material(light_bands=0).orders(5), r"material\.light_bands: found 0, expected at least 1"),
        (
            lambda: Material(light_bands=3, radiance_bands=8).orders(5),
            r"radiance_bands: found 8 bands of radiance, expected at most 7, .* 5 bands of transfer times 3 of light",
        ),
        (lambda: reflectance.check(Material(roughness="file"), stage()), r"found file, but test has no roughness"),
        (
            lambda: reflectance.check(Material(parts={"roof": OfPart()}), stage()),
            r"material\.parts: found roof, expected some of sphere, ground, wall",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name(made, message):
    with pytest.raises(PrtnetError, match=message):
        made()


def test_words_tell_all():
    text = Material(0.5, (0.5, 0.5, 0.5), 20.0, parts=PARTS, roughness="file", light_bands=3).words()
    for expected in ("exponents by the file's roughness", "3 bands of light", "ground: exponent 3", "diffuse 0.1"):
        assert expected in text
