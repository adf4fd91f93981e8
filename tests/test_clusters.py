"""Several nets on one scene: their weights, their blend, their files."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prtnet import PrtnetError, clusters, netspec
from prtnet.clusters import ClusterSpec, Plane, Split
from tests.nets import random_net, random_points, random_texels

# an L of four leaves: x at 0, then z on the right, then y above that
SPLIT = Split((Plane(0, 0.0, -1, 1), Plane(2, 0.25, -2, 2), Plane(1, -0.3, -3, -4)))


def spec(delta: float = 0.1, cluster: tuple[int, ...] = (0, 1, 2, 0), **fields: object) -> ClusterSpec:
    nets = tuple(
        random_net(bands=2, seed=seed, centre=(0.1 * seed, 0.2, -0.1), scale=1.0 + seed)
        for seed in range(max(cluster) + 1)
    )
    return ClusterSpec(SPLIT, cluster, delta, nets, **fields)  # pyright: ignore[reportArgumentType]


# leaf (by its number so far) that is cut, axis, coordinate
cuts = st.lists(st.tuples(st.integers(0, 100), st.integers(0, 2), st.floats(-1, 1)), max_size=6)


def grown(cuts: list[tuple[int, int, float]]) -> Split:
    """A tree by cutting a leaf at a time."""
    planes: list[Plane] = []
    for number, axis, at in cuts:
        index = len(planes)
        leaf = -1 - number % (index + 1)
        for earlier, plane in enumerate(planes):
            below, above = (index if child == leaf else child for child in (plane.below, plane.above))
            planes[earlier] = plane._replace(below=below, above=above)
        planes.append(Plane(axis, at, leaf, -2 - index))
    return Split(tuple(planes))


@given(cuts, st.floats(0, 0.5), st.integers(0, 5))
def test_weights_are_a_partition_of_unity(cuts, delta, seed):
    split = grown(cuts)
    positions, _ = random_points(50, seed)
    rng = np.random.default_rng(seed)
    cluster = tuple(np.unique(rng.integers(0, 3, split.leaves), return_inverse=True)[1].tolist())
    share = clusters.blend(split, cluster, delta, positions)
    assert share.shape == (50, max(cluster) + 1)
    assert (share >= 0).all()
    np.testing.assert_allclose(share.sum(axis=1), 1, rtol=0, atol=1e-14)


@given(cuts, st.integers(0, 5))
def test_far_from_planes_and_without_blending_the_leaf_that_a_walk_finds_has_all_the_weight(cuts, seed):
    split = grown(cuts)
    positions, _ = random_points(30, seed)
    share = clusters.leaf_weights(split, 0.0, positions)
    for position, row in zip(positions.astype(float), share, strict=True):
        node = 0 if split.planes else -1
        while node >= 0:
            plane = split.planes[node]
            node = plane.above if position[plane.axis] >= plane.at else plane.below
        np.testing.assert_array_equal(row, np.eye(split.leaves)[-1 - node])


@pytest.mark.parametrize(("axis", "at", "start"), [(0, 0.0, (0, 0, 0)), (2, 0.25, (1, 1, 0)), (1, -0.3, (1, 0, 1))])
def test_the_blend_meets_each_net_at_delta_and_has_no_jump(axis, at, start):
    made = spec()
    across = np.tile(np.array(start, float), (4001, 1))
    across[:, axis] = at + np.linspace(-0.2, 0.2, 4001)
    normals = np.tile([0.0, 0.6, 0.8], (4001, 1))
    found = clusters.evaluate_unit(made, across, normals)
    share = clusters.weights(made, across)
    assert sorted(share[0]) == [0, 0, 1] == sorted(share[-1])
    assert share[0].argmax() != share[-1].argmax()
    outside = np.abs(across[:, axis] - at) >= 0.1 - 1e-12
    assert (share[outside].max(axis=1) == 1).all()
    assert share[~outside].max(axis=1).min() == pytest.approx(0.5, abs=1e-9)
    # 1e-4 of a way apart: a step would be as large as the nets differ, which is about 1
    assert np.abs(np.diff(found, axis=0)).max() < 0.02
    hard = clusters.evaluate_unit(replace(made, delta=0.0), across, normals)
    assert np.abs(np.diff(hard, axis=0)).max() > 0.2
    np.testing.assert_allclose(found[outside], hard[outside], rtol=0, atol=1e-14)


def test_the_same_net_in_every_cluster_is_that_net():
    positions, normals = random_points(200)
    net = random_net(bands=2, centre=(3.0, 4.0, 5.0), scale=0.5)
    made = replace(spec(), nets=(net,) * 3, centre=net.centre, scale=net.scale)
    expected = netspec.evaluate_unit(net, positions, normals)
    np.testing.assert_allclose(clusters.evaluate_unit(made, positions, normals), expected, rtol=0, atol=1e-6)
    within = replace(made, cluster=(0, 0, 0, 0), nets=(net,))
    np.testing.assert_array_equal(clusters.evaluate_unit(within, positions, normals), expected)


def test_each_net_works_in_its_own_cube():
    """Against the net at file coordinates, which knows nothing of unit ones."""
    made, (positions, normals) = spec(delta=0.0, centre=(10.0, -20.0, 30.0), scale=0.25), random_points(100)
    file = positions.astype(np.float64) / 0.25 + np.array([10.0, -20.0, 30.0])
    share = clusters.weights(made, positions)
    found = clusters.evaluate_unit(made, positions, normals)
    for index, net in enumerate(made.nets):
        here = share[:, index] == 1
        assert here.any()
        np.testing.assert_allclose(netspec.evaluate(net, file[here], normals[here]), found[here], atol=2e-5)


def test_parts_have_hard_borders():
    positions, normals = random_points(60)
    part = np.arange(60) % 4
    made = replace(spec(), split=Split(parts=4), delta=0.3)
    share = clusters.weights(made, positions, part)
    np.testing.assert_array_equal(share.argmax(axis=1), np.array([0, 1, 2, 0])[part])
    assert set(share.ravel()) == {0.0, 1.0}
    assert clusters.evaluate_unit(made, positions, normals, part).shape == (60, 4)
    with pytest.raises(PrtnetError, match="found no parts of the points"):
        clusters.weights(made, positions)


def test_costs_are_those_of_the_nets_that_weigh_something():
    wide = random_net(bands=2, width=16)
    made = replace(spec(), nets=(wide, *spec().nets[1:]))
    first, second = netspec.macs(wide), netspec.macs(made.nets[1])
    share = np.array([[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.25, 0.75]])
    np.testing.assert_array_equal(clusters.macs(made, share), [first, first + second, 2 * second])
    assert clusters.byte_count(made) == sum(map(netspec.byte_count, made.nets))


def test_a_set_comes_back_from_its_folder(tmp_path):
    made = spec(centre=(1.0, 2.0, 3.0), scale=0.1, merges=("cells 0 and 3: alike",))
    table = clusters.save(made, tmp_path / "a")
    assert {file.name for file in (tmp_path / "a").iterdir()} == {
        "clusters.json", "net_00.safetensors", "net_01.safetensors", "net_02.safetensors",
    }  # fmt: skip
    for path in (table, tmp_path / "a"):
        again = clusters.load(path)
        assert (again.split, again.cluster, again.delta) == (made.split, made.cluster, made.delta)
        assert (again.centre, again.scale, again.merges) == (made.centre, made.scale, made.merges)
        positions, normals = random_points(20)
        expected = clusters.evaluate_unit(made, positions, normals)
        np.testing.assert_array_equal(clusters.evaluate_unit(again, positions, normals), expected)
    clusters.save(again, tmp_path / "b")
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()


def test_a_smaller_set_leaves_nothing_of_the_larger_one(tmp_path):
    clusters.save(spec(), tmp_path)
    small = spec(cluster=(0, 0, 0, 0))
    clusters.save(small, tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {"clusters.json", "net_00.safetensors"}
    assert len(clusters.load(tmp_path).nets) == 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 7}, "found format 7"),
        ({"cluster": [0, 1, 3, 0]}, r"found leaves in clusters \[0, 1, 3, 0\] with 3 nets"),
        ({"cluster": [0, 1, 1, 0]}, "each net in use"),
        ({"cluster": [0, 1, 2]}, "expected 4 leaves"),
        ({"delta": -0.5}, "found delta -0.5"),
        ({"delta": "wide"}, "could not convert"),
        ({"scale": 0}, "scale 0"),
        ({"planes": [[0, 0.0, -1, 1], [2, 0.25, -2, 2], [1, -0.3, -3, -3]]}, "expected each other and each leaf once"),
        ({"planes": [[0, 0.0, -1, 2], [2, 0.25, -2, 1], [1, -0.3, -3, -4]]}, "expected planes after"),
        ({"planes": [[5, 0.0, -1, 1], [2, 0.25, -2, 2], [1, -0.3, -3, -4]]}, "an axis of 0, 1 or 2"),
        ({"planes": [[0, 0.0]]}, "unpack"),
        ({"parts": 4}, "found 4 parts and 3 planes"),
        ({"nets": []}, "with 0 nets"),
        ({"nets": [{"file": "net_09.safetensors", "sha256": ""}]}, "found no file net_09.safetensors"),
        ({"nets": [{"file": "../net_00.safetensors", "sha256": ""}]}, "expected one in the same folder"),
        ({"nets": ["net_00.safetensors"]}, "indices must be"),
    ],
)
def test_tables_that_mean_nothing_are_refused(change, message, tmp_path):
    table = clusters.save(spec(), tmp_path)
    table.write_text(json.dumps(json.loads(table.read_text()) | change))
    with pytest.raises(PrtnetError, match=message) as caught:
        clusters.load(tmp_path)
    assert "clusters.json" in str(caught.value)
    assert "export it again" in str(caught.value)


def test_missing_and_edited_files_are_refused(tmp_path):
    table = clusters.save(spec(), tmp_path)
    whole = table.read_text()
    table.write_text(whole[:-40])
    with pytest.raises(PrtnetError, match=r"clusters\.json"):
        clusters.load(tmp_path)
    table.write_text(whole.replace('"delta"', '"wide"'))
    with pytest.raises(PrtnetError, match="no 'delta'"):
        clusters.load(tmp_path)
    table.write_text("[]")
    with pytest.raises(PrtnetError, match=r"clusters\.json"):
        clusters.load(tmp_path)
    table.write_text(whole)
    # a whole net, but another one
    netspec.save(random_net(bands=2, seed=9), tmp_path / "net_01.safetensors")
    with pytest.raises(PrtnetError, match=r"found another net_01\.safetensors than was written"):
        clusters.load(tmp_path)
    (tmp_path / "net_01.safetensors").unlink()
    with pytest.raises(PrtnetError, match=r"found no file net_01\.safetensors"):
        clusters.load(tmp_path)
    with pytest.raises(PrtnetError, match="no such file, expected trained clusters"):
        clusters.load(tmp_path / "elsewhere")


def test_nets_that_do_not_fit_together_are_refused():
    made = spec()
    with pytest.raises(PrtnetError, match=r"found bands, groups \[\(2, 1\), \(3, 1\)\], expected alike"):
        replace(made, nets=(*made.nets[:2], random_net(bands=3)))
    with pytest.raises(PrtnetError, match="nets without texels"):
        replace(made, nets=(*made.nets[:2], random_net(bands=2, texels=(random_texels(2, 2),))))
