"""Measurement points: on surfaces, with neighbours on their side, none of them twice."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from prtnet import PrtnetError
from prtnet.data import builtin, hull, measurement
from prtnet.data.hull import hull_of
from prtnet.data.part import Part
from prtnet.data.scene import assemble
from prtnet.data.shapes import box
from prtnet.data.signed_distance import Distance


def plate(thickness=0.002):
    """A thin solid plate, and a sheet above it."""
    solid = box([-1, 0, -1], [1, thickness, 1])
    corners = np.array([[-1.0, 1, -1], [-1, 1, 1], [1, 1, 1], [1, 1, -1]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    parts = [Part("plate", solid.vertices, solid.faces, albedo=np.array([1.0, 0.5, 0.25]), two_sided=False)]
    parts += [Part("sheet", corners, faces, albedo=np.array([0.0, 0.0, 0.5]), two_sided=True)]
    return assemble("plate", parts).centred()


def test_points_lie_on_surfaces_with_their_normals_and_albedo():
    scene = plate()
    found = measurement.on_surface(scene, 64, 8, np.random.default_rng(0))
    assert found.count == 64
    assert found.positions.shape == found.normals.shape == found.geometric_normals.shape == found.albedo.shape
    assert found.positions.shape == (64, 8, 3)
    assert found.transfer.shape == (64, 0, 3)
    assert found.positions.dtype == found.albedo.dtype == np.float32
    near = Distance(scene).nearest(found.positions.reshape(-1, 3).astype(float))
    assert near.distance.max() < 1e-6
    expected = np.stack([material.albedo for material in scene.materials])[scene.part[near.face]]
    np.testing.assert_array_equal(found.albedo.reshape(-1, 3), expected)
    assert len(np.unique(expected, axis=0)) == 2


def test_neighbours_are_near_and_on_the_same_side_of_a_thin_plate():
    found = measurement.on_surface(plate(), 64, 8, np.random.default_rng(0))
    assert np.all(np.einsum("msi,mi->ms", found.geometric_normals, found.geometric_normals[:, 0]) > 0)
    away = np.linalg.norm(found.positions - found.positions[:, :1], axis=2)
    # four sides of 4 in area, 64 points
    assert away.max() < 2 * np.sqrt(16 / 64)
    assert np.median(away[:, 1:]) < np.sqrt(16 / 64)
    # the plate and the sheet have two sides each
    sides = found.geometric_normals[:, 0, 1] > 0, found.positions[:, 0, 1] > 0
    for up in (0, 1):
        for high in (0, 1):
            assert 12 <= np.sum((sides[0] == up) & (sides[1] == high)) <= 20
    # hardly any surface point counts for two
    assert len(np.unique(found.positions.reshape(-1, 3), axis=0)) > 0.9 * 64 * 8


def test_groups_are_the_nearest_of_a_cell_and_repeat_where_it_is_small():
    positions = np.array([[0, 0, 0], [0.1, 0, 0], [0.3, 0, 0], [1, 0, 0], [0.9, 0, 0], [0.05, 0, 0]], float)
    normals = np.tile([0.0, 1, 0], (6, 1))
    normals[5] = [0, -1, 0]
    found = measurement.neighbours(positions, normals, np.array([0, 3]), 3, 0.1)
    assert found.tolist() == [[0, 1, 2], [3, 4, 3]]


def test_a_room_is_measured_within_and_where_lights_reach():
    scene = builtin.make("cornell").centred()
    found = measurement.on_surface(scene, 48, 4, np.random.default_rng(0)).positions[:, 0]
    outside = (np.abs(found[:, 0]) > 0.96) | (found[:, 1] < -0.99) | (found[:, 1] > 0.98) | (found[:, 2] < -0.98)
    assert outside.mean() < 0.07
    left = measurement.on_surface(
        scene, 48, 4, np.random.default_rng(0), reached=lambda points: points.positions[:, 0] < 0
    )
    assert left.positions[..., 0].max() < 0


def test_prefixes_and_seeds():
    scene = plate()
    one, same, other = (measurement.on_surface(scene, 40, 2, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.positions, same.positions)
    assert not np.array_equal(one.positions, other.positions)
    few = one.positions[:8, 0].astype(float)
    apart = np.linalg.norm(few[:, None] - few, axis=2) + 9 * np.eye(8)
    apart += np.linalg.norm(one.normals[:8, 0][:, None] - one.normals[:8, 0], axis=2)
    assert apart.min() > 0.6


def test_coincident_points_are_refused():
    found = measurement.on_surface(plate(), 12, 2, np.random.default_rng(0))
    measurement.check(found)
    positions, sides = found.positions.copy(), found.geometric_normals.copy()
    positions[7], sides[7] = positions[3], -sides[3]
    # the same places on the other side are others
    measurement.check(replace(found, positions=positions, geometric_normals=sides))
    sides[7] = sides[3]
    with pytest.raises(PrtnetError, match="found 3 and 7 at the same place"):
        measurement.check(replace(found, positions=positions, geometric_normals=sides))
    positions[2, 0, 0] = np.nan
    with pytest.raises(PrtnetError, match="not finite"):
        measurement.check(replace(found, positions=positions))


def test_more_points_than_there_is_room_for():
    scene, rng = plate(), np.random.default_rng(0)
    for count, match in ((0, "found 0"), (5000, "found 5000, expected 1 to 4096")):
        with pytest.raises(PrtnetError, match=rf"data_driven\.points: {match}"):
            measurement.on_surface(scene, count, 8, rng)
    with pytest.raises(PrtnetError, match=r"data_driven\.supersampling: found 0"):
        measurement.on_hull(scene, 8, 0, rng)
    with pytest.raises(PrtnetError, match="plate: found room for 0 of 8 measurement points"):
        measurement.on_surface(scene, 8, 1, rng, reached=lambda points: np.zeros(len(points.face), bool))


def shells():
    """A ball within a ball, and a sheet that sticks out."""
    outer, inner = trimesh.creation.icosphere(3), trimesh.creation.icosphere(3, radius=0.5)
    fin = np.array([[0.0, 0, 0], [0, 1.5, 0], [0.02, 1.5, 0]])
    parts = [
        Part(f"ball {i}", np.asarray(each.vertices), np.asarray(each.faces), two_sided=True)
        for i, each in enumerate((outer, inner))
    ]
    return assemble("shells", [*parts, Part("fin", fin, np.array([[0, 1, 2]]), two_sided=True)]).centred()


def test_a_hull_is_closed_smooth_and_at_its_distance():
    scene = shells()
    found = hull_of(scene, distance=0.1)
    mesh = trimesh.Trimesh(found.vertices, found.faces)
    assert mesh.is_watertight
    # one surface, outwards: nothing within the balls
    assert mesh.volume > 0
    assert mesh.body_count == 1
    away = Distance(scene).nearest(found.vertices).distance
    assert away.min() > 0.085
    assert away.max() < 0.115
    assert abs(np.median(away) - 0.1) < 0.002
    assert np.all(np.einsum("fi,fi->f", found.face_normals, found.normals[found.faces].mean(axis=1)) > 0.5)
    assert not found.two_sided.any()


def test_what_is_skipped_far_from_a_hull_changes_nothing(monkeypatch):
    found = hull_of(shells(), distance=0.15, resolution=32)
    monkeypatch.setattr(hull, "BLOCK", 1)
    np.testing.assert_allclose(found.vertices, hull_of(shells(), distance=0.15, resolution=32).vertices, atol=1e-6)


def test_points_on_a_hull():
    found = measurement.on_hull(shells(), 60, 8, np.random.default_rng(0))
    assert found.positions.shape == (60, 8, 3)
    np.testing.assert_array_equal(found.albedo, 1)
    # the ball is 0.8 in radius, at the bottom
    low = found.positions[found.positions[..., 1] < 0.2]
    radius = np.linalg.norm(low - [0, -0.2, 0], axis=1)
    assert radius.min() > 0.8
    assert radius.max() < 0.95


def test_hulls_too_near_or_too_far():
    for distance in (0.01, 3.0):
        with pytest.raises(PrtnetError, match=f"hull: found a distance of {distance:g}"):
            hull_of(shells(), distance=distance)
