"""G-buffer, texture and net methods against NumPy, depth pre-pass, albedo, and the axes on screen."""

from math import pi

import numpy as np
import pytest

from prtnet import PrtnetError, gl, netspec, sh
from prtnet.data import atlas, builtin, light, quantise, texture
from prtnet.data.tracer import Tracer
from prtnet.data.transfer import bake
from prtnet.export import glsl
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import from_faces, shade
from prtnet.render.material import Material
from prtnet.render.method import NetMethod, TextureMethod
from prtnet.render.raster import Raster
from tests.nets import random_grid, random_hash, random_net, random_texels
from tests.render.meshes import atlas_uv, bilinear, quad, scene, sphere

SIZE = 96
EYE = Camera((0.4, 0.9, 2.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
FRONT = Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)

# linear in position and normal, so that NumPy can say it in one line
FUNCTION = """
void prt_transfer(vec3 position, vec3 normal, out vec4 t0, out vec4 t1, out vec4 t2) {
  t0 = vec4(position, 1.0);
  t1 = vec4(normal, position.x * normal.y);
  t2 = vec4(0.25, 0.0, 0.0, 0.0);
}
"""


def transfer_of_function(gbuffer):
    p, n = gbuffer.positions, gbuffer.normals
    one = np.ones((len(p), 1), np.float32)
    return np.concatenate([p, one, n, p[:, :1] * n[:, 1:2], 0.25 * one], axis=1)


@pytest.fixture(scope="module")
def plants() -> Raster:
    return Raster(atlas.make(builtin.make("plants", tessellation=0.4).centred(), size=256), SIZE)


def ball(rows: int = 48, **more) -> Raster:
    return Raster(atlas.make(scene(sphere(rows)), size=256), more.get("size", SIZE))


def random_light(count: int) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(count, 3)).astype(np.float32)


def test_gbuffer_positions_project_to_their_pixels(plants):
    found = plants.gbuffer(EYE)
    assert len(found.pixel) > 0.2 * SIZE * SIZE
    clip = np.concatenate([found.positions, np.ones((len(found.pixel), 1))], axis=1) @ EYE.matrix().T
    row, column = np.divmod(found.pixel, SIZE)
    # vertices snap to 1/256 pixel: a centre may lie outside of the face that covers it, and is put on its edge
    off_x = (clip[:, 0] / clip[:, 3] + 1) / 2 * SIZE - column - 0.5
    off_y = (1 - clip[:, 1] / clip[:, 3]) / 2 * SIZE - row - 0.5
    assert np.percentile(np.hypot(off_x, off_y), 99) < 1e-3
    assert np.hypot(off_x, off_y).max() < 0.5


def test_gbuffer_positions_lie_on_their_faces_and_normals_are_unit(plants):
    found, drawn = plants.gbuffer(EYE), plants.scene
    corner = drawn.vertices[drawn.faces[found.face, 0]]
    away = np.einsum("ni,ni->n", found.positions - corner, drawn.face_normals[found.face])
    assert np.abs(away).max() < 1e-6
    for normals in (found.normals, found.geometric_normals):
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    to_eye = np.array(EYE.eye) - found.positions
    # culling: only fronts are seen
    assert (np.einsum("ni,ni->n", found.geometric_normals, to_eye) > -1e-6).all()


def test_gbuffer_shows_the_nearest_surface():
    """A sphere's visible point, in closed form."""
    found, rays = ball(160).gbuffer(EYE), EYE.rays(SIZE).reshape(-1, 3)
    eye, ray = np.array(EYE.eye), rays[found.pixel]
    along = ray @ eye
    under = along**2 - (eye @ eye - 1)
    clear = under > 0.02
    exact = eye + (-along - np.sqrt(np.maximum(under, 0)))[:, None] * ray
    assert np.abs(found.positions - exact)[clear].max() < 5e-3
    hit = np.zeros(SIZE * SIZE, bool)
    hit[found.pixel] = True
    missing = (rays @ eye) ** 2 - (eye @ eye - 1)
    assert hit[(missing > 0.01) & (rays @ eye < 0)].all()
    assert not hit[missing < 0].any()


