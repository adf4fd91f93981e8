"""Meshes of implicit surfaces, and points moved onto the surfaces themselves."""

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data import samples
from prtnet.data.implicit import mesh, project
from prtnet.data.implicit.field import Analytic, unit_gradient
from prtnet.data.implicit.operators import moved, turned, union
from prtnet.data.implicit.shapes import box, capsule, plane, sphere, torus
from prtnet.data.implicit.surface import Described
from prtnet.data.normals import face_cross
from prtnet.data.repair import is_closed
from prtnet.data.scene import Material

RED, BLUE = (Material(name, np.float32(colour)) for name, colour in (("red", [1, 0, 0]), ("blue", [0, 0, 0.5])))


@pytest.fixture(scope="module")
def described():
    """Far from the origin and ten units wide; its boxes have creases, its parts touch."""
    body = union(moved(sphere(2), 100, 5, 0), moved(turned(box(3, 1, 2), "y", 30), 100, 3.5, 0), smooth=0.3)
    ring = moved(torus(4.5, 0.5), 100, 3.5, 0)
    return Described("toy", Analytic((body, ring)), (RED, BLUE), (94, 0, -6), (106, 8, 6), "inside")


@pytest.fixture(scope="module")
def implicit(described):
    return mesh.implicit_of(described)


@pytest.fixture(scope="module")
def scene(implicit):
    return mesh.scene_of(implicit, 64)


@pytest.fixture(scope="module")
def picked(scene, implicit):
    found = samples.area_uniform(scene, 4000, np.random.default_rng(0))
    return found, project.projected(implicit.field, found, implicit.frame)


def test_the_longest_extent_fills_the_unit_box(implicit, scene):
    np.testing.assert_allclose(implicit.frame.centre[[0, 2]], [100, 0], atol=1e-5)
    # the ring is 10 across
    assert implicit.frame.scale == pytest.approx(0.2, rel=1e-6)
    unit = implicit.frame.to_unit(scene.vertices)
    np.testing.assert_allclose([unit.min(axis=0)[0], unit.max(axis=0)[2]], [-1, 1], atol=2e-3)
    assert np.abs(unit).max() < 1 + 1e-5


def test_vertices_lie_on_the_surface_with_its_normals(implicit, scene):
    unit = implicit.frame.to_unit(scene.vertices)
    assert np.abs(implicit.field.distance(unit)).max() < 1e-6
    np.testing.assert_allclose(scene.normals, unit_gradient(implicit.field, unit), atol=1e-5)
    along = np.einsum("fi,fi->f", scene.face_normals, scene.normals[scene.faces].mean(axis=1))
    # outwards; those that cut a crease lean
    assert np.mean(along > 0.5) > 0.99
    assert is_closed(scene.vertices, scene.faces)
    assert not scene.two_sided.any()


def test_parts_keep_their_materials_and_their_own_vertices(implicit, scene):
    assert [material.name for material in scene.materials] == ["red", "blue"]
    np.testing.assert_array_equal(scene.materials[1].albedo, BLUE.albedo)
    assert scene.camera == "inside"
    assert scene.frame is implicit.frame
    centres = implicit.frame.to_unit(scene.vertices[scene.faces].mean(axis=1))
    np.testing.assert_array_equal(scene.part, implicit.field.part(centres))
    of_part = [set(scene.faces[scene.part == part].ravel().tolist()) for part in (0, 1)]
    assert min(map(len, of_part)) > 100
    assert not of_part[0] & of_part[1]


