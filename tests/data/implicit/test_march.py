"""Sphere-traced visibility: against plain NumPy, a linear search, closed forms and the mesh."""

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import samples, transfer
from prtnet.data.implicit import accuracy, compiled, kernels, mesh, project
from prtnet.data.implicit.field import Analytic
from prtnet.data.implicit.march import EPSILON, MarchTracer, evaluated, walked
from prtnet.data.implicit.mesh_tracer import MeshTracer
from prtnet.data.implicit.operators import difference, moved, turned, union
from prtnet.data.implicit.shapes import box, capsule, sphere, torus
from prtnet.data.implicit.surface import Described
from prtnet.data.scene import Frame, Material

PLATE = moved(box(1, 0.05, 1), 0, -0.05, 0)
BALL = moved(sphere(0.3), 0.1, 0.45, 0)


@pytest.fixture(scope="module")
def ball():
    """A ball that hovers above a plate whose top is y = 0."""
    field = Analytic((PLATE, BALL))
    return field, MarchTracer(field)


@pytest.fixture(scope="module")
def thin():
    """Wires, a sheet and a shell, 0.004 to 0.01 thick, and shapes that flow together."""
    shell = difference(
        moved(sphere(0.3), -0.5, 0.5, 0), moved(sphere(0.294), -0.5, 0.5, 0), moved(sphere(0.2), -0.3, 0.7, 0)
    )
    wires = union(torus(0.8, 0.004), capsule((-0.9, -0.9, -0.9), (0.9, 0.9, 0.9), 0.002))
    sheet = turned(moved(box(0.4, 0.002, 0.6), 0, -0.4, 0), "z", 20)
    knot = union(moved(sphere(0.2), 0.5, 0.2, 0), moved(torus(0.3, 0.05), 0.5, 0.3, 0.1), smooth=0.1)
    field = Analytic((union(shell, wires), union(sheet, knot)))
    return field, MarchTracer(field)


def some_rays(count, seed, field):
    """From outside of the surface, every other one aimed at a point on it."""
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-1, 1, (count, 3))
    origins = origins[field.distance(origins) > 0.01]
    targets = project.onto(field, rng.uniform(-0.8, 0.8, origins.shape), furthest=0.1)
    towards = np.where(np.arange(len(origins))[:, None] % 2, rng.normal(size=origins.shape), targets - origins)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return origins.astype(np.float32), towards.astype(np.float32)


def least_along(field, origins, towards, steps=1500):
    """The least distance at many points of each ray."""
    at = np.linspace(0, 3.5, steps)
    points = origins[:, None].astype(np.float64) + at[:, None] * towards[:, None]
    inside = np.abs(points).max(axis=2) <= 1
    found = field.distance(points.reshape(-1, 3)).reshape(inside.shape)
    return np.where(inside, found, np.inf).min(axis=1)


def bake(tracer, positions, normals, **options):
    return transfer.bake(tracer, positions, normals, rng=np.random.default_rng(0), **options)


def on_ball(count, centre, radius):
    normals = np.random.default_rng(2).normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return centre + radius * normals, normals


@pytest.mark.parametrize("name", ["ball", "thin"])
def test_the_compiled_walk_ends_where_the_plain_one_does(name, request):
    field, tracer = request.getfixturevalue(name)
    origins, towards = some_rays(3000, 1, field)
    part, normal, length = tracer.hits(origins, towards)
    plain = walked(field, origins.astype(np.float64), towards.astype(np.float64), steps=4096)
    np.testing.assert_array_equal(tracer.trace(origins, towards), np.isfinite(length))
    # rays that graze within float32's rounding may end either way
    assert np.mean(np.isfinite(plain) != np.isfinite(length)) < 2e-3
    both = np.isfinite(plain) & np.isfinite(length)
    assert 0.1 < both.mean() < 0.9
    assert np.quantile(np.abs(length[both] - plain[both]), 0.98) < 20 * EPSILON
    assert ((part >= 0) == np.isfinite(length)).all()
    points = origins[both] + length[both, None].astype(np.float64) * towards[both]
    np.testing.assert_array_equal(part[both], field.part(points))
    np.testing.assert_allclose(np.linalg.norm(normal[both], axis=1), 1, atol=1e-5)
    assert tracer.rays_lost == 0


def test_thin_features_are_not_stepped_over(thin):
    """Every ray that a dense linear search finds inside is a hit, and every hit comes near the surface."""
    field, tracer = thin
    origins, towards = some_rays(1200, 3, field)
    least, found = least_along(field, origins, towards), tracer.trace(origins, towards)
    assert 0.1 < np.mean(least < 0) < 0.9
    assert found[least < -EPSILON].all()
    # its points are 0.0023 apart
    assert not found[least > 0.0024].any()


def test_a_ball_above_a_plate_shades_it_as_its_form_factor_says(ball):
    """(R / d)^2 cos of the angle between the plate's normal and the way to the ball (a ball above the horizon)."""
    _, tracer = ball
    places = np.array([[0.1, 0, 0], [0.35, 0, 0.2], [-0.4, 0, 0.3], [0.9, 0, -0.7]])
    way = np.array([0.1, 0.45, 0]) - places
    distance = np.linalg.norm(way, axis=1)
    free = np.pi * (1 - (0.3 / distance) ** 2 * way[:, 1] / distance)
    found = bake(tracer, places, np.tile([0.0, 1, 0], (4, 1)), directions=4096)
    np.testing.assert_allclose(found[:, 0] / sh.evaluate(np.array([0.0, 1, 0]), 1)[0], free, rtol=2e-3)


