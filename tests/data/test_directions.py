import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import directions as sets


@pytest.mark.parametrize("kind", sets.KINDS)
@pytest.mark.parametrize("count", [1, 16, 100, 512])
def test_sets_are_unit_hemispheres_of_the_right_size(kind, count):
    local, weights = sets.local_set(kind, count, np.random.default_rng(0))
    assert len(local) == len(weights) == -(-count // 16) * 16
    np.testing.assert_allclose(np.linalg.norm(local, axis=1), 1, atol=1e-12)
    assert (local[:, 2] > 0).all()
    assert (weights > 0).all()


@pytest.mark.parametrize(("kind", "limit"), list(zip(sets.KINDS, [1e-3, 4e-4, 4e-3, 8e-2], strict=True)))
def test_sets_integrate_the_cosine_lobe(kind, limit):
    """Against A_l Y_i(z). The limits are about twice what is measured."""
    local, weights = sets.local_set(kind, 4096, np.random.default_rng(3))
    lobe = sh.project(np.ones((len(local), 1)), local, weights, 5)[:, 0]
    assert np.abs(lobe - sh.cosine_lobe(np.array([0.0, 0, 1]), 5)).max() < limit


def test_runs_of_sixteen_are_patches():
    local, _ = sets.local_set("cosine_fibonacci", 512, np.random.default_rng(0))
    widths = np.ptp(local[:, :2].reshape(32, 16, 2), axis=1)
    # 32 patches tile the disk of area pi; a square of that area is 0.31 wide
    assert np.median(widths) < 0.45


def test_a_seed_gives_one_set():
    for kind in sets.KINDS:
        first, again = (sets.local_set(kind, 64, np.random.default_rng(5))[0] for _ in range(2))
        np.testing.assert_array_equal(first, again)


def test_bad_requests_are_named():
    with pytest.raises(PrtnetError, match="'sobol'"):
        sets.local_set("sobol", 64, np.random.default_rng(0))
    with pytest.raises(PrtnetError, match="found 0"):
        sets.local_set("random", 0, np.random.default_rng(0))


def test_frames_are_rotations_onto_the_normals():
    rng = np.random.default_rng(1)
    normals = np.concatenate([rng.normal(size=(100, 3)), np.eye(3), -np.eye(3), [[1e-9, 0, 1], [1e-9, 0, -1]]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    frames = sets.frames(sets.turns(normals, rng.random(len(normals)) * 7))
    np.testing.assert_allclose(frames[..., 2], normals, atol=1e-7)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (len(normals), 1, 1)), atol=3e-7)
    np.testing.assert_allclose(np.linalg.det(frames), 1, atol=1e-6)


def test_azimuth_turns_about_the_normal():
    normal = np.array([[0.6, 0, 0.8]])
    still, turned = (sets.frames(sets.turns(normal, np.array([angle])))[0] for angle in (0.0, np.pi / 2))
    np.testing.assert_allclose(turned[:, 0], still[:, 1], atol=1e-7)
