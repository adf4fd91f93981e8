import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data.implicit.surface_error import surface_error
from prtnet.data.part import Part
from prtnet.data.scene import Frame, assemble
from prtnet.data.shapes import box, ellipsoid, merge
from prtnet.data.signed_distance import Distance
from prtnet.models import neural_sdf


@pytest.fixture(autouse=True)
def few_points(monkeypatch):
    monkeypatch.setattr(neural_sdf, "POINTS", 1 << 13)
    monkeypatch.setattr("prtnet.data.implicit.surface_error.RESOLUTION", 40)


def distance_to(surface):
    return Distance(assemble("egg", [Part("egg", surface.vertices, surface.faces)]))


@pytest.fixture(scope="module")
def egg():
    return distance_to(ellipsoid([0.5, 1, 0.7], 48))


def fitted(distance, steps, width=16, depth=1, seed=0, **fields):
    return neural_sdf.fit(distance, width=width, depth=depth, steps=steps, seed=seed, **fields).field


def test_training_points_have_distances_and_their_gradients(egg):
    found = neural_sdf.shells(egg, 4000, np.random.default_rng(0))
    np.testing.assert_allclose(np.linalg.norm(found.gradients, axis=1), 1, atol=1e-5)
    assert 0.3 < np.mean(np.abs(found.distances) < 0.02) < 0.8
    half = neural_sdf.box_of(egg)
    np.testing.assert_allclose(half, (0.6, 1.1, 0.8), atol=1e-9)
    assert (np.abs(found.positions) <= np.float32(half)).all()
    # a step along the gradient shortens or lengthens the way by as much
    far = np.abs(found.distances) > 0.05
    step = found.positions[far] - 0.04 * np.sign(found.distances[far, None]) * found.gradients[far]
    moved = egg.nearest(step).distance
    np.testing.assert_allclose(moved, np.abs(found.distances[far]) - 0.04, atol=1e-5)


def test_the_inside_of_overlapping_parts_is_no_surface():
    pair = merge([box([-1, -0.5, -0.5], [0.2, 0.5, 0.5]), box([-0.2, -0.3, -0.3], [1, 0.3, 0.3])])
    found = neural_sdf.shells(distance_to(pair), 4000, np.random.default_rng(0))
    on = np.abs(found.distances) < 1e-6
    assert on.sum() > 500
    # the two walls within stand at x = 0.2 and x = -0.2
    walls = on & (np.abs(np.abs(found.positions[:, 0]) - 0.2) < 1e-3)
    assert walls.sum() > 10
    assert not (walls & (np.abs(found.positions[:, 1:]).max(axis=1) < 0.29)).any()


def test_a_fit_is_near_the_surface_and_knows_its_slope(egg):
    frame = Frame(np.array([1.0, 2, 3]), 0.5)
    field = fitted(egg, 250, frame=frame)
    error = surface_error(field, egg, np.random.default_rng(1), count=2000)
    assert 0 < error.chamfer < 0.005
    assert error.chamfer < error.worst < 0.03
    assert error.wrong_sign < 0.02
    assert error.deviation < 0.2
    points = np.random.default_rng(2).uniform(-1, 1, (20_000, 3)) * np.array(field.half)
    assert 1 <= np.linalg.norm(field.gradient(points), axis=1).max() < field.lipschitz < 2.5
    assert field.frame is frame


def test_the_same_seed_gives_the_same_network(egg):
    first, again, other = (fitted(egg, 40, seed=seed).digest() for seed in (3, 3, 4))
    assert first == again != other


def test_a_network_without_a_surface_is_refused(egg, monkeypatch):
    # a constant
    monkeypatch.setattr(neural_sdf, "FIRST", 0.0)
    monkeypatch.setattr(neural_sdf, "MATRIX_RATE", 0.0)
    with pytest.raises(PrtnetError, match=r"the fit of egg found no surface in 5 steps: all distances.*raise sdf"):
        fitted(egg, 5)


def test_a_fit_that_diverges_is_stopped(egg, monkeypatch):
    monkeypatch.setattr(neural_sdf, "OVER", float("nan"))
    with pytest.raises(PrtnetError, match=r"the fit of egg diverged at step 0 of 5.*sdf\.seed"):
        fitted(egg, 5)
