"""Principal components of transfer, plain and clustered, against NumPy's SVD and against what they were made of."""

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.models import pca

CLUSTERS, CHANNELS = 4, 12


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def flats(count: int = 3000, elements: int = 2):
    """Points on affine subspaces far from each other, the subspace of each, and areas that differ."""
    draw = rng()
    means = 3 * draw.normal(size=(CLUSTERS, CHANNELS))
    bases = draw.normal(size=(CLUSTERS, elements, CHANNELS))
    cluster = draw.integers(CLUSTERS, size=count)
    points = means[cluster] + np.einsum("pn,pnd->pd", draw.normal(size=(count, elements)), bases[cluster])
    return points.astype(np.float32), cluster, draw.uniform(0.2, 2, count)


def squared(linear: pca.Linear, x: np.ndarray) -> np.ndarray:
    """The error each cluster leaves at each point, "p c": by the definition."""
    rest = x[:, None].astype(np.float64) - linear.means
    inside = np.einsum("pcd,cnd->pcn", rest, linear.bases)
    return np.sum((rest - np.einsum("pcn,cnd->pcd", inside, linear.bases)) ** 2, axis=2)


def test_one_cluster_is_the_weighted_svd():
    x, _, areas = flats()
    found = pca.fit(x, areas, elements=5, rng=rng())
    mean = np.average(x, axis=0, weights=areas)
    _, values, rows = np.linalg.svd(np.sqrt(areas)[:, None] * (x - mean), full_matrices=False)
    np.testing.assert_allclose(found.means[0], mean, atol=1e-5)
    np.testing.assert_allclose(np.abs(np.sum(found.bases[0] * rows[:5], axis=1)), 1, atol=1e-5)
    left = np.sqrt(np.sum(values[5:] ** 2) / areas.sum() / CHANNELS)
    assert pca.rmse(found, x, areas) == pytest.approx(left, rel=1e-4)


@pytest.mark.parametrize("clusters", [1, 3])
def test_rows_are_orthonormal_and_all_of_them_are_exact(clusters):
    x, _, areas = flats(500, CHANNELS)
    found = pca.fit(x, areas, elements=CHANNELS, clusters=clusters, rng=rng())
    gram = np.einsum("cnd,cmd->cnm", found.bases, found.bases)
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(CHANNELS), gram.shape), atol=2e-6)
    np.testing.assert_allclose(pca.decode(found, pca.encode(found, x)), x, atol=2e-5)


def test_clusters_are_found_again():
    x, cluster, areas = flats()
    found = pca.fit(x, areas, elements=2, clusters=CLUSTERS, rng=rng(1))
    assert pca.rmse(found, x, areas) < 1e-5
    own = pca.encode(found, x).cluster
    # the same sets under other numbers
    pairs = np.unique(np.stack([own, cluster], axis=1), axis=0)
    assert len(pairs) == CLUSTERS
    # and no plain PCA of as many vectors comes near
    assert pca.rmse(pca.fit(x, areas, elements=2, rng=rng()), x, areas) > 0.5


@pytest.mark.parametrize("elements", [1, 3])
def test_points_go_to_the_cluster_that_leaves_the_least(elements):
    x, _, areas = flats()
    # far from 0, where squares lose digits
    x = x + np.float32(20)
    found = pca.fit(x, areas, elements=elements, clusters=6, rng=rng())
    expected = squared(found, x)
    cluster, errors = pca.nearest(found, x)
    np.testing.assert_allclose(errors, expected.min(axis=1), atol=1e-3)
    np.testing.assert_allclose(expected[np.arange(len(x)), cluster], expected.min(axis=1), atol=1e-3)


def test_more_vectors_and_more_clusters_never_hurt():
    x, _, areas = flats(600, 6)
    table = np.array(
        [[pca.rmse(pca.fit(x, areas, elements=n, clusters=c, rng=rng()), x, areas) for n in (1, 2, 4, 6)]
         for c in (1, 2, 4, 8)]
    )  # fmt: skip
    assert (np.diff(table, axis=1) < 0).all()
    assert (np.diff(table, axis=0) < 1e-6).all()