@pytest.mark.parametrize("texels", list(quantise.FORMATS))
def test_texture_method_is_a_bilinear_look_up(plants, texels):
    """The texture filled with noise: GLSL and NumPy read the same texels with the same weights."""
    image = np.random.default_rng(0).normal(size=(64, 64, 9)).astype(np.float32)
    (image,) = quantise.decode(quantise.encode([image], np.ones((64, 64), bool), texels))
    found, sun = plants.gbuffer(EYE), random_light(9)
    uv = atlas_uv(plants.atlas, found.face, found.positions.astype(np.float64))
    expected = shade(found, bilinear(image, uv).astype(np.float32), sun)
    drawn = TextureMethod(plants, image, texels=texels).draw(EYE, sun)
    # filters have 8 bits of fraction, float16 texels are filtered in float32
    error = np.abs(drawn - expected).max(axis=-1)
    assert np.percentile(error, 99) < 0.03
    assert np.median(error[expected.any(axis=-1)]) < 0.01


def test_baked_smooth_transfer_agrees_within_the_texels_size():
    """Transfer that is a smooth function of the point, baked and drawn: the difference falls with the texel's size."""
    errors, drawing, sun = [], ball(64), random_light(25)
    found = drawing.gbuffer(EYE)
    expected = shade(found, sh.cosine_lobe(found.normals, 5), sun)
    for size in (64, 256):
        made = atlas.make(scene(sphere(64)), size=size)
        texels = texture.gbuffer(made, size)
        image = texture.assemble(texels, sh.cosine_lobe(texels.normals, 5))
        errors.append(np.abs(TextureMethod(drawing, image).draw(EYE, sun) - expected).max())
    assert errors[0] < 0.1
    assert errors[1] < errors[0] / 3


def test_net_method_agrees_with_numpy(plants):
    found, sun = plants.gbuffer(EYE), random_light(9)
    drawn = NetMethod(plants, FUNCTION).draw(EYE, sun)
    error = np.abs(drawn - shade(found, transfer_of_function(found), sun))
    assert np.percentile(error, 99.9) < 2e-5
    # the graphics extrapolate where a face's snapped edge covers a centre that lies outside of it
    assert error.max() < 0.03


@pytest.mark.parametrize("method", ["texture", "net"])
def test_prepass_changes_no_pixel(plants, method):
    image = np.random.default_rng(0).normal(size=(64, 64, 9)).astype(np.float32)
    made = TextureMethod(plants, image) if method == "texture" else NetMethod(plants, FUNCTION)
    drawn = made.draw(EYE, random_light(9))
    made.render(EYE, prepass=False)
    assert drawn.any()
    np.testing.assert_array_equal(plants.target.read()[..., :3], drawn)


def test_hidden_fragments_are_not_shaded():
    """Eight sheets behind each other, drawn from back to front."""
    sheets = [quad([-1, -1, z], [2, 0, 0], [0, 2, 0], name=f"{z}") for z in np.linspace(-1, 0.5, 8)]
    drawing = Raster(atlas.make(scene(*sheets), size=64), 64)
    method = NetMethod(drawing, FUNCTION)
    method.set_light(random_light(9))
    counts = []
    for prepass in (True, False):
        query = gl.context().query(samples=True)
        with query:
            method.render(FRONT, prepass=prepass)
        counts.append(query.samples)
    covered = len(drawing.gbuffer(FRONT).pixel)
    # both passes of the pre-pass count: the sheets in depth, then one layer in colour
    assert counts[0] == counts[1] + covered
    with gl.context().query(samples=True) as query:
        method.render(FRONT, prepass=False)
    assert query.samples > 4 * covered


def test_albedo_is_factor_times_texture():
    board = np.zeros((2, 2, 3), np.float32)
    board[0, 0], board[0, 1], board[1, 0], board[1, 1] = (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)
    textured = quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], albedo=np.array([0.5, 0.25, 0.125]), texture=board)
    plain = quad([-0.1, -0.1, 0.5], [0.2, 0, 0], [0, 0.2, 0], name="plain", albedo=np.array([0.1, 0.2, 0.3]))
    image = Raster(atlas.make(scene(plain, textured), size=64), 64).albedo(FRONT)
    np.testing.assert_allclose(image[32, 32], [0.1, 0.2, 0.3], atol=1e-6)
    # row 0 of the picture is the top of the quad; magnified four texels, read in the middle of each
    np.testing.assert_allclose(image[19, 19], [0.5, 0, 0], atol=0.1)
    np.testing.assert_allclose(image[19, 44], [0, 0.25, 0], atol=0.1)
    np.testing.assert_allclose(image[44, 19], [0, 0, 0.125], atol=0.1)
    np.testing.assert_allclose(image[44, 44], [0.5, 0.25, 0.125], atol=0.1)
    assert not image[0, 0].any()


