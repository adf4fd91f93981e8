"""The reference without SH: closed forms, convergence, strategies against each other, and SH where it is exact."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import builtin, light, light_sampler, transfer
from prtnet.data.analytic_light import AnalyticOptions
from prtnet.data.light_sampler import ImageSampler
from prtnet.data.samples import area_uniform
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer
from prtnet.render import exact, material
from prtnet.render.exact import World
from tests.render.lit import WHITE, estimate, points
from tests.render.meshes import quad, scene


@pytest.fixture(scope="module")
def floor() -> Scene:
    return scene(quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)))


def on_floor(made, count=1, **more):
    tracer = Tracer(made)
    normals = np.tile([0, 1.0, 0], (count, 1))
    return World(tracer, WHITE, made), points(tracer, np.zeros((count, 3)), normals, **more)


def test_an_open_plane_under_white_light_shows_its_albedo(floor):
    world, given = on_floor(floor, diffuse=np.array([0.2, 0.5, 0.9]))
    np.testing.assert_allclose(estimate(world, given), [[0.2, 0.5, 0.9]], rtol=2e-3)


@pytest.mark.parametrize("exponent", [0.5, 4.0, 50.0, 2000.0])
def test_gloss_under_white_light_at_the_normal(floor, exponent):
    world, given = on_floor(floor, diffuse=0.0, specular=np.array([0.2, 1.0, 0.0]), exponent=exponent)
    level = (exponent + 1) / (exponent + 2)
    np.testing.assert_allclose(estimate(world, given), [[0.2 * level, level, 0]], rtol=5e-3)


def test_a_wall_hides_half_of_the_sky():
    made = scene(quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), quad((-1, 0, 0), (2, 0, 0), (0, 2, 0)))
    tracer = Tracer(made)
    given = points(tracer, [[0, 0, 1e-3]], [[0, 1, 0]])
    np.testing.assert_allclose(estimate(World(tracer, WHITE), given), 0.5, rtol=4e-3)


@pytest.mark.parametrize(("name", "radius"), [("sun", 0.267), ("sun", 10.0), ("directional", 1.0)])
@pytest.mark.parametrize("height", [1.0, 0.3, -0.5])
def test_suns_light_a_plane_by_the_cosine(floor, name, radius, height):
    """A disc above the horizon gives exactly irradiance times the cosine of its centre; one below gives nothing."""
    options = AnalyticOptions()
    options.sun.radius = radius
    options.sun.direction = options.directional.direction = [np.sqrt(1 - height**2), height, 0.0]
    world, given = on_floor(floor, diffuse=0.6)
    world = replace(world, sampler=light_sampler.of_light(light.by_name(name, options)))
    expected = np.array([3.6, 3.1, 2.4]) * max(height, 0) * 0.6 / pi
    np.testing.assert_allclose(estimate(world, given)[0], expected, rtol=3e-3)


def test_the_shadow_of_a_single_direction_is_hard():
    made = scene(quad((-1, 0, 1), (2, 0, 0), (0, 0, -2)), quad((-0.5, 1, 0.5), (0, 0, -1), (1, 0, 0)))
    options = AnalyticOptions()
    options.directional.direction = [0.0, 1.0, 0.0]
    tracer = Tracer(made)
    given = points(tracer, [[0.49, 0, 0], [0.51, 0, 0]], [[0, 1.0, 0]] * 2)
    world = World(tracer, light_sampler.of_light(light.by_name("directional", options)))
    found = estimate(world, given, samples=1)
    np.testing.assert_allclose(found, [[0, 0, 0], [3.6 / pi, 3.1 / pi, 2.4 / pi]], rtol=1e-12)


SPOTTED = np.full((32, 64, 3), 0.05, np.float32)
SPOTTED[6, 40:43] = 60


def glossy_points(made, count=40):
    """Points of a room with both parts of a material, some in shadow, reflections all ways."""
    rng = np.random.default_rng(5)
    drawn, tracer = area_uniform(made, count, rng), Tracer(made)
    towards = drawn.normals + 0.7 * rng.normal(size=(count, 3))
    given = points(
        tracer,
        drawn.positions,
        drawn.normals,
        diffuse=0.5,
        specular=0.5,
        exponent=30.0,
        mirrored=material.mirrored(towards, drawn.normals),
        sides=drawn.geometric_normals,
    )
    return World(tracer, ImageSampler(SPOTTED), made), given


@pytest.fixture(scope="module")
def room() -> Scene:
    return builtin.make("cornell", tessellation=0.25).centred()


def test_strategies_agree_and_together_they_are_best(room):
    """Each strategy alone converges to the same; under a small bright light the balance is far ahead of both that
    scatter, and near its lobe ahead of the light's."""
    world, given = glossy_points(room)
    wanted = estimate(world, given, samples=1 << 16)
    errors = {}
    for name, used in (("mixed", exact.STRATEGIES), *((name, (name,)) for name in exact.STRATEGIES)):
        found = np.stack([estimate(world, given, 256, seed, strategies=used) for seed in range(24)])
        spread = found.std(axis=0) / np.sqrt(24)
        if name != "lobe":  # which never looks where the diffuse part does
            assert np.all(np.abs(found.mean(axis=0) - wanted) < 5 * spread + 0.02 * wanted.max()), name
        errors[name] = np.sqrt(np.mean((found - wanted) ** 2))
    assert errors["mixed"] < 1.3 * errors["light"]
    assert errors["mixed"] < 0.3 * errors["cosine"]


