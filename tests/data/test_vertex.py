"""The mesh of vertex PRT: cuts that keep the surface, and rays that start where they cannot leak."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import builtin, samples, shapes, transfer, vertex
from prtnet.data.part import Part
from prtnet.data.scene import Scene, assemble, frame_of
from prtnet.data.tracer import Tracer
from tests.data.ray_scenes import clipped_lobe, join, quad
from tests.render.meshes import barycentric


@pytest.fixture(scope="module")
def plants() -> Scene:
    return builtin.make("plants", tessellation=0.3)


def bake(mesh, points, *, kind="auto", directions=1024):
    sides = {"geometric_normals": points.geometric_normals, "rng": np.random.default_rng(0)}
    return transfer.bake(Tracer(mesh, kind=kind), points.positions, points.normals, directions=directions, **sides)


def ball(segments: int) -> Scene:
    surface = shapes.ellipsoid([1, 1, 1], segments)
    return assemble("ball", [Part("ball", surface.vertices, surface.faces, normals=surface.vertices, two_sided=False)])


def test_the_mesh_is_the_scene_with_both_its_sides(plants):
    split, mesh = plants.split_sides(), vertex.mesh(plants)
    assert len(split.faces) > len(plants.faces)
    for name in ("vertices", "normals"):
        np.testing.assert_array_equal(getattr(mesh, name)[mesh.faces], getattr(split, name)[split.faces])
    np.testing.assert_array_equal(mesh.part, split.part)
    np.testing.assert_array_equal(np.unique(mesh.faces), np.arange(len(mesh.vertices)))
    # each side its own: no vertex serves a front and a back
    front = np.unique(mesh.faces[: len(plants.faces)])
    assert not np.intersect1d(front, mesh.faces[len(plants.faces) :]).size


def test_cuts_keep_the_surface(plants):
    """Each piece lies on the triangle in whose place it stands, and the pieces fill it."""
    plain, level = vertex.mesh(plants), 2
    cut = vertex.mesh(plants, ["leaves_fern", "ground"], level)
    names = [material.name for material in plants.materials]
    chosen = np.isin(plain.part, [names.index("leaves_fern"), names.index("ground")])
    assert 0 < chosen.sum() < len(chosen)
    parent = np.repeat(np.arange(len(plain.faces)), np.where(chosen, 4**level, 1))
    assert len(parent) == len(cut.faces)
    np.testing.assert_array_equal(cut.part, plain.part[parent])
    np.testing.assert_array_equal(cut.face_origin, plain.face_origin[parent])
    corners = plain.vertices[plain.faces][parent]
    for corner in range(3):
        points = cut.vertices[cut.faces[:, corner]]
        weights = barycentric(corners, points)
        assert weights.min() > -1e-9
        np.testing.assert_allclose(np.einsum("ni,nij->nj", weights, corners), points, atol=1e-12)
    np.testing.assert_allclose(np.bincount(parent, cut.face_areas), plain.face_areas, rtol=1e-9)
    same = ~np.repeat(chosen, np.where(chosen, 4**level, 1))
    np.testing.assert_array_equal(cut.vertices[cut.faces[same]], plain.vertices[plain.faces[~chosen]])
    np.testing.assert_allclose(np.einsum("ni,ni->n", cut.face_normals, plain.face_normals[parent]), 1, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(cut.normals, axis=1), 1, atol=1e-6)


def test_neighbours_share_the_vertices_of_a_cut():
    """Euler: a closed ball stays closed, V - E + F = 2 with 3 F = 2 E."""
    for level in range(3):
        mesh = vertex.mesh(ball(16), ["ball"], level)
        assert len(mesh.vertices) - len(mesh.faces) / 2 == 2
    # interpolated normals stay near the ball's own
    assert (np.einsum("vi,vi->v", mesh.normals, mesh.vertices) > 0.95 * np.linalg.norm(mesh.vertices, axis=1)).all()


def test_uv_and_normals_of_new_vertices_lie_between():
    vertices, faces = quad([0, 0, 0], [2, 0, 0], [0, 3, 0])
    normals = np.array([[0, 0, 1], [1, 0, 0], [0, 0, 1], [0, 0, -1.0]])
    flat = assemble("flat", [Part("flat", vertices, faces, normals=normals, uv=vertices[:, :2] / [2, 3])])
    mesh = vertex.mesh(replace(flat, two_sided=np.zeros(2, bool)), ["flat"], 1)
    np.testing.assert_allclose(mesh.uv, mesh.vertices[:, :2] / [2, 3], atol=1e-7)
    middle = {tuple(place): normal for place, normal in zip(mesh.vertices[:, :2], mesh.normals, strict=True)}
    np.testing.assert_allclose(middle[1, 0], np.array([1, 0, 1]) / np.sqrt(2), atol=1e-6)
    # two normals that cancel leave that of the triangle
    np.testing.assert_allclose(middle[0, 1.5], [0, 0, 1], atol=1e-6)


def closed_box(rotation):
    """Six quads that look inwards, with vertices of their own."""
    sides = [
        quad([0, 0, 1], [1, 0, 0], [0, 0, -1]),
        quad([0, 1, 0], [1, 0, 0], [0, 0, 1]),
        quad([0, 0, 0], [1, 0, 0], [0, 1, 0]),
        quad([1, 0, 1], [-1, 0, 0], [0, 1, 0]),
        quad([0, 0, 1], [0, 0, -1], [0, 1, 0]),
        quad([1, 0, 0], [0, 0, 1], [0, 1, 0]),
    ]
    return turned(join(*sides), rotation)


def turned(mesh, rotation):
    vertices = mesh.vertices @ rotation.T
    mesh = replace(mesh, vertices=vertices, frame=frame_of(vertices))
    return replace(mesh, normals=np.repeat(mesh.face_normals[::2], 4, axis=0).astype(np.float32))


def rotation(seed: int) -> np.ndarray:
    found, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return found * np.sign(np.linalg.det(found))


@pytest.mark.parametrize("kind", ["fused", "embreex"])
@pytest.mark.parametrize("seed", range(3))
def test_no_light_leaks_into_the_corners_of_a_closed_room(seed, kind):
    """Every vertex of the room lies in three planes at once."""
    room = closed_box(rotation(seed))
    assert not bake(room, vertex.points(room), kind=kind).any()
    # what the test would see: rays from the very corners leave through the walls
    assert bake(room, samples.at_vertices(room), kind=kind)[:, 0].max() > 0.05


def test_the_corner_of_two_walls_sees_a_quarter():
    """The floor's vertex in the corner: the cosine lobe clipped by both walls, by quadrature."""
    big = 1e3
    floor, left, back = (
        quad([0, 0, 1], [1, 0, 0], [0, 0, -1]),
        quad([0, -big, big], [0, 0, -2 * big], [0, 2 * big, 0]),
        quad([-big, -big, 0], [2 * big, 0, 0], [0, 2 * big, 0]),
    )
    turn = rotation(5)
    mesh = turned(join(floor, left, back), turn)
    corner = vertex.points(vertex.mesh(with_material(mesh)))
    at = int(np.argmin(np.linalg.norm(mesh.vertices[:4], axis=1)))
    found = bake(mesh, samples.select(corner, np.full(64, at)), directions=4096).mean(axis=0)
    nodes = (np.arange(2000) + 0.5) / 2000
    height, azimuth = (each.ravel() for each in np.meshgrid(nodes, nodes[::4] * np.pi / 2))
    radius = np.sqrt(1 - height**2)
    seen = np.stack([radius * np.cos(azimuth), height, radius * np.sin(azimuth)], axis=1) @ turn.T
    solid_angle = np.full(len(seen), np.pi / 2 / len(seen))
    expected = sh.project(height[:, None], seen, solid_angle, 5)[:, 0]
    assert expected[0] == pytest.approx(0.886 / 4, abs=1e-3)
    np.testing.assert_allclose(found, expected, atol=3e-3)