def axes_light() -> np.ndarray:
    """A lat-long image: red from +x, green from +y, blue from +z, in narrow lobes."""
    towards = light.directions(64, 128)
    return np.maximum(towards, 0).astype(np.float32) ** 8


def test_coloured_axes_on_a_lit_sphere():
    """Image, projection, transfer, texture, screen: a sphere seen from +z is red on its right, green on top."""
    made = atlas.make(scene(sphere(48)), size=256)
    texels = texture.gbuffer(made, 256)
    image = texture.assemble(texels, sh.cosine_lobe(texels.normals, 5))
    drawing = Raster(made, SIZE)
    drawn = TextureMethod(drawing, image).draw(FRONT, light.project(axes_light(), 5))
    # the silhouette is 41 pixels from the middle
    middle, offset = SIZE // 2, 39
    assert np.argmax(drawn[middle, middle + offset]) == 0
    assert np.argmax(drawn[middle - offset, middle]) == 1
    assert np.argmax(drawn[middle, middle]) == 2
    # far from each axis its colour is dark
    assert drawn[middle, middle - offset, 0] < 0.1 * drawn[middle, middle + offset, 0]
    assert drawn[middle + offset, middle, 1] < 0.1 * drawn[middle - offset, middle, 1]
    found = drawing.gbuffer(FRONT)
    expected = shade(found, sh.cosine_lobe(found.normals, 5), light.project(axes_light(), 5))
    assert np.abs(drawn - expected).max() < 0.02 * expected.max()


def test_constant_transfer_under_constant_light():
    """t_0 of an unoccluded point under unit radiance gives the albedo, up to the flat bands."""
    drawing = ball()
    image = np.zeros((32, 32, 1), np.float32) + sh.cosine_lobe(np.array([[0.0, 0.0, 1.0]]), 1)[0]
    white = np.full((1, 3), np.sqrt(4 * pi), np.float32)
    drawn = TextureMethod(drawing, image).draw(FRONT, white)
    found = drawing.gbuffer(FRONT)
    np.testing.assert_allclose(drawn.reshape(-1, 3)[found.pixel], found.albedo, rtol=1e-5)
    empty = np.ones(SIZE * SIZE, bool)
    empty[found.pixel] = False
    assert not drawn.reshape(-1, 3)[empty].any()


def test_milliseconds_and_sizes():
    drawing = ball(12, size=32)
    method = TextureMethod(drawing, np.ones((16, 16, 25), np.float32), texels="float16")
    assert method.milliseconds(FRONT, random_light(25), repeats=2) > 0
    assert method.bytes == 7 * 4 * 2 * 16 * 16


def test_errors():
    drawing = ball(12, size=32)
    with pytest.raises(PrtnetError, match="found 9 SH coefficients, expected 25"):
        TextureMethod(drawing, np.ones((16, 16, 25), np.float32)).draw(FRONT, random_light(9))
    with pytest.raises(PrtnetError, match="prt_transfer"):
        NetMethod(drawing, "float f() { return 1.0; }")
    with pytest.raises(PrtnetError, match="GLSL"):
        NetMethod(drawing, "void prt_transfer(vec3 p, vec3 n, out vec4 t0) { t0 = wrong; }")


def coloured(rng, *shape, bands=3):
    """Four groups of coefficients, direct and red, green, blue."""
    return rng.normal(size=(*shape, 4 * bands**2)).astype(np.float32)


@pytest.mark.parametrize("specular", [0.0, 0.5])
def test_four_groups_in_a_texture_and_in_a_net_agree_with_numpy(specular):
    material = Material(0.8, (specular,) * 3, 12.0)
    raster, texels, light = ball(), coloured(np.random.default_rng(0), 64, 64), random_light(9)
    method = TextureMethod(raster, texels, material=material, groups=4)
    assert method.bytes == 64 * 64 * 16 * 3 * (3 if specular == 0 else 4)
    found = raster.gbuffer(EYE)
    transfer = bilinear(texels, atlas_uv(raster.atlas, found.face, found.positions.astype(np.float64)))
    expected = shade(found, transfer, light, material, groups=4)
    error = np.abs(method.draw(EYE, light) - expected)
    # llvmpipe blends texels with weights of 8 bits
    assert np.percentile(error, 99) < 0.01 * np.abs(expected).max()

    net = random_net(bands=3, groups=4, output="linear", residual=True)
    drawn = NetMethod(raster, glsl.emit(net), material=material, groups=4).draw(EYE, light)
    transfer = netspec.evaluate_unit(net, found.positions, found.normals)
    expected = shade(found, transfer, light, material, groups=4)
    assert np.percentile(np.abs(drawn - expected), 99.5) < 1e-4 * np.abs(expected).max()


