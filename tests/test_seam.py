"""The seam metric against pictures whose seams are known."""

import numpy as np
import pytest

from prtnet import PrtnetError, seam
from prtnet.seam import Surface

SIDE = 48


def floor(side: int = SIDE) -> tuple[np.ndarray, np.ndarray]:
    """A plane seen from above, x to the right and z down."""
    x, z = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side))
    positions = np.stack([x, np.zeros_like(x), z], axis=-1)
    return positions, np.broadcast_to([0.0, 1.0, 0.0], positions.shape)


def halves(border: int = SIDE // 2) -> Surface:
    positions, normals = floor()
    cluster = np.zeros((SIDE, SIDE), int)
    cluster[:, border:] = 1
    return Surface(positions, normals, cluster)


def rough(seed: int = 0) -> np.ndarray:
    return 0.01 * np.random.default_rng(seed).normal(size=(SIDE, SIDE, 3))


def seams_of(error: np.ndarray, view: Surface) -> seam.Seams:
    return seam.measure({"net": [error]}, [view])["net"]


def test_an_error_that_knows_no_clusters_has_a_ratio_of_one():
    assert seams_of(rough(), halves()).worst == pytest.approx(1, abs=0.15)
    x = np.linspace(0, 1, SIDE)
    slope = np.broadcast_to((0.3 * x**2)[None, :, None], (SIDE, SIDE, 3))
    assert seams_of(slope, halves()).worst == pytest.approx(1, abs=0.1)


def test_no_error_has_no_seam():
    found = seams_of(np.zeros((SIDE, SIDE, 3)), halves())
    assert (found.worst, found.mean) == (1, 1)


def test_a_planted_step_is_the_height_of_the_step():
    error = rough()
    error[:, SIDE // 2 :] += 0.2
    (border,) = seams_of(error, halves()).borders
    assert border.clusters == (0, 1)
    assert border.pairs == SIDE
    assert border.across == pytest.approx(0.2, rel=0.05)
    # the mean difference of two normal numbers of standard deviation s is 2 s / sqrt(pi)
    assert border.beside == pytest.approx(0.02 / np.sqrt(np.pi), rel=0.05)
    assert border.ratio == pytest.approx(border.across / border.beside, rel=1e-3)
    # a step elsewhere is roughness, and so is one far away
    assert seams_of(error, halves(SIDE // 2 - 5)).worst < 0.7
    assert seams_of(error, halves(SIDE // 4 - 4)).worst == pytest.approx(1, abs=0.2)


def test_the_worst_border_is_named_and_the_mean_is_by_length():
    view = halves()
    view.cluster[SIDE * 3 // 4 :] = 2
    error = rough()
    error[SIDE * 3 // 4 :] += 0.1
    found = seams_of(error, view)
    ratios = {border.clusters: border.ratio for border in found.borders}
    assert set(ratios) == {(0, 1), (0, 2), (1, 2)}
    assert ratios[0, 1] == pytest.approx(1, abs=0.2)
    assert min(ratios[0, 2], ratios[1, 2]) > 5
    assert found.worst == max(ratios.values())
    pairs = {border.clusters: border.pairs for border in found.borders}
    assert found.mean == pytest.approx(sum(ratios[key] * pairs[key] for key in ratios) / sum(pairs.values()))


def test_views_are_taken_together():
    error = rough()
    error[:, SIDE // 2 :] += 0.2
    both = seam.measure({"net": [error, rough(1)]}, [halves(), halves()])["net"]
    assert both.borders[0].pairs == 2 * SIDE
    assert both.borders[0].across == pytest.approx(0.1, rel=0.1)


def test_edges_and_gaps_are_no_borders():
    """Where the clusters meet at a fold, behind an outline, or at a hole, a jump is nobody's fault."""
    error, view = rough(), halves()
    error[:, SIDE // 2 :] += 0.2
    turned, lifted, holed = (np.array(view.normals), np.array(view.positions), np.array(view.cluster))
    turned[:, SIDE // 2 :] = [1.0, 0.0, 0.0]
    lifted[:, SIDE // 2 :, 1] = -1
    holed[:, SIDE // 2] = -1
    for other in (
        Surface(view.positions, turned, view.cluster),
        Surface(lifted, view.normals, view.cluster),
        Surface(view.positions, view.normals, holed),
    ):
        found = seams_of(error, other)
        assert found.borders == ()
        assert found.worst is None
        assert found.mean is None


def test_facts_are_plain():
    (border,) = seams_of(rough(), halves()).facts()["borders"]
    assert set(border) == {"clusters", "pairs", "across", "beside", "ratio"}


def test_pictures_of_another_size_are_refused():
    with pytest.raises(PrtnetError, match=r"seams of net: found images of \[\(4, 4\)\], expected \[\(48, 48\)\]"):
        seams_of(np.zeros((4, 4, 3)), halves())
