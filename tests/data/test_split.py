"""Trees of planes: cells, parts, and so many leaves of the same area."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prtnet import PrtnetError
from prtnet.clusters import Split
from prtnet.data import builtin, samples, split
from tests.nets import random_points

sides = st.integers(1, 4)
LOW, HIGH = np.array([-1.0, -0.5, -0.8]), np.array([1.0, 0.7, 0.4])


@pytest.fixture(scope="module")
def room():
    return builtin.make("room", tessellation=0.5).centred()


@given(sides, sides, sides)
def test_a_grid_has_equal_cells_that_are_counted_x_first(x, y, z):
    made, cells = split.grid(LOW, HIGH, (x, y, z)), np.array([x, y, z])
    assert made.leaves == x * y * z
    positions = LOW + (HIGH - LOW) * (random_points(60)[0].astype(float) + 1) / 2
    place = np.floor((positions - LOW) / (HIGH - LOW) * cells).astype(int)
    found = split.leaf_of(made, positions, np.zeros(60, int))
    np.testing.assert_array_equal(found, place @ np.array([1, x, x * y]))


def test_the_boxes_of_cells_fill_the_box_of_the_scene_and_hold_their_points(room):
    points = samples.area_uniform(room, 3000, np.random.default_rng(0))
    for made in (split.grid(LOW, HIGH, (3, 2, 2)), split.by_count(points.positions, 7), Split()):
        boxes, leaf = split.boxes(made, room), split.leaf_of(made, points.positions, np.zeros(3000, int))
        volume = np.ptp(room.vertices, axis=0).prod()
        assert np.ptp(boxes, axis=1).prod(axis=1).sum() == pytest.approx(volume)
        inside = (points.positions >= boxes[leaf, 0] - 1e-9) & (points.positions <= boxes[leaf, 1] + 1e-9)
        assert inside.all()


def test_the_boxes_of_parts_are_those_of_their_triangles(room):
    made = Split(parts=len(room.materials) + 1)
    boxes = split.boxes(made, room)
    for part in range(len(room.materials)):
        corners = room.vertices[room.faces[room.part == part]].reshape(-1, 3)
        np.testing.assert_array_equal(boxes[part], [corners.min(axis=0), corners.max(axis=0)])
    assert np.isinf(boxes[-1]).all()
    np.testing.assert_array_equal(split.leaf_of(made, room.vertices[:5], np.arange(5)), np.arange(5))


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 13])
def test_so_many_leaves_hold_as_many_points_each(count, room):
    points = samples.area_uniform(room, 4000, np.random.default_rng(1)).positions
    made = split.by_count(points, count)
    assert made.leaves == count
    found = np.bincount(split.leaf_of(made, points, np.zeros(4000, int)), minlength=count)
    # walls stand in planes, whose points all fall on one side of a cut through them
    assert np.abs(found - 4000 / count).max() <= 0.02 * 4000
    assert split.by_count(points, count) == made


def test_the_first_cut_is_across_the_longest_axis():
    points = random_points(501)[0] * np.array([0.1, 0.2, 1.0], np.float32)
    plane = split.by_count(points, 2).planes[0]
    assert plane.axis == 2
    assert plane.at == pytest.approx(np.median(points[:, 2]), abs=0.02)


def brute(boxes: np.ndarray, first: int, second: int) -> bool:
    """A face in common: the boxes grown a little overlap on all axes, shrunk a little on two."""
    grown, shrunk = ((boxes[:, 0] - by, boxes[:, 1] + by) for by in (1e-4, -1e-4))
    over = [(np.minimum(h[first], h[second]) > np.maximum(lo[first], lo[second])).sum() for lo, h in (grown, shrunk)]
    return over == [3, 2]


def test_cells_touch_by_faces_and_not_by_edges(room):
    points = samples.area_uniform(room, 2000, np.random.default_rng(2)).positions
    low, high = split.boxes(Split(), room)[0]
    for made in (split.grid(low, high, (3, 2, 2)), split.by_count(points, 9)):
        boxes = split.boxes(made, room)
        near = split.touching(made, boxes)
        expected = [[a != b and brute(boxes, a, b) for b in range(made.leaves)] for a in range(made.leaves)]
        np.testing.assert_array_equal(near, expected)


def test_boxes_of_parts_touch_by_edges_too_and_cells_of_a_flat_scene_by_their_sides():
    boxes = np.array([[[0, 0, 0], [1, 1, 1]], [[1.005, 1, 0], [2, 2, 1]], [[2.02, 0, 0], [3, 1, 1]]])
    near = split.touching(Split(parts=3), boxes)
    np.testing.assert_array_equal(near, [[False, True, False], [True, False, False], [False] * 3])
    assert split.touching(Split(parts=2), np.array([[[0, 0, 0], [1, 1, 1]], [[0.2] * 3, [0.8] * 3]])).any()
    made = split.grid(np.zeros(3), np.array([1.0, 0.0, 1.0]), (2, 1, 2))
    flat = np.array([[[x, 0, z], [x + 0.5, 0, z + 0.5]] for z in (0, 0.5) for x in (0, 0.5)])
    np.testing.assert_array_equal(split.touching(made, flat), 1 - np.eye(4) - np.eye(4)[::-1])


def test_leaves_without_points_go_to_the_nearest_that_has_some():
    boxes = np.array([[[x, 0, 0], [x + 1, 1, 1]] for x in range(5)] + [[[np.inf] * 3, [-np.inf] * 3]], float)
    occupied = np.array([False, True, False, False, True, False])
    np.testing.assert_array_equal(split.nearest(boxes, occupied), [1, 1, 1, 4, 4, 1])


@pytest.mark.parametrize("count", [0, 11])
def test_counts_that_no_points_fill_are_refused(count):
    with pytest.raises(PrtnetError, match=f"split.count: found {count}, expected 1 to 10"):
        split.by_count(random_points(10)[0], count)