def test_areas_count():
    """Two directions: that of the larger area is the one that is kept."""
    x = np.zeros((400, 3), np.float32)
    x[:200, 0], x[200:, 1] = rng().normal(size=200), rng(1).normal(size=200)
    for large, axis in ((slice(0, 200), 0), (slice(200, 400), 1)):
        areas = np.full(400, 1e-3)
        areas[large] = 1
        assert np.abs(pca.fit(x, areas, elements=1, rng=rng()).bases[0, 0]).argmax() == axis
        # drawn from by area as well
        assert np.abs(pca.fit(x, areas, elements=1, rng=rng(), most=50).bases[0, 0]).argmax() == axis


def test_light_on_the_vectors_is_light_on_the_transfer():
    transfer, light = rng().normal(size=(50, 3 * 9)), rng(1).normal(size=(9, 3))
    found = pca.fit(transfer, np.ones(50), elements=6, clusters=3, rng=rng())
    encoded = pca.encode(found, transfer)
    table = pca.lit(found, light, 9, 3)[encoded.cluster]
    received = table[:, 0] + np.einsum("pn,pnc->pc", encoded.weights, table[:, 1:])
    decoded = pca.decode(found, encoded).reshape(50, 3, 9)
    np.testing.assert_allclose(received, np.einsum("pck,kc->pc", decoded, light), atol=1e-5)
    # a light of fewer bands, and one group for all colours
    plain = pca.fit(transfer[:, :9], np.ones(50), elements=4, rng=rng())
    few = pca.encode(plain, transfer[:, :9])
    table = pca.lit(plain, light[:4], 9)[0]
    expected = pca.decode(plain, few)[:, :4] @ light[:4]
    np.testing.assert_allclose(table[0] + few.weights @ table[1:], expected, atol=1e-5)


def test_the_unoccluded_lobe_has_few_dimensions():
    """Band l of a cosine lobe is A_l Y_l(n), and A_3 = 0: of 16 coefficients 1 + 3 + 5 count, and the first is the
    mean."""
    normals = rng().normal(size=(4000, 3))
    lobes = sh.cosine_lobe(normals / np.linalg.norm(normals, axis=1, keepdims=True), 4)
    found = pca.fit(lobes, np.ones(4000), elements=8, rng=rng())
    assert pca.rmse(found, lobes, np.ones(4000)) < 1e-6
    assert pca.rmse(pca.fit(lobes, np.ones(4000), elements=7, rng=rng()), lobes, np.ones(4000)) > 1e-2


def test_a_cluster_of_one_point_has_no_vectors():
    x = np.concatenate([np.zeros((50, 4)), np.full((1, 4), 9.0)]).astype(np.float32)
    found = pca.fit(x, np.ones(51), elements=2, clusters=2, rng=rng())
    assert not found.bases.any()
    np.testing.assert_array_equal(pca.decode(found, pca.encode(found, x)), x)
    # more clusters than there are different points
    many = pca.fit(x, np.ones(51), elements=2, clusters=8, rng=rng())
    np.testing.assert_array_equal(pca.decode(many, pca.encode(many, x)), x)


def test_errors():
    x, areas = np.zeros((4, 9), np.float32), np.ones(4)
    with pytest.raises(PrtnetError, match=r"linear\.elements: found 10, expected 1 to 9"):
        pca.fit(x, areas, elements=10, rng=rng())
    with pytest.raises(PrtnetError, match=r"linear\.clusters: found 0, expected 1 to 4096"):
        pca.fit(x, areas, elements=2, clusters=0, rng=rng())
    with pytest.raises(PrtnetError, match=r"linear\.clusters: found 5 for 4 points"):
        pca.fit(x, areas, elements=2, clusters=5, rng=rng())
    with pytest.raises(PrtnetError, match="4 points without area"):
        pca.fit(x, 0 * areas, elements=2, rng=rng())
