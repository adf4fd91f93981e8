"""Area-uniform samples: counts, uniformity, both sides, and where they must not be."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats
from scipy.spatial import KDTree

from prtnet import PrtnetError
from prtnet.data import builtin, samples
from prtnet.data.part import Part
from prtnet.data.scene import Scene, assemble

SEQUENCES = ["r2", "random"]


def triangles(
    count: int = 12, seed: int = 3, *, two_sided: bool = False, scale: float = 1.0, shift: float = 0.0
) -> Scene:
    """Separate triangles of very different areas."""
    rng = np.random.default_rng(seed)
    size = np.geomspace(0.05, 1, count)[:, None, None]
    corners = (rng.normal(size=(count, 3, 3)) * size + rng.normal(size=(count, 1, 3))).reshape(-1, 3)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return assemble("triangles", [Part("p", corners * scale + shift, faces, two_sided=two_sided)])


def barycentric(scene: Scene, found: samples.Samples) -> np.ndarray:
    """Weights by least squares in float64, and the check that the points lie in the planes of their faces."""
    split = scene.split_sides()
    a, b, c = np.moveaxis(split.vertices[split.faces[found.face]], 1, 0)
    edges = np.stack([b - a, c - a], axis=2)
    weights = np.stack([np.linalg.lstsq(e, p, rcond=None)[0] for e, p in zip(edges, found.positions - a, strict=True)])
    rebuilt = a + np.einsum("nij,nj->ni", edges, weights)
    np.testing.assert_allclose(rebuilt, found.positions, atol=1e-9 * np.ptp(scene.vertices))
    return np.concatenate([1 - weights.sum(axis=1, keepdims=True), weights], axis=1)


@pytest.mark.parametrize("sequence", SEQUENCES)
@pytest.mark.parametrize("two_sided", [False, True])
def test_counts_follow_areas(sequence: str, two_sided: bool) -> None:
    scene = triangles(two_sided=two_sided)
    found = samples.area_uniform(scene, 40_000, np.random.default_rng(1), sequence=sequence)
    assert found.positions.shape == (40_000, 3)
    areas = scene.split_sides().face_areas
    expected = areas / areas.sum() * 40_000
    counts = np.bincount(found.face, minlength=len(areas))
    assert stats.chisquare(counts, expected).pvalue > 1e-3
    if sequence == "r2":
        # systematic picks are off by less than one
        assert np.abs(counts - expected).max() < 1


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_uniform_inside_a_triangle(sequence: str) -> None:
    scene = triangles(1)
    weights = barycentric(scene, samples.area_uniform(scene, 8000, np.random.default_rng(2), sequence=sequence))
    assert weights.min() >= -1e-9
    # 16 equal triangles: the cell of (floor 4a, floor 4b) and whether the point is in its upper half
    scaled = 4 * weights[:, :2]
    cell = np.floor(scaled).astype(int)
    upper = (scaled - cell).sum(axis=1) > 1
    _, counts = np.unique(np.column_stack([cell, upper]), axis=0, return_counts=True)
    assert len(counts) == 16
    assert stats.chisquare(counts).pvalue > 1e-3


def test_the_wrong_rule_would_fail() -> None:
    numbers = np.random.default_rng(0).random((20_000, 2))
    fair = samples.square_root_rule(numbers).mean(axis=0)
    np.testing.assert_allclose(fair, 1 / 3, atol=0.01)
    naive = samples.square_root_rule(np.column_stack([numbers[:, 0] ** 2, numbers[:, 1]])).mean(axis=0)
    assert np.abs(naive - 1 / 3).max() > 0.1


def test_r2_is_more_even_than_random() -> None:
    corners = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0, -0.866]])
    scene = assemble("regular", [Part("p", corners, np.array([[0, 1, 2]]))])
    spacing = {}
    for sequence in SEQUENCES:
        points = samples.area_uniform(scene, 4000, np.random.default_rng(5), sequence=sequence).positions
        spacing[sequence] = KDTree(points).query(points, k=2)[0][:, 1].mean()
    assert spacing["r2"] > 1.2 * spacing["random"]


def test_both_sides_of_two_sided_faces() -> None:
    scene = triangles(two_sided=True)
    found = samples.area_uniform(scene, 20_000, np.random.default_rng(4))
    split = scene.split_sides()
    behind = found.face >= len(scene.faces)
    assert abs(behind.mean() - 0.5) < 0.01
    assert split.face_origin is not None
    sign = np.where(behind, -1, 1)
    front = scene.face_normals[split.face_origin[found.face]]
    np.testing.assert_allclose(np.einsum("ni,ni->n", found.geometric_normals, front), sign, atol=1e-5)
    assert (np.einsum("ni,ni->n", found.normals, found.geometric_normals) > 0).all()


def test_vertices_stay_unseen() -> None:
    rng = np.random.default_rng(0)
    weights = np.concatenate([np.eye(3), np.eye(3) * 0.99995 + 0.00005 / 3, rng.dirichlet([1, 1, 1], 500)])
    away = samples._away_from_vertices(weights.copy(), rng)
    assert away.max() <= 1 - samples.VERTEX_MARGIN
    np.testing.assert_array_equal(away[6:], weights[6:])
    assert samples.VERTEX_MARGIN == 1e-4


def test_normals_are_unit_and_interpolated() -> None:
    scene = builtin.make("tea_set", tessellation=0.3)
    found = samples.area_uniform(scene, 3000, np.random.default_rng(0))
    for normals in (found.normals, found.geometric_normals):
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    weights = barycentric(scene, found)
    mixed = np.einsum("nk,nki->ni", weights, scene.normals[scene.faces[found.face]])
    mixed /= np.linalg.norm(mixed, axis=1, keepdims=True)
    np.testing.assert_allclose(found.normals, mixed, atol=1e-4)


def test_opposite_normals_fall_back_to_the_face() -> None:
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    scene = assemble(
        "s", [Part("p", flat, np.array([[0, 1, 2]]), normals=np.array([[0, 0, 1], [0, 0, -1], [0, 0, 1.0]]))]
    )
    found = samples.at_barycentric(scene, np.array([0]), np.array([[0.5, 0.5, 0.0]]))
    np.testing.assert_allclose(found.normals, [[0, 0, 1]])


@settings(max_examples=25, deadline=None)
@given(exponent=st.integers(-10, 20), shift=st.integers(-(2**16), 2**16), seed=st.integers(0, 99))
def test_the_same_wherever_the_scene_is(exponent: int, shift: int, seed: int) -> None:
    scale = 2.0**exponent
    plain, moved = triangles(), triangles(scale=scale, shift=shift * scale / 256)
    first, second = (samples.area_uniform(s, 500, np.random.default_rng(seed)) for s in (plain, moved))
    np.testing.assert_array_equal(first.face, second.face)
    unit = plain.frame.to_unit(first.positions), moved.frame.to_unit(second.positions)
    np.testing.assert_allclose(*unit, atol=1e-9)


def test_same_seed_same_samples() -> None:
    scene = triangles()
    first, again, other = (samples.area_uniform(scene, 100, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.positions, again.positions)
    assert not np.array_equal(first.positions, other.positions)


def test_any_slice_is_fair() -> None:
    scene = triangles()
    found = samples.area_uniform(scene, 40_000, np.random.default_rng(1))
    areas = scene.face_areas / scene.face_areas.sum()
    counts = np.bincount(found.face[:4000], minlength=len(areas))
    assert stats.chisquare(counts, areas * 4000).pvalue > 1e-3


def test_vertex_set_has_every_side() -> None:
    scene = triangles(two_sided=True)
    found = samples.at_vertices(scene)
    assert len(found.positions) == 2 * len(scene.vertices)
    np.testing.assert_allclose(found.positions[: len(scene.vertices)], scene.vertices)
    assert (np.einsum("ni,ni->n", found.normals, found.geometric_normals) > 0.99).all()
    split = scene.split_sides()
    assert all(index in split.faces[face] for index, face in enumerate(found.face))


def test_select() -> None:
    found = samples.area_uniform(triangles(), 50, np.random.default_rng(0))
    mask = np.arange(50) % 2 == 0
    np.testing.assert_array_equal(samples.select(found, mask).positions, found.positions[::2])
    np.testing.assert_array_equal(samples.select(found, np.array([3, 1])).face, found.face[[3, 1]])


@given(arrays(np.float64, (30, 3), elements=st.floats(-1e6, 1e6)))
def test_morton_order_is_a_permutation(points: np.ndarray) -> None:
    assert sorted(samples.morton_order(points)) == list(range(30))


def test_morton_order_is_the_z_curve() -> None:
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    shuffled = np.random.default_rng(0).permutation(8)
    np.testing.assert_array_equal(corners[shuffled][samples.morton_order(corners[shuffled])], corners)
    points = np.random.default_rng(0).random((4000, 3))
    step = np.linalg.norm(np.diff(points[samples.morton_order(points)], axis=0), axis=1).mean()
    assert step < 0.2 * np.linalg.norm(np.diff(points, axis=0), axis=1).mean()


def test_a_million_points_take_less_than_two_seconds() -> None:
    scene = builtin.make("plants").centred()
    start = time.process_time()
    samples.area_uniform(scene, 1_000_000, np.random.default_rng(0))
    assert time.process_time() - start < 2


def test_errors_say_what_is_expected() -> None:
    with pytest.raises(PrtnetError, match="count"):
        samples.area_uniform(triangles(), 0, np.random.default_rng(0))
    with pytest.raises(PrtnetError, match=r"'sobol'.*r2"):
        samples.area_uniform(triangles(), 1, np.random.default_rng(0), sequence="sobol")
