"""Texels lie on the surface where their uv says, borders included; dilation; files."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet.data import atlas, builtin, texture
from prtnet.data.scene import Frame
from tests.render.meshes import atlas_uv, barycentric, quad, scene, sphere

SIZE = 256


@pytest.fixture(scope="module")
def made() -> atlas.Atlas:
    return atlas.make(builtin.make("plants", tessellation=0.4).centred(), size=SIZE)


@pytest.fixture(scope="module")
def texels(made) -> texture.Texels:
    return texture.gbuffer(made, SIZE)


def test_positions_lie_on_their_faces(made, texels):
    corners = made.scene.vertices[made.scene.faces[texels.face]]
    weights = barycentric(corners, texels.positions)
    away = np.abs(np.einsum("ni,ni->n", texels.positions - corners[:, 0], made.scene.face_normals[texels.face]))
    assert away.max() < 1e-6
    assert weights.min() > 0
    assert np.einsum("ni,nij->nj", weights, corners) == pytest.approx(texels.positions, abs=1e-6)


def test_normals_are_unit_and_on_the_faces_side(texels):
    np.testing.assert_allclose(np.linalg.norm(texels.normals, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(texels.geometric_normals, axis=1), 1, atol=1e-5)
    assert np.mean(np.einsum("ni,ni->n", texels.normals, texels.geometric_normals) > 0) > 0.99


def test_a_texels_position_has_its_uv(made, texels):
    """The round trip texel -> surface point -> uv -> texel: exact inside, within the texel at borders."""
    uv = atlas_uv(made, texels.face, texels.positions)
    row, column = np.divmod(texels.index, SIZE)
    off = np.stack([uv[:, 0] * SIZE - column - 0.5, (1 - uv[:, 1]) * SIZE - row - 0.5], axis=1)
    covered = atlas.coverage(made.uv[made.scene.faces], SIZE).reshape(-1)[texels.index] > 0
    assert 0.1 < np.mean(covered) < 0.9
    # texture coordinates are float32; centres on the very edge of a face are moved into it
    assert np.median(np.abs(off[covered])) < 1e-4
    assert np.abs(off[covered]).max() < 0.26
    assert np.abs(off).max() < 0.72 + 0.25


def test_every_texel_that_a_face_touches_is_there(made, texels):
    """Points drawn on the faces, in texture space, find their texel in use."""
    rng, corners = np.random.default_rng(0), made.uv[made.scene.faces].astype(np.float64)
    points = np.einsum("nfi,fij->nfj", rng.dirichlet([1, 1, 1], (40, len(corners))), corners).reshape(-1, 2) * SIZE
    cell = np.minimum(np.floor(points).astype(int), SIZE - 1)
    # float32 may put a point on a texel's edge on either side
    inner = (np.abs(points - np.round(points)) > 1e-3).all(axis=1)
    used = texture.mask(texels)
    assert used[SIZE - 1 - cell[inner, 1], cell[inner, 0]].all()


def test_border_texels_keep_off_the_edge():
    """A wall on a floor: a point on the line between them would see the outside below."""
    room = scene(quad([-1, 0, 1], [2, 0, 0], [0, 0, -2]), quad([-1, 0, -1], [2, 0, 0], [0, 1, 0]))
    found = texture.gbuffer(atlas.make(replace(room, uv=None), size=128), 128)
    wall = found.normals[:, 2] > 0.5
    low = room.vertices[:, 1].min()
    assert found.positions[wall, 1].min() > low + 1e-3
    assert found.positions[wall, 1].min() < low + 0.05
    assert found.positions[~wall, 2].min() > -1 + 1e-3


def test_scene_coordinates(made):
    flat = scene(quad([-1, 0, 1], [2, 0, 0], [0, 0, -2]))
    moved = atlas.make(_moved(flat, Frame(np.array([1e5, 2e5, -3e5]), 1e-2)), size=64)
    still = texture.gbuffer(atlas.make(flat, size=64), 64)
    found = texture.gbuffer(moved, 64)
    np.testing.assert_allclose(moved.scene.frame.to_unit(found.positions), still.positions, atol=1e-9)
    assert len(found.index) == 64 * 64


def _moved(unit_scene, frame):
    return replace(unit_scene, vertices=frame.from_unit(unit_scene.vertices), frame=frame)


def test_single_chart_takes_the_front():
    both = scene(quad([-1, 0, 1], [2, 0, 0], [0, 0, -2], two_sided=True))
    found = texture.gbuffer(atlas.make(both, size=64, single_chart=True), 64)
    assert (found.normals[:, 1] > 0).all()


def test_dilation_takes_the_mean_of_valid_neighbours():
    one = _texels(np.array([3 * 8 + 3, 3 * 8 + 5]), 8)
    image = texture.assemble(one, np.array([[1.0], [3.0]]), dilation=1)[..., 0]
    assert image[3, 3] == 1
    assert image[3, 4] == 2
    assert image[2, 2] == 1
    assert image[4, 6] == 3
    assert np.count_nonzero(image) == 15
    assert np.count_nonzero(texture.assemble(one, np.array([[1.0], [3.0]]), dilation=0)) == 2


def test_dilation_grows_by_one_texel_per_ring_and_stops_at_the_border():
    image = texture.assemble(_texels(np.array([0]), 8), np.array([[1.0, 2.0]]), dilation=3)
    assert np.count_nonzero(image[..., 0]) == 16
    np.testing.assert_array_equal(image[:4, :4], np.broadcast_to([1, 2], (4, 4, 2)))


def _texels(index, size):
    count = len(index)
    normals = np.tile(np.float32([0, 1, 0]), (count, 1))
    return texture.Texels(np.zeros((count, 3)), normals, normals, np.zeros(count, np.int32), index, size)


def test_smooth_sphere_texels_are_near_the_sphere():
    found = texture.gbuffer(atlas.make(scene(sphere(48)), size=128), 128)
    radius = np.linalg.norm(found.positions, axis=1)
    assert 0.995 < radius.min() <= radius.max() <= 1 + 1e-9
    np.testing.assert_allclose(found.normals, found.positions / radius[:, None], atol=5e-3)