def test_the_lobe_is_better_than_the_light_where_gloss_is_sharp(floor):
    world, given = on_floor(floor, 30, diffuse=0.0, specular=1.0, exponent=5000.0)
    found = {
        name: np.std([estimate(world, given, 64, seed, strategies=used) for seed in range(8)])
        for name, used in (("mixed", exact.STRATEGIES), ("light", ("light",)))
    }
    assert found["mixed"] < 0.1 * found["light"]


def test_the_error_falls_with_the_root_of_the_samples(room):
    """Slope in log-log: -1/2 of independent samples, or better."""
    world, given = glossy_points(room)
    wanted = estimate(world, given, samples=1 << 17, seed=99)
    counts = [16, 64, 256, 1024, 4096]
    errors = [np.sqrt(np.mean([(estimate(world, given, n, s) - wanted) ** 2 for s in range(6)])) for n in counts]
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert -1.1 < slope < -0.45


def three_bands():
    """SH coefficients "9 3" that are nowhere negative, and their image: SH cut nothing of this light."""
    coefficients = np.zeros((9, 3))
    coefficients[0] = 3
    coefficients[1:] = np.random.default_rng(2).uniform(-0.6, 0.6, (8, 3))
    image = sh.evaluate(light.directions(256, 512), 3) @ coefficients
    assert image.min() > 0
    return coefficients.astype(np.float32), image.astype(np.float32)


def test_sh_is_exact_where_the_light_is_made_of_it(room):
    """Diffuse light of three bands from five bands of transfer: nothing is cut, so the two references agree."""
    coefficients, image = three_bands()
    tracer, drawn = Tracer(room), area_uniform(room, 300, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    baked = transfer.bake(
        tracer,
        drawn.positions,
        drawn.normals,
        bands=5,
        directions=4096,
        rng=rng,
        geometric_normals=drawn.geometric_normals,
    )
    wanted = baked[:, :9] @ coefficients / pi
    given = points(tracer, drawn.positions, drawn.normals, sides=drawn.geometric_normals)
    found = estimate(World(tracer, ImageSampler(image)), given, samples=4096)
    error = np.sqrt(np.mean((found - wanted) ** 2))
    assert error < 0.004 * wanted.max()
    assert abs(np.mean(found - wanted)) < 0.0005 * wanted.max()


def turned(made: Scene, rotation) -> Scene:
    return replace(made, vertices=made.vertices @ rotation.T, normals=(made.normals @ rotation.T).astype(np.float32))


def test_light_turned_is_scene_turned(room):
    found = Light("sky", light.sky(height=64))
    rotation = light.about_y(90.0)
    drawn = area_uniform(room, 100, np.random.default_rng(0))
    images = []
    for made, sampler, turn in (
        (room, light_sampler.of_light(light.adjust(found, rotation=90.0)), np.eye(3)),
        (turned(room, rotation.T), light_sampler.of_light(found), rotation.T),
    ):
        tracer = Tracer(made)
        normals, sides = (np.asarray(each, np.float64) @ turn.T for each in (drawn.normals, drawn.geometric_normals))
        given = points(tracer, drawn.positions @ turn.T, normals, sides=sides)
        images.append(estimate(World(tracer, sampler), given, samples=4096))
    assert np.sqrt(np.mean((images[0] - images[1]) ** 2)) < 0.01 * images[0].max()
    other = light_sampler.of_light(light.adjust(found, rotation=-90.0))
    tracer = Tracer(room)
    given = points(tracer, drawn.positions, drawn.normals, sides=drawn.geometric_normals)
    wrong = estimate(World(tracer, other), given, samples=4096)
    assert np.sqrt(np.mean((images[0] - wrong) ** 2)) > 0.05 * images[0].max()


def Light(name, image):
    return light.Light(name, lambda bands: light.project(image, bands), image)


def test_threads_do_not_change_the_bits(room):
    world, given = glossy_points(room)
    one, two = (estimate(world, given, samples=4096, threads=count, bounces=1) for count in (1, 2))
    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize(("samples", "bounces"), [(0, 0), (4, -1)])
def test_bad_counts_are_refused(floor, samples, bounces):
    world, given = on_floor(floor)
    with pytest.raises(PrtnetError, match="expected at least 1 sample and 0 or more bounces"):
        estimate(world, given, samples=samples, bounces=bounces)