def with_material(mesh):
    part = Part("room", mesh.vertices, mesh.faces, normals=mesh.normals, two_sided=False)
    return assemble("room", [part])


def test_the_foot_of_one_wall_sees_half():
    big = 1e3
    floor = quad([0, 0, 1], [1, 0, 0], [0, 0, -1])
    wall = quad([0, -big, big], [0, 0, -2 * big], [0, 2 * big, 0])
    mesh = turned(join(floor, wall), np.eye(3))
    foot = np.flatnonzero(mesh.vertices[:4, 0] == 0)
    found = bake(mesh, samples.select(vertex.points(with_material(mesh)), np.repeat(foot, 64)), directions=4096)
    np.testing.assert_allclose(found.mean(axis=0), clipped_lobe([0, 1, 0], [1, 0, 0], 5), atol=3e-3)


@pytest.mark.parametrize("name", ["plants", "cornell", "tea_set"])
def test_rays_start_next_to_their_vertices_and_before_their_faces(name):
    mesh = vertex.mesh(builtin.make(name, tessellation=0.3).centred())
    points, corner = vertex.points(mesh), mesh.faces.ravel()
    diagonal = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    assert np.linalg.norm(points.positions - mesh.vertices, axis=1).max() <= 1.0001e-4 * diagonal
    np.testing.assert_allclose(np.linalg.norm(points.geometric_normals, axis=1), 1, atol=1e-6)
    away = points.positions + 1e-5 * diagonal * points.geometric_normals - mesh.vertices
    normals = np.repeat(mesh.face_normals, 3, axis=0)
    before = np.einsum("ci,ci->c", away[corner], normals)
    sharp = np.einsum("ci,ci->c", points.geometric_normals[corner], normals) <= 1e-3
    assert sharp.mean() < 0.01
    assert before[~sharp].min() > 0
    assert (np.sum(mesh.faces[points.face] == np.arange(len(mesh.vertices))[:, None], axis=1) == 1).all()


