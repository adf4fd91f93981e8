"""Implicit surfaces on screen: against the NumPy twin, a sphere in closed form, and the net in torch."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data.implicit.shapes import sphere
from prtnet.export import glsl
from prtnet.render import sphere_tracing
from prtnet.render.camera import Camera
from prtnet.render.deferred import DeferredMethod
from prtnet.render.gbuffer import shade
from prtnet.render.marched import Marched
from prtnet.render.material import DIFFUSE, Material, OfPart
from prtnet.render.method import NetMethod
from tests.nets import random_net, random_texels
from tests.render.surfaces import COLOURS, still_life, surface

SIZE = 48
EYE = Camera((1.4, 1.2, 2.6), (0.0, 0.0, 0.0))
CAMERAS = {
    "around": EYE,
    "inside the cube": Camera((0.2, 0.8, 0.9), (0.0, -0.2, 0.0), fov_y=70.0),
    "far away": Camera((140.0, 120.0, 260.0), (0.0, 0.0, 0.0), fov_y=0.4, near=100.0, far=500.0),
    "along an axis": Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0)),
}
GLOSSY = {"diffuse": 0.5, "specular": (0.5, 0.25, 0.5), "exponent": 12.0}
MATERIALS = {
    "diffuse": DIFFUSE,
    "fixed light": Material(**GLOSSY),
    "full": Material(**GLOSSY, product="full"),
    "parts": Material(**GLOSSY, parts={"part 1": OfPart(exponent=3.0), "part 2": OfPart(diffuse=0.1)}),
}


@pytest.fixture(scope="module")
def marched() -> Marched:
    return Marched(still_life(), SIZE)


def light_of(bands: int) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(sh.count(bands), 3)).astype(np.float32)


def on_outline(covered: np.ndarray) -> np.ndarray:
    """Pixels of a frame that have a neighbour of the other kind."""
    image = np.pad(covered.reshape(SIZE, SIZE), 1, mode="edge")
    around = [image[1 + i : SIZE + 1 + i, 1 + j : SIZE + 1 + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    return (np.any(around, axis=0) & ~np.all(around, axis=0)).ravel()


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=list(CAMERAS))
def test_it_meets_what_its_plain_twin_meets(marched, camera):
    points, hit = sphere_tracing.met(marched.implicit.field, camera, SIZE)
    places, facings = (image.reshape(-1, 4) for image in marched.surface(camera))
    covered = places[:, 3] > 0
    assert 0.2 < covered.mean() <= 1
    assert not (covered ^ hit)[~on_outline(hit)].any()
    both = covered & hit
    # across an edge inside the outline a ray may meet one side or the other
    away = np.linalg.norm(places[both, :3] - points[both], axis=1)
    assert np.mean(away < 1e-4) > 0.995
    assert np.median(away) < 2e-6
    np.testing.assert_allclose(np.linalg.norm(facings[covered, :3], axis=1), 1, atol=1e-5)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=list(CAMERAS))
def test_a_sphere_is_one(camera):
    """The visible point of every pixel and its normal, in closed form."""
    radius = 0.7
    drawing = Marched(surface(sphere(radius)), SIZE)
    eye, rays = np.array(camera.eye), camera.rays(SIZE).reshape(-1, 3)
    along = rays @ eye
    root = along**2 - eye @ eye + radius**2
    found, outline = drawing.gbuffer(camera), on_outline(root > 0)
    covered = np.zeros(SIZE * SIZE, bool)
    covered[found.pixel] = True
    np.testing.assert_array_equal(covered[~outline], (root > 0)[~outline])
    inner = ~outline[found.pixel]
    pixel = found.pixel[inner]
    wanted = eye + (-along - np.sqrt(root.clip(0)))[pixel, None] * rays[pixel]
    np.testing.assert_allclose(found.positions[inner], wanted, atol=2e-5)
    np.testing.assert_allclose(found.normals[inner], wanted / radius, atol=4e-5)


def test_the_gbuffer_lies_on_the_surface(marched):
    found, field = marched.gbuffer(EYE), marched.implicit.field
    assert np.abs(field.distance(found.positions.astype(np.float64))).max() < 3e-7
    np.testing.assert_array_equal(found.part, field.part(found.positions))
    assert set(found.part) == {0, 1, 2}
    np.testing.assert_array_equal(found.albedo, np.array(COLOURS, np.float32)[found.part])
    np.testing.assert_array_equal(found.albedo, marched.albedo(EYE).reshape(-1, 3)[found.pixel])
    assert found.parts == ("part 0", "part 1", "part 2")
    assert found.uv is None


@pytest.mark.parametrize("material", MATERIALS.values(), ids=list(MATERIALS))
def test_the_net_of_the_shader_is_the_deferred_one(marched, material):
    net, light = random_net(width=8, depth=1, bands=3), light_of(3)
    deferred = DeferredMethod(marched, net, material=material).draw(EYE, light)
    shader = NetMethod(marched, glsl.emit(net), material=material).draw(EYE, light)
    scale = np.abs(shader).max()
    np.testing.assert_allclose(deferred, shader, atol=1e-4 * scale)
    assert np.abs(deferred - shader).mean() < 1e-5 * scale


def test_missed_pixels_stay_0_with_and_without_the_depth_test(marched):
    net, light = random_net(width=8, depth=1, bands=2), light_of(2)
    method = NetMethod(marched, glsl.emit(net))
    image = method.draw(EYE, light)
    covered = np.zeros(SIZE * SIZE, bool)
    covered[marched.gbuffer(EYE).pixel] = True
    np.testing.assert_array_equal((image != 0).any(axis=2).ravel(), covered)
    method.render(EYE, prepass=False)
    np.testing.assert_array_equal(marched.target.read()[..., :3], image)
    for nothing in (Camera((0.0, 3.0, 3.0), (0.0, 6.0, 3.0), up=(0.0, 0.0, 1.0)), Camera((0.0, -0.2, 0.0), EYE.eye)):
        method.render(nothing)
        assert not marched.target.read().any()


def test_frames_need_not_be_square(marched):
    """A wide frame shows in its middle what a square one of the same height shows."""
    net, light = random_net(width=8, depth=1, bands=2), light_of(2)
    square = NetMethod(marched, glsl.emit(net)).draw(EYE, light)
    wide = Marched(marched.implicit, 16)
    wide.resize(2 * SIZE, SIZE)
    for method in (NetMethod(wide, glsl.emit(net)), DeferredMethod(wide, net)):
        found = method.draw(EYE, light)
        assert found.shape == (SIZE, 2 * SIZE, 3)
        np.testing.assert_allclose(found[:, SIZE // 2 : -SIZE // 2], square, atol=5e-4 * np.abs(square).max())


def test_steps_follow_the_slope_of_the_distance():
    """Twice the distance with its Lipschitz constant is the same surface; too few steps leave holes."""
    once, field = Marched(still_life(), SIZE), still_life(2.0).field
    places = once.surface(EYE)[0]
    doubled = replace(field, joined=lambda p: 2 * field.whole(p))
    found = Marched(replace(once.implicit, field=doubled), SIZE).surface(EYE)[0]
    inner = ~on_outline(places[..., 3].ravel() > 0).reshape(SIZE, SIZE)
    np.testing.assert_array_equal((found[..., 3] > 0)[inner], (places[..., 3] > 0)[inner])
    hasty = Marched(once.implicit, SIZE, steps=2)
    assert (hasty.surface(EYE)[0][..., 3] > 0).sum() < 0.5 * (places[..., 3] > 0).sum()


def test_what_needs_an_atlas_or_a_file_is_refused(marched):
    net = random_net(width=8, depth=1, bands=2, texels=(random_texels(4, 4),))
    with pytest.raises(PrtnetError, match="expected a net without texels"):
        NetMethod(marched, glsl.emit(net), texels=net.texels)
    with pytest.raises(PrtnetError, match="no triangles to share out, expected fragment"):
        marched.draws(NetMethod(marched, glsl.emit(random_net(bands=2))).program, None, np.ones(3, bool))
    with pytest.raises(PrtnetError, match=r"material\.roughness: found file for an implicit surface"):
        NetMethod(
            marched, glsl.emit(random_net(bands=2)), material=Material(**GLOSSY, roughness="file", product="full")
        )


def test_shading_by_parts_is_the_plain_twin(marched):
    """Radiance of a net that gives the normal, from the G-buffer."""
    function = "void prt_transfer(vec3 position, vec3 normal, out vec4 t0) { t0 = vec4(normal, position.y); }"
    light, found = light_of(2), marched.gbuffer(EYE)
    transfer = np.concatenate([found.normals, found.positions[:, 1:2]], axis=1)
    for material in MATERIALS.values():
        image = NetMethod(marched, function, material=material).draw(EYE, light)
        np.testing.assert_allclose(image, shade(found, transfer, light, material), atol=2e-5)
