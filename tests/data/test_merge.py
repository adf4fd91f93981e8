"""Merging by Ward's criterion, against variances that are computed from all points each time."""

import re
from itertools import combinations

import numpy as np
import pytest

from prtnet.data.merge import Merged, merge

LEAVES, POINTS = 6, 300


def scene(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Leaves of points, their transfer, and which leaves touch: a ring with one chord."""
    rng = np.random.default_rng(seed)
    leaf = rng.choice(LEAVES, POINTS, p=rng.dirichlet(np.full(LEAVES, 4)))
    transfer = (rng.normal(size=(LEAVES, 4))[leaf] + rng.normal(size=(POINTS, 4)) + 3).astype(np.float32)
    touching = np.zeros((LEAVES, LEAVES), bool)
    for a, b in [*zip(range(LEAVES), [*range(1, LEAVES), 0], strict=True), (1, 4)]:
        touching[a, b] = touching[b, a] = True
    return leaf, transfer, touching


def merged(seed: int = 0, **options: object) -> Merged:
    leaf, transfer, touching = scene(seed)
    names = [f"cell {index}" for index in range(LEAVES)]
    return merge(leaf, transfer, touching, np.arange(LEAVES), names, **options)  # pyright: ignore[reportArgumentType]


def within(cluster: np.ndarray, transfer: np.ndarray) -> float:
    """Variance within clusters, as a share of the total."""
    exact = transfer.astype(np.float64)
    parts = [exact[cluster == index] for index in np.unique(cluster)]
    return sum(len(part) * part.var(axis=0).sum() for part in parts) / (len(exact) * exact.var(axis=0).sum())


@pytest.mark.parametrize("seed", range(4))
def test_each_merge_is_the_cheapest_of_all_that_touch(seed):
    leaf, transfer, touching = scene(seed)
    groups = [{index} for index in range(LEAVES)]

    def variance(groups: list[set[int]]) -> float:
        return within(np.array([next(i for i, g in enumerate(groups) if each in g) for each in leaf]), transfer)

    for each in merged(seed, networks=1).merges:
        near = [
            (a, b)
            for a, b in combinations(range(len(groups)), 2)
            if touching[np.ix_(list(groups[a]), list(groups[b]))].any()
        ]
        joined = [
            [g for i, g in enumerate(groups) if i not in pair] + [groups[pair[0]] | groups[pair[1]]] for pair in near
        ]
        after = [variance(one) for one in joined]
        assert each.before == pytest.approx(variance(groups), abs=1e-9)
        assert each.after == pytest.approx(min(after), abs=1e-9)
        groups = joined[int(np.argmin(after))]
        assert set(each.kept) | set(each.joined) in groups
    assert len(groups) == 1


def test_it_ends_at_the_networks_that_were_asked_for():
    leaf, transfer, _ = scene()
    for networks in range(1, LEAVES + 1):
        found = merged(networks=networks)
        cluster = np.array(found.cluster)
        # numbered by their first leaves
        _, first = np.unique(cluster, return_index=True)
        assert max(cluster) + 1 == networks == len(first)
        assert (np.diff(first) > 0).all()
        assert found.within == pytest.approx(within(cluster[leaf], transfer), abs=1e-9)
        assert len(found.merges) == LEAVES - networks


def test_it_ends_before_a_merge_that_adds_more_variance_than_was_allowed():
    steps = [each.after - each.before for each in merged(networks=1).merges]
    for limit in (0.0, 0.01, 0.03, 1.0):
        few = next((index for index, step in enumerate(steps) if step > limit), len(steps))
        found = merged(quality=limit)
        assert len(found.merges) == few
        assert ("one cluster is left" if few == len(steps) else f"more than {limit:.2%}") in found.ended
    both = merged(quality=1.0, networks=4)
    assert max(both.cluster) == 3


def test_nothing_is_merged_unless_it_was_asked_for():
    found = merged(least=1000)
    assert found.cluster == tuple(range(LEAVES))
    assert not found.merges


def test_the_reason_of_a_merge_has_its_figures():
    found = merged(networks=5).merges[0]
    figures = [float(each) for each in re.findall(r"([\d.]+)%", found.reason)]
    expected = [found.after - found.before, found.before, found.after]
    np.testing.assert_allclose(figures, 100 * np.array(expected), atol=0.006)
    assert found.reason.startswith(f"cell {found.kept[0]} and cell {found.joined[0]}: ")


def test_clusters_of_too_few_points_are_merged_first_and_whatever_that_costs():
    leaf, _, _ = scene()
    count = np.bincount(leaf, minlength=LEAVES)
    least = int(np.sort(count)[1]) + 1
    found = merged(quality=0.0, least=least)
    assert int(count.argmin()) in found.merges[0].kept + found.merges[0].joined
    sizes = np.bincount(np.array(found.cluster)[leaf])
    assert sizes.min() >= least
    assert all(f"fewer than a network has parameters, {least}" in each.reason for each in found.merges)
    # all of them together are too few as well: one is left, for the caller to refuse
    assert set(merged(quality=0.0, least=POINTS + 1).cluster) == {0}


def test_empty_leaves_go_home_and_make_neighbours_of_those_they_part():
    leaf, transfer = np.repeat([0, 2], 50), np.random.default_rng(0).normal(size=(100, 4)).astype(np.float32)
    touching = np.eye(3, k=1, dtype=bool) | np.eye(3, k=-1, dtype=bool)
    names, home = ["a", "b", "c"], np.array([0, 0, 2])
    assert merge(leaf, transfer, touching, home, names).cluster == (0, 0, 1)
    found = merge(leaf, transfer, touching, home, names, networks=1)
    assert found.cluster == (0, 0, 0)
    assert len(found.merges) == 1


def test_clusters_that_do_not_touch_stay_apart():
    leaf, transfer, _ = scene()
    found = merge(
        leaf, transfer, np.zeros((LEAVES,) * 2, bool), np.arange(LEAVES), list("abcdef"), networks=2, least=99
    )
    assert max(found.cluster) + 1 == LEAVES
    assert "no two of them touch" in found.ended


def test_points_that_are_all_alike_are_merged_for_nothing():
    leaf, transfer, touching = scene()
    flat = np.ones_like(transfer)
    found = merge(leaf, flat, touching, np.arange(LEAVES), list("abcdef"), quality=0.0)
    assert set(found.cluster) == {0}
