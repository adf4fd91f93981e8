"""Bounces of the reference without SH: against quadrature between two plates, and the white furnace."""

from dataclasses import replace
from itertools import pairwise
from math import pi

import numpy as np
import pytest
import trimesh

from prtnet import PrtnetError
from prtnet.data import light, light_sampler
from prtnet.data.analytic_light import AnalyticOptions
from prtnet.data.part import Part
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer
from prtnet.render.exact import World
from tests.render.lit import WHITE, estimate, points
from tests.render.meshes import quad, scene


def plates(albedo, **more) -> Scene:
    """Two squares of side 2 that face each other at a distance of 1."""
    lower = quad((-1, -0.5, 1), (2, 0, 0), (0, 0, -2), name="lower", **more)
    upper = quad((-1, 0.5, -1), (2, 0, 0), (0, 0, 2), name="upper", **more)
    return scene(*(replace(part, albedo=np.full(3, albedo)) for part in (lower, upper)))


def to_the_other(place):
    """Nodes of a quadrature over the other plate, and what each takes of the sky: cos cos / (pi r^2)."""
    nodes, weights = np.polynomial.legendre.leggauss(48)
    x, z = np.meshgrid(nodes, nodes, indexing="ij")
    square = 1 + (x - place[0]) ** 2 + (z - place[1]) ** 2
    return np.outer(weights, weights) / (pi * square**2), np.stack([x, z], -1)


def test_one_bounce_between_plates():
    """Against the integral over the other plate of what it receives."""
    made, place = plates(0.7), (0.3, -0.2)
    tracer = Tracer(made)
    share, where = to_the_other(place)
    hidden = np.array([[to_the_other(each)[0].sum() for each in row] for row in where])
    given = points(tracer, [[place[0], -0.5, place[1]]], [[0, 1, 0]], diffuse=0.4)
    world = World(tracer, WHITE, made)
    direct = 1 - share.sum()
    np.testing.assert_allclose(estimate(world, given, 1 << 17), 0.4 * direct, rtol=5e-3)
    once = 0.7 * np.sum(share * (1 - hidden))
    np.testing.assert_allclose(estimate(world, given, 1 << 17, bounces=1), 0.4 * (direct + once), rtol=5e-3)


def test_one_bounce_under_a_single_direction():
    """The sun reaches the lower plate under the edge of the upper one, and lights it from below."""
    made, options = plates(1.0), AnalyticOptions()
    options.directional.direction = [1.0, 1.0, 0.0]
    options.directional.irradiance = [1.0, 2.0, 3.0]
    tracer = Tracer(made)
    world = World(tracer, light_sampler.of_light(light.by_name("directional", options)), made)
    given = points(tracer, [[0.3, 0.5, 0.1]], [[0, -1, 0]])
    # lit from x = 0 on, by the cosine of 45 degrees; radiance is irradiance / pi
    nodes, weights = np.polynomial.legendre.leggauss(48)
    x, z = np.meshgrid((nodes + 1) / 2, nodes, indexing="ij")
    square = 1 + (x - 0.3) ** 2 + (z - 0.1) ** 2
    expected = np.sum(np.outer(weights / 2, weights) / (pi * square**2)) * np.sqrt(0.5) / pi
    assert not estimate(world, given).any()
    np.testing.assert_allclose(estimate(world, given, 1 << 17, bounces=1)[0], expected * np.array([1, 2, 3]), rtol=5e-3)


@pytest.mark.parametrize("two_sided", [False, True])
def test_backs_reflect_where_faces_have_two_sides(two_sided):
    made = plates(0.9, two_sided=two_sided)
    upper = np.arange(len(made.vertices)) >= 4
    turned_over = replace(
        made,
        faces=np.concatenate([made.faces[:2], made.faces[2:, ::-1]]),
        normals=np.where(upper[:, None], -made.normals, made.normals),
    )
    tracer, normal = Tracer(turned_over), [[0, 1.0, 0]]
    given = points(tracer, [[0, -0.5, 0]], normal)
    world = World(tracer, WHITE, turned_over)
    direct, once = estimate(world, given)[0, 0], estimate(world, given, bounces=1)[0, 0]
    expected = estimate(World(Tracer(made), WHITE, made), given, bounces=1)[0, 0] if two_sided else direct
    assert once == pytest.approx(expected, rel=5e-3)
    assert not two_sided or once > 1.1 * direct


def test_white_furnace():
    """White plates under a white sky: radiance rises with every bounce, and never above that of the sky."""
    made = plates(1.0)
    tracer = Tracer(made)
    spots = np.random.default_rng(0).uniform(-0.9, 0.9, (20, 2))
    given = points(
        tracer, np.stack([spots[:, 0], -0.5 + 0 * spots[:, 0], spots[:, 1]], -1), np.tile([0, 1.0, 0], (20, 1))
    )
    levels = [estimate(World(tracer, WHITE, made), given, 1 << 14, bounces=n).mean(axis=1) for n in (0, 1, 2, 4, 8, 16)]
    noise = 0.01
    for before, after in pairwise(levels):
        assert (after > before - noise).all()
        assert after.mean() > before.mean()
    assert levels[-1].max() < 1 + noise
    assert levels[-1].min() > 0.97


def test_no_light_bounces_into_a_closed_box():
    mesh = trimesh.creation.box((2, 2, 2))
    inwards = Part("box", np.asarray(mesh.vertices), np.asarray(mesh.faces)[:, ::-1], two_sided=False)
    made = scene(inwards)
    tracer = Tracer(made)
    given = points(tracer, [[0.1, -1, 0.2]], [[0, 1, 0]])
    assert not estimate(World(tracer, WHITE, made), given, bounces=3).any()


def test_bounces_need_a_scene():
    made = plates(1.0)
    tracer = Tracer(made)
    with pytest.raises(PrtnetError, match="1 bounces and no scene"):
        estimate(World(tracer, WHITE), points(tracer, [[0, -0.5, 0]], [[0, 1, 0]]), bounces=1)
