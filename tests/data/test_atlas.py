"""Every surface point has a place of its own, and a look-up there reads its own chart."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data import atlas, builtin, samples, texture
from prtnet.data.scene import Scene
from tests.render.meshes import atlas_uv, bilinear, chart_of_face, quad, scene, sphere

SIZE = 256


@pytest.fixture(scope="module")
def plants() -> Scene:
    return builtin.make("plants", tessellation=0.4).centred()


@pytest.mark.parametrize("name", ["cornell", "tea_set", "dining_table"])
def test_builtin_scenes_do_not_overlap(name):
    made = atlas.make(builtin.make(name, tessellation=0.4).centred(), size=SIZE)
    counts = atlas.coverage(made.uv[made.scene.faces], SIZE)
    assert counts.max() == 1
    # thin parts lose much to the space between charts
    assert np.mean(counts) > 0.15


def test_split_scene_is_kept_face_by_face(plants):
    made, split = atlas.make(plants, size=SIZE), plants.split_sides()
    np.testing.assert_array_equal(made.scene.vertices[made.scene.faces], split.vertices[split.faces])
    np.testing.assert_array_equal(made.scene.normals[made.scene.faces], split.normals[split.faces])
    np.testing.assert_array_equal(made.scene.part, split.part)
    assert made.uv.min() >= 0
    assert made.uv.max() <= 1


@pytest.mark.parametrize("single_chart", [False, True])
def test_samples_are_where_their_face_and_weights_say_in_the_atlas_too(plants, single_chart):
    made = atlas.make(plants, size=SIZE, single_chart=single_chart)
    vertices = samples.at_vertices(plants)
    for found in (samples.area_uniform(plants, 4000, np.random.default_rng(1)), vertices):
        corner = made.scene.faces[found.face]
        positions = np.einsum("ni,nij->nj", found.weights, made.scene.vertices[corner])
        np.testing.assert_allclose(positions, found.positions, rtol=0, atol=1e-12)
        np.testing.assert_allclose(found.weights.sum(axis=1), 1, rtol=0, atol=1e-12)
    some = samples.select(vertices, np.arange(5, 20))
    np.testing.assert_array_equal(some.weights, vertices.weights[5:20])


def test_two_sides_have_two_charts(plants):
    made = atlas.make(plants, size=SIZE)
    assert atlas.coverage(made.uv[made.scene.faces], SIZE).max() == 1
    front, back = _sides(plants)
    assert len(back)
    middles = made.uv[made.scene.faces].mean(axis=1)
    # a texel apart: no two sides look up the same place
    assert np.abs(middles[front] - middles[back]).max(axis=1).min() > 1 / SIZE
    chart = chart_of_face(made)
    assert not np.intersect1d(chart[front], chart[back]).size


def test_single_chart_shares_one_place(plants):
    made = atlas.make(plants, size=SIZE, single_chart=True)
    front, back = _sides(plants)
    corners = made.uv[made.scene.faces]
    np.testing.assert_array_equal(corners[front], corners[back][:, ::-1])


def _sides(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    front = np.flatnonzero(scene.two_sided)
    return front, len(scene.faces) + np.arange(len(front))


@pytest.mark.parametrize("name", ["cornell", "plants"])
def test_bilinear_lookups_touch_only_the_points_own_chart(name):
    """Texels filled with the number of their chart come back exactly, also at borders."""
    made = atlas.make(builtin.make(name, tessellation=0.4).centred(), size=SIZE)
    texels, chart = texture.gbuffer(made, SIZE), chart_of_face(made)
    numbers = np.random.default_rng(0).random(chart.max() + 1).astype(np.float32)
    filled = texture.assemble(texels, numbers[chart[texels.face]][:, None], dilation=1)
    points = samples.area_uniform(made.scene, 20_000, np.random.default_rng(1))
    found = bilinear(filled, atlas_uv(made, points.face, points.positions))[:, 0]
    np.testing.assert_allclose(found, numbers[chart[points.face]], atol=1e-6)
    if name == "cornell":  # its charts are rectangles of whole texels
        return
    # without the ring the same look-ups do read empty texels
    bare = texture.assemble(texels, numbers[chart[texels.face]][:, None], dilation=0)
    assert np.abs(bilinear(bare, atlas_uv(made, points.face, points.positions))[:, 0] - found).max() > 1e-3


@pytest.mark.parametrize(("padding", "level"), [(2, 1), (4, 2)])
def test_padding_keeps_charts_apart_on_mip_levels(padding, level):
    """The same on a level of detail: with 2^level texels around each chart hardly a look-up holds another's."""
    tea = builtin.make("tea_set", tessellation=0.4).centred()
    off = []
    for texels_apart in (1, padding):
        made = atlas.make(tea, size=SIZE, padding=texels_apart)
        texels, chart = texture.gbuffer(made, SIZE), chart_of_face(made)
        numbers = np.random.default_rng(0).random(chart.max() + 1).astype(np.float32)
        page = texture.page(texels, numbers[chart[texels.face]][:, None], dilation=1, levels=level + 1)
        points = samples.area_uniform(made.scene, 20_000, np.random.default_rng(1))
        found = bilinear(page.levels[level], atlas_uv(made, points.face, points.positions))[:, 0]
        off.append(np.mean(np.abs(found - numbers[chart[points.face]]) > 1e-3))
    # not none: a ring of dilation between two charts may still be the mean of both
    assert off[1] < 0.1 * off[0]
    assert off[0] > 0.015