def test_a_net_with_grids_is_drawn_as_numpy_evaluates_it():
    raster, light = ball(), random_light(9)
    net = random_net(
        bands=3,
        output="linear",
        residual=True,
        grids=(random_grid(6, 5, 4), random_grid(2, 3, 2, 4)),
        hashes=(random_hash(20),),
    )
    drawn = NetMethod(raster, glsl.emit(net), grids=net.grids, hashes=net.hashes).draw(EYE, light)
    found = raster.gbuffer(EYE)
    expected = shade(found, netspec.evaluate_unit(net, found.positions, found.normals), light)
    assert np.percentile(np.abs(drawn - expected), 99.5) < 1e-4 * np.abs(expected).max()
    unbound = NetMethod(raster, glsl.emit(net), grids=net.grids[::-1], hashes=net.hashes).draw(EYE, light)
    assert np.percentile(np.abs(unbound - expected), 99.5) > 0.1 * np.abs(expected).max()


def test_a_net_with_texels_is_drawn_as_numpy_evaluates_it():
    raster, light = ball(), random_light(9)
    net = random_net(bands=3, output="linear", grids=(random_grid(2, 3, 2, 4),), texels=(random_texels(12, 9, 8),))
    features = {"grids": net.grids, "hashes": net.hashes}
    drawn = NetMethod(raster, glsl.emit(net), **features, texels=net.texels).draw(EYE, light)
    found = raster.gbuffer(EYE)
    assert found.uv is not None
    own = atlas_uv(raster.atlas, found.face, found.positions.astype(np.float64))
    np.testing.assert_allclose(found.uv, own, rtol=0, atol=1e-4)
    expected = shade(found, netspec.evaluate_unit(net, found.positions, found.normals, uv=found.uv), light)
    assert np.percentile(np.abs(drawn - expected), 99.5) < 1e-3 * np.abs(expected).max()
    turned = NetMethod(raster, glsl.emit(net), **features, texels=(net.texels[0][::-1],)).draw(EYE, light)
    assert np.percentile(np.abs(turned - expected), 99.5) > 0.1 * np.abs(expected).max()


def test_groups_that_agree_are_one():
    """Without bounces the coloured groups equal the direct one, and so do the pictures."""
    raster, rng, light = ball(), np.random.default_rng(0), random_light(9)
    direct = rng.normal(size=(64, 64, 9)).astype(np.float32)
    once = TextureMethod(raster, direct).draw(EYE, light)
    four = TextureMethod(raster, np.tile(direct, 4), groups=4).draw(EYE, light)
    np.testing.assert_allclose(four, once, atol=1e-5)


def test_a_pixel_in_the_corner_of_two_faces_is_not_black():
    """Rays from a point exactly in the plane of a wall would all end there."""
    floor, wall = quad([-1, 0, 1], [2, 0, 0], [0, 0, -2]), quad([-1, 0, 1], [0, 0, -2], [0, 1, 0])
    made = scene(floor, wall)
    # (face + 1, b1, b2, 1): on the floor's edge at the wall, and a hair before it
    corner, near = (0.0, 0.5), (0.0005, 0.5)
    faces = np.array([[[2.0, *corner, 1.0], [2.0, *near, 1.0]], [[0.0] * 4] * 2], np.float32)
    found = from_faces(made, faces, np.ones((2, 2, 3), np.float32), (0.0, 0.0, 3.0))
    transfer = bake(
        Tracer(made), found.positions.astype(np.float64), found.normals, bands=2, directions=256,
        rng=np.random.default_rng(0), geometric_normals=found.geometric_normals,
    )  # fmt: skip
    np.testing.assert_allclose(transfer[0], transfer[1], atol=0.02)
    assert transfer[0, 0] > 0.3