def test_inside_a_surface_vertices_stay_where_they_are():
    mesh = vertex.mesh(ball(32))
    moved = np.linalg.norm(vertex.points(mesh).positions - mesh.vertices, axis=1)
    assert moved.max() < 1e-5


def test_positions_are_in_scene_coordinates(plants):
    far = replace(plants, vertices=plants.vertices * 100 + 1000.0, frame=frame_of(plants.vertices * 100 + 1000.0))
    near, moved = (vertex.points(vertex.mesh(each)) for each in (plants, far))
    np.testing.assert_allclose((moved.positions - 1000) / 100, near.positions, atol=1e-9)


def test_faces_that_cancel_leave_the_normal_of_one():
    """A sheet of two faces back to back that share their vertices."""
    vertices, faces = quad([0, 0, 0], [1, 0, 0], [0, 1, 0])
    sheet = replace(join((vertices, np.concatenate([faces, faces[:, ::-1]]))), part=np.zeros(4, np.int32))
    points = vertex.points(sheet)
    np.testing.assert_allclose(np.abs(points.geometric_normals), np.tile([0, 0, 1], (4, 1)), atol=1e-6)


def test_unshadowed_is_the_cosine_lobe_and_a_ball_has_it_traced(plants):
    mesh = vertex.mesh(plants)
    np.testing.assert_array_equal(sh.cosine_lobe(mesh.normals, 4), sh.cosine_lobe(mesh.normals, 4))
    ball_mesh = vertex.mesh(ball(64))
    error = bake(ball_mesh, vertex.points(ball_mesh)) - sh.cosine_lobe(ball_mesh.normals, 5)
    assert np.sqrt(np.mean(error**2)) < 3e-3


def test_interpolation_is_linear_over_each_face(plants):
    mesh = vertex.mesh(plants)
    face = np.arange(0, len(mesh.faces), 7)
    weights = np.random.default_rng(0).dirichlet([1, 1, 1], len(face))
    expected = np.einsum("ni,nij->nj", weights, mesh.vertices[mesh.faces[face]])
    np.testing.assert_allclose(vertex.interpolate(mesh.vertices, mesh, face, weights), expected, atol=1e-12)


def test_errors(plants):
    with pytest.raises(PrtnetError, match=r"vertex.subdivide: found Ground, expected some of ground, pot_"):
        vertex.mesh(plants, ["Ground", "ground"], 1)
    with pytest.raises(PrtnetError, match=r"vertex.level: found -1, expected 0 or more"):
        vertex.check(plants, ["ground"], -1)
    with pytest.raises(
        PrtnetError, match=r"vertex.level: found 40, which makes \d+ triangles, expected at most 16777215"
    ):
        vertex.mesh(plants, ["ground"], 40)