def test_samples_move_onto_the_surface(implicit, picked):
    before, after = picked
    unit = implicit.frame.to_unit(after.positions)
    assert np.abs(implicit.field.distance(unit)).max() < 1e-6
    np.testing.assert_allclose(np.linalg.norm(after.normals, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(after.normals, unit_gradient(implicit.field, unit), atol=1e-5)
    np.testing.assert_array_equal(after.geometric_normals, after.normals)
    moved_by = np.linalg.norm(unit - implicit.frame.to_unit(before.positions), axis=1)
    assert 0 < np.quantile(moved_by, 0.99) < 2 / 64


def test_area_and_volume_of_a_ball_converge_to_second_order():
    field, errors = Analytic((sphere(0.9),)), []
    for resolution in (16, 32, 64):
        vertices, faces = mesh.triangles(field, resolution, -np.ones(3), np.ones(3), "ball", field.distance)
        area = np.linalg.norm(face_cross(vertices, faces), axis=1).sum() / 2
        volume = np.einsum("fi,fi->f", vertices[faces[:, 0]], face_cross(vertices, faces)).sum() / 6
        errors.append([1 - area / (4 * np.pi * 0.81), 1 - volume / (4 / 3 * np.pi * 0.729)])
    slopes = -np.diff(np.log2(errors), axis=0)
    np.testing.assert_allclose(slopes, 2, atol=0.15)
    assert np.max(errors[-1]) < 2e-3


def test_points_stay_equally_dense_after_projection():
    """Equal heights of a ball have equal areas (Archimedes)."""
    field = Analytic((sphere(0.9),))
    described = Described("ball", field, (RED,), (-1, -1, -1), (1, 1, 1))
    implicit = mesh.implicit_of(described)
    found = samples.area_uniform(mesh.scene_of(implicit, 48), 20_000, np.random.default_rng(1))
    points = project.projected(implicit.field, found, implicit.frame)
    heights = np.histogram(points.positions[:, 1], np.linspace(-0.9, 0.9, 11))[0]
    np.testing.assert_allclose(heights, 2000, rtol=0.02)


def test_flat_faces_have_normals():
    """Where a box's distance is exactly 0, neither branch of it has a slope."""
    points = np.array([[0.5, 0.1, 0.2], [0.1, -0.25, 0], [0.3, 0.2, 0.75]])
    found = unit_gradient(Analytic((box(0.5, 0.25, 0.75),)), points)
    np.testing.assert_allclose(found, [[1, 0, 0], [0, -1, 0], [0, 0, 1]], atol=1e-9)


def test_only_blocks_near_the_surface_are_looked_into():
    field = Analytic((capsule((-0.7, 0, 0), (0.7, 0, 0), 0.1),))
    seen = []

    def distance(points):
        seen.append(len(points))
        return field.distance(points)

    start, counts, voxel = -np.ones(3), (65, 65, 65), 2 / 64
    found = mesh.grid(distance, 1.0, start, counts, voxel)
    index = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    expected = field.distance(start + index * voxel).reshape(counts)
    np.testing.assert_array_equal(np.sign(found), np.sign(expected))
    near = np.abs(expected) < 2 * voxel
    np.testing.assert_allclose(found[near], expected[near], atol=1e-6)
    assert sum(seen) < 0.4 * found.size


BOUNDS = (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("shape", "low", "high", "message"),
    [
        (moved(sphere(0.5), 9, 0, 0), *BOUNDS, "expected a surface"),
        (sphere(9.0), *BOUNDS, "expected a surface"),
        (moved(sphere(0.5), 0.8, 0, 0), *BOUNDS, "beyond the high end of x"),
        (plane(), *BOUNDS, "beyond the low end of x"),
        (lambda p: sphere(0.5)(p) * np.inf, *BOUNDS, "not finite"),
        (sphere(0.5), BOUNDS[1], BOUNDS[0], "expected low < high"),
    ],
)
def test_what_is_no_surface_inside_its_bounds_is_refused(shape, low, high, message):
    with pytest.raises(PrtnetError, match=f"odd: .*{message}"):
        mesh.implicit_of(Described("odd", Analytic((shape,)), (RED,), low, high))


def test_too_few_voxels():
    implicit = mesh.implicit_of(Described("ball", Analytic((sphere(0.5),)), (RED,), *BOUNDS))
    with pytest.raises(PrtnetError, match="found 4, expected at least 8"):
        mesh.scene_of(implicit, 4)


def test_points_that_find_no_surface_are_refused(picked):
    with pytest.raises(PrtnetError, match="of its mesh are up to"):
        project.projected(Analytic((moved(sphere(0.1), 9, 0, 0),)), picked[0])