def test_good_file_coordinates_are_used():
    made = atlas.make(scene(quad([-1, 0, 1], [2, 0, 0], [0, 0, -2])), size=64)
    assert made.source == "file"
    assert made.overlap == 0


def test_sphere_with_one_chart_is_used():
    made = atlas.make(scene(sphere()), size=SIZE)
    assert made.source == "file"
    np.testing.assert_array_equal(made.uv, scene(sphere()).uv)


def test_overlap_is_measured():
    twice = scene(quad([-1, 0, 1], [2, 0, 0], [0, 0, -2]), quad([-1, 1, 1], [2, 0, 0], [0, 0, -2]))
    uv = twice.uv.copy()
    uv[:4, 0] *= 0.5
    uv[4:, 0] = 0.25 + uv[4:, 0] * 0.5
    half = replace(twice, uv=uv)
    assert atlas.file_overlap(half, 64) == pytest.approx(0.25 / 0.75, abs=0.02)
    made = atlas.make(half, size=64)
    assert made.source == "xatlas"
    assert made.overlap == pytest.approx(0.25 / 0.75, abs=0.02)


@pytest.mark.parametrize("fault", ["outside", "flat", "two-sided"])
def test_unfit_file_coordinates_are_replaced(fault):
    bad = scene(quad([-1, 0, 1], [2, 0, 0], [0, 0, -2], two_sided=fault == "two-sided"))
    if fault == "outside":
        bad = replace(bad, uv=bad.uv + np.float32(0.1))
    if fault == "flat":
        bad = replace(bad, uv=np.zeros_like(bad.uv))
    made = atlas.make(bad, size=64)
    assert made.source == "xatlas"
    assert atlas.coverage(made.uv[made.scene.faces], 64).max() == 1


def test_faces_too_small_to_unwrap_still_get_a_place():
    tiny = quad([0.5, 0.5, 0], [1e-9, 0, 0], [0, 1e-9, 0], name="tiny")
    made = atlas.make(replace(scene(quad([-1, 0, 1], [2, 0, 0], [0, 0, -2]), tiny), uv=None), size=64)
    counts = atlas.coverage(made.uv[made.scene.faces], 64)
    places = np.floor(made.uv[made.scene.faces[-2:]] * 64).astype(int)
    assert (counts[63 - places[..., 1], places[..., 0]] == 1).all()


def test_too_small_an_atlas_is_refused(plants):
    with pytest.raises(PrtnetError, match=r"atlas\.size"):
        atlas.make(plants, size=16)
    with pytest.raises(PrtnetError, match="at least 16"):
        atlas.make(plants, size=8)


def test_same_scene_same_atlas(plants):
    np.testing.assert_array_equal(atlas.make(plants, size=SIZE).uv, atlas.make(plants, size=SIZE).uv)