def test_unoccluded_is_the_cosine_lobe():
    tracer = MarchTracer(Analytic((sphere(0.9),)))
    positions, normals = on_ball(500, np.zeros(3), 0.9)
    error = bake(tracer, positions, normals, directions=1024) - sh.cosine_lobe(normals, 5)
    assert np.sqrt((error**2).mean()) < 1e-3
    assert tracer.rays_lost == 0
    assert tracer.rays_traced == 500 * 1024


def test_points_and_frames_are_those_of_the_scene(ball):
    field, tracer = ball
    frame = Frame(np.array([10.0, -5, 2]), 0.25)
    moved_tracer = MarchTracer(field, frame=frame)
    positions, normals = on_ball(200, np.array([0.1, 0.45, 0]), 0.3)
    expected = bake(tracer, positions, normals, directions=128)
    np.testing.assert_allclose(
        bake(moved_tracer, frame.from_unit(positions), normals, directions=128), expected, atol=2e-2
    )
    below = frame.from_unit(np.array([[0.1, 0.05, 0]]))
    assert moved_tracer.occluded(below, np.array([[0.0, 1, 0]])).all()
    assert not moved_tracer.occluded(below, np.array([[0.0, 0, 1]])).any()


def test_clearance_is_the_longest_free_way(ball):
    _, tracer = ball
    found = tracer.clearance(np.array([[0.1, 0, 0.0], [0.9, 0, 0.9]]), np.tile([0.0, 1, 0], (2, 1)))
    assert np.isinf(found).all()
    inside = MarchTracer(Analytic((difference(sphere(0.9), sphere(0.8)),)))
    assert 1.5 < inside.clearance(np.array([[0.8, 0, 0]]), np.array([[-1.0, 0, 0]]), directions=256)[0] < 1.61


def test_threads_and_chunks_change_no_bit(ball, monkeypatch):
    _, tracer = ball
    positions, normals = on_ball(300, np.array([0.1, 0.45, 0]), 0.3)
    one = bake(tracer, positions, normals, directions=64, threads=1)
    for rays in (64, 5000, 1 << 30):
        monkeypatch.setattr(transfer, "CHUNK_RAYS", rays)
        np.testing.assert_array_equal(one, bake(tracer, positions, normals, directions=64, threads=3))


def test_too_few_steps_are_counted(thin):
    field, _ = thin
    tracer = MarchTracer(field, steps=3)
    tracer.trace(*some_rays(500, 1, field))
    assert tracer.rays_lost > 50


def test_a_greater_lipschitz_constant_only_costs_steps(thin):
    """Of twice the distance: the very same surface, walked in half the steps that it claims."""
    field, tracer = thin
    double = Analytic((lambda p: 2 * field.whole(p),), lipschitz=2.0)
    origins, towards = some_rays(1000, 5, field)
    expected = tracer.trace(origins, towards)
    assert np.mean(MarchTracer(double).trace(origins, towards) != expected) < 3e-3


def test_the_mesh_sees_nearly_what_the_surface_does():
    described = Described(
        "ball", Analytic((PLATE, BALL)), (Material("plate"), Material("ball")), (-1.1, -0.2, -1.1), (1.1, 1, 1.1)
    )
    implicit = mesh.implicit_of(described)
    exact = MarchTracer(implicit.field, frame=implicit.frame)
    errors = []
    for resolution in (16, 48):
        scene = mesh.scene_of(implicit, resolution)
        points = samples.area_uniform(scene, 400, np.random.default_rng(0))
        points = project.projected(implicit.field, points, implicit.frame)
        errors.append(accuracy.measured_error(MeshTracer(scene, resolution), exact, points, directions=64))
    assert errors[1].points == 400
    assert 0 < errors[1].relative < 0.02
    assert errors[1].relative < errors[0].relative < 0.2
    assert errors[1].worst < 0.15


def test_the_loop_has_the_numbers_of_the_field(thin):
    field, _ = thin
    points = np.random.default_rng(0).uniform(-1, 1, (1001, 3))
    np.testing.assert_allclose(evaluated(field, points), field.distance(points), atol=5e-7)


def test_all_operations_compile():
    """Those that shapes seldom use, sine and cosine over many turns among them."""
    lines = (
        "def distance(x, y, z):",
        "    v = sin(F(40.0) * x) * cos(F(-9.0) * y) + floor(F(3.0) * z)",
        "    return v if x < y else -abs(v) / F(3.0)",
    )
    points = np.random.default_rng(0).uniform(-1, 1, (64, 3)).astype(np.float32)
    out = np.empty(len(points), np.float32)
    kernels.distances(compiled.compiled("\n".join(lines)).address, points, out)
    x, y, z = points.T.astype(np.float64)
    value = np.sin(40 * x) * np.cos(9 * y) + np.floor(3 * z)
    np.testing.assert_allclose(out, np.where(x < y, value, -np.abs(value) / 3), atol=5e-6)


def test_bad_input_is_named():
    with pytest.raises(PrtnetError, match="no surface in"):
        MarchTracer(Analytic((moved(sphere(0.5), 3, 0, 0),)))
    with pytest.raises(PrtnetError, match=r"epsilon 0\.1 and offset"):
        MarchTracer(Analytic((sphere(0.5),)), epsilon=0.1)
