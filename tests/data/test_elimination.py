"""Sample elimination: spacing on planes, thin strips and sheets, and of prefixes."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from prtnet import PrtnetError
from prtnet.data import elimination

UP = np.array([0.0, 1, 0])


def sheet(count, rng, sides=2, width=1.0):
    """Points on a flat sheet of unit length, and its area."""
    side = rng.choice([1.0, -1.0][:sides], count)
    points = rng.random((count, 3)) * [1, 0, width]
    return points, side[:, None] * UP, sides * width


def spacing(points, count, area):
    """Least distance between points, over that of the densest possible arrangement of so many."""
    return KDTree(points).query(points, 2)[0][:, 1].min() / np.sqrt(2 * area / (np.sqrt(3) * count))


@pytest.mark.parametrize("sides", [1, 2])
def test_points_and_their_prefixes_are_blue_noise_on_each_side(sides):
    rng = np.random.default_rng(0)
    points, normals, area = sheet(2400, rng, sides)
    kept = elimination.eliminate(points, normals, 300, area)
    assert len(set(kept)) == 300
    for count in (300, 200, 150, 64, 20):
        first = kept[:count]
        for side in (1.0, -1.0)[:sides]:
            here = normals[first][:, 1] == side
            assert abs(here.sum() * sides / count - 1) < 0.3
            # a prefix that is no half of a half has some of the next points already
            least = 0.58 if count in (300, 150) else 0.4
            assert spacing(points[first][here], count, area) > least
    # by chance
    assert spacing(points[:300], 300, area) < 0.2


def test_thin_strips_are_covered_evenly():
    """Where weight limiting is the usual 0.65, points nearly meet; without the longer reach there are gaps."""
    points, normals, area = sheet(2048, np.random.default_rng(1), width=0.004)
    kept = elimination.eliminate(points, normals, 256, area)
    for count in (256, 64, 37):
        for side in (1.0, -1.0):
            along = np.sort(points[kept[:count]][normals[kept[:count]][:, 1] == side, 0])
            gaps = np.diff(along) * len(along)
            assert gaps.min() > 0.3
            assert gaps.max() < 2.7
    limited = elimination.eliminate(points, normals, 256, area, beta=0.65)
    assert KDTree(points[limited]).query(points[limited], 2)[0][:, 1].min() * 128 < 0.05


def test_things_that_fill_their_box_are_spread_as_in_a_volume():
    points = np.random.default_rng(2).random((1600, 3))
    radius = elimination.largest_radius(200, 1000.0, np.ones(3))
    # cubic cells of the box and its rim, and the densest packing of spheres
    cubic = (1 + 2 * radius) / 200 ** (1 / 3) / 2
    assert cubic < radius == pytest.approx(cubic * 2 ** (1 / 6))
    kept = elimination.eliminate(points, np.tile(UP, (1600, 1)), 200, 1000.0)
    for count in (200, 100):
        assert KDTree(points[kept[:count]]).query(points[kept[:count]], 2)[0][:, 1].min() > 0.6 / count ** (1 / 3)
    assert elimination.largest_radius(200, 0.1, np.ones(3)) == pytest.approx(np.sqrt(0.1 / (2 * np.sqrt(3) * 200)))


@pytest.mark.parametrize("reach", [0.03, 0.2, 5.0])
def test_near_pairs_are_all_of_them_once(reach):
    points = np.random.default_rng(3).normal(size=(300, 6)) * [1, 1, 0.01, 0.1, 0.1, 0.1]
    found = {tuple(sorted(pair)) for pair in np.stack(elimination.near_pairs(points, reach), axis=1).tolist()}
    assert found == KDTree(points).query_pairs(reach)
    assert len(elimination.near_pairs(points, reach)[0]) == len(found)


def test_edges():
    points, normals, area = sheet(5, np.random.default_rng(4))
    assert sorted(elimination.eliminate(points, normals, 5, area)) == [0, 1, 2, 3, 4]
    assert len(elimination.eliminate(points, normals, 1, area)) == 1
    for count in (0, 6):
        with pytest.raises(PrtnetError, match=f"found 5 points, expected at least the {count} to keep"):
            elimination.eliminate(points, normals, count, area)
