"""Data-driven transfer: the identities of basis and operator, their file, their refusals."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from prtnet import PrtnetError, data_driven, store
from prtnet.data_driven import DataDriven, Measurement
from prtnet.models.data_driven import Learned, Pairs, basis_of, learn, projected, ridge_of
from prtnet.pipeline.data_driven.errors import errors

POINTS, TEXELS, LIGHTS = 24, 150, 30


def pairs(rng: np.random.Generator, *, lights: int = LIGHTS, hidden: int = 6) -> Pairs:
    """Lights of a few degrees of freedom through a linear transport that differs between colours."""
    weights = rng.random((lights, hidden, 3))
    direct = np.einsum("mh,chk->cmk", rng.random((POINTS, hidden)), weights)
    lightmaps = np.einsum("th,hk,chk->ctk", rng.random((TEXELS, hidden)), rng.random((hidden, 3)), weights)
    return Pairs(lightmaps.astype(np.float32), direct.astype(np.float32))


def spec_of(found: Learned, *, gamma: float = 1.0) -> DataDriven:
    rng = np.random.default_rng(3)
    vectors = rng.random((3, POINTS, 2, 3)).astype(np.float32)
    places = Measurement(*vectors, np.ones((POINTS, 2, 3), np.float32), np.zeros((POINTS, 0, 3), np.float32))
    return DataDriven(
        found.basis,
        found.matrices,
        (places,) * len(found.matrices),
        np.arange(5, 5 + TEXELS, dtype=np.int32),
        16,
        "a scene",
        gamma,
    )


@pytest.fixture(scope="module")
def made() -> Pairs:
    return pairs(np.random.default_rng(0))


@pytest.mark.parametrize("channels", ["shared", "separate"])
def test_an_element_more_never_raises_the_error_on_what_was_learned(made, channels):
    found = [
        errors(one.basis, one.matrices, made.lightmaps, made.direct)
        for one in (learn(made, elements=n, ridge=0.05, channels=channels) for n in (1, 2, 4, 6))
    ]
    assert np.all(np.diff([each.rmse for each in found]) <= 1e-9)
    assert all(each.projection <= each.rmse * (1 + 1e-9) for each in found)
    assert found[0].rmse > 1.2 * found[-1].rmse
    assert found[0].projection > 1e4 * found[-1].projection


def test_a_light_of_the_database_gives_its_lightmap_to_the_projection(made):
    """With as many elements as the lights have degrees of freedom both are exact."""
    found = learn(made, elements=6, ridge=1e-9, channels="separate")
    spec = spec_of(found)
    for light in (0, 7):
        shown = data_driven.indirect(spec, made.direct[light])
        np.testing.assert_allclose(shown, made.lightmaps[light], atol=2e-4 * np.abs(made.lightmaps).max())
    few = learn(made, elements=3, ridge=1e-9, channels="separate")
    nearest = projected(few.basis, made.lightmaps[:1], 1.0)[0]
    shown = data_driven.indirect(spec_of(few), made.direct[0])
    assert np.abs(shown - nearest).max() < 1e-3 * np.abs(nearest).max() < np.abs(shown - made.lightmaps[0]).max()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.01, 100), st.floats(0.01, 100))
def test_the_operator_is_linear_to_rounding(seed, first, second):
    rng = np.random.default_rng(seed)
    spec = spec_of(learn(pairs(np.random.default_rng(0)), elements=5, ridge=0.01))
    a, b = rng.random((2, POINTS, 3))
    together = data_driven.indirect(spec, first * a + second * b)
    apart = first * data_driven.indirect(spec, a) + second * data_driven.indirect(spec, b)
    np.testing.assert_allclose(together, apart, rtol=1e-9, atol=1e-9 * np.abs(together).max())
    assert not data_driven.indirect(spec, np.zeros((POINTS, 3))).any()


def test_the_basis_is_orthonormal_and_its_projection_is_that_of_an_svd(made):
    y = made.lightmaps[..., 0].astype(np.float64)
    basis, coefficients = basis_of(y, 4)
    np.testing.assert_allclose(basis @ basis.T, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(coefficients, basis @ y.T, atol=1e-12)
    mean = y.mean(axis=0) / np.linalg.norm(y.mean(axis=0))
    np.testing.assert_allclose(basis[0], mean, atol=1e-12)
    left = np.linalg.svd(y - np.outer(y @ mean, mean), compute_uv=False)[3:]
    assert np.linalg.norm(y - (basis.T @ coefficients).T) == pytest.approx(np.linalg.norm(left), rel=1e-6)


@pytest.mark.parametrize("columns", [10, 40])
def test_ridge_is_that_of_the_normal_equations(columns):
    """M minimises |C - M D|^2 + lambda |M|^2, by an independent solver of the stacked system."""
    rng = np.random.default_rng(1)
    c, direct, ridge = rng.normal(size=(3, columns)), rng.normal(size=(20, columns)), 0.3
    stacked = np.concatenate([direct.T, np.sqrt(ridge) * np.eye(20)])
    expected = np.linalg.lstsq(stacked, np.concatenate([c.T, np.zeros((20, 3))]), rcond=None)[0].T
    np.testing.assert_allclose(ridge_of(c, direct, ridge), expected, atol=1e-10)


def test_a_gamma_space_is_exact_where_transport_is_a_power_of_light():
    rng = np.random.default_rng(2)
    made = pairs(rng)
    curved = Pairs(made.lightmaps**2.2, made.direct**2.2)
    found = learn(curved, elements=6, ridge=1e-9, channels="separate", gamma=2.2)
    shown = data_driven.indirect(spec_of(found, gamma=2.2), curved.direct[3])
    np.testing.assert_allclose(shown, curved.lightmaps[3], rtol=5e-3, atol=1e-4 * curved.lightmaps.max())


def test_keyframes_have_a_matrix_each_or_one_for_all(made):
    keyframe = np.arange(LIGHTS) % 2
    turned = made.lightmaps.copy()
    turned[keyframe == 1] = turned[keyframe == 1][:, ::-1]
    moved = Pairs(turned, made.direct, keyframe)
    options = {"elements": 12, "ridge": 1e-9, "channels": "separate"}
    each, one = (learn(moved, matrices=words, **options) for words in ("each", "one"))
    assert (len(each.matrices), len(one.matrices)) == (2, 1)
    shared = np.broadcast_to(one.matrices, each.matrices.shape)
    nearer, further = (
        errors(found.basis, matrices, moved.lightmaps, moved.direct, keyframe=keyframe).rmse
        for found, matrices in ((each, each.matrices), (one, shared))
    )
    assert nearer < 1e-3 * further


def test_the_file_reads_back(made, tmp_path):
    spec = spec_of(learn(made, elements=4, ridge=0.01, channels="separate"))
    data_driven.save(spec, tmp_path / "kept.safetensors")
    found = data_driven.load(tmp_path / "kept.safetensors")
    for name in ("basis", "matrices", "texels"):
        np.testing.assert_array_equal(getattr(found, name), getattr(spec, name))
    np.testing.assert_array_equal(found.measurements[0].positions, spec.measurements[0].positions)
    assert (found.size, found.scene, found.gamma, found.quantity) == (16, "a scene", 1.0, "irradiance")
    image = data_driven.image(found, data_driven.indirect(found, made.direct[0]))
    assert image.shape == (16, 16, 3)
    assert image.reshape(-1, 3)[5].any()
    assert not image.reshape(-1, 3)[:5].any()


def test_refusals(made, tmp_path):
    with pytest.raises(PrtnetError, match=r"found 3 configurations for 4 elements"):
        learn(Pairs(made.lightmaps[:1], made.direct[:1]), elements=4, ridge=0.01)
    with pytest.raises(PrtnetError, match=r"only \d+ independent lightmaps for 29 elements"):
        learn(made, elements=29, ridge=0.01)
    with pytest.raises(PrtnetError, match=r"no light at any measurement point"):
        learn(Pairs(made.lightmaps, np.zeros_like(made.direct)), elements=4, ridge=0.01)
    spec = spec_of(learn(made, elements=4, ridge=0.01))
    with pytest.raises(PrtnetError, match=r"found 3 measurements, expected 24"):
        data_driven.indirect(spec, np.ones((3, 3)))
    store.save_arrays(tmp_path / "other.safetensors", {"a": np.zeros(3)})
    with pytest.raises(PrtnetError, match=r"other\.safetensors: found no data-driven transfer"):
        data_driven.load(tmp_path / "other.safetensors")


def test_configurations_that_light_no_point_are_left_out(made):
    dark = made.direct.copy()
    dark[2] = 0
    found = learn(Pairs(made.lightmaps, dark), elements=3, ridge=0.01)
    assert (found.used, found.dark) == (3 * (LIGHTS - 1), 3)


def test_lights_that_points_all_but_miss_are_left_out(made):
    missed = made.direct.copy()
    missed[2] *= 1e-3
    found = learn(Pairs(made.lightmaps, missed), elements=3, ridge=0.01)
    rest = np.arange(LIGHTS) != 2
    plain = learn(Pairs(made.lightmaps[rest], made.direct[rest]), elements=3, ridge=0.01)
    assert (found.used, found.dark) == (3 * (LIGHTS - 1), 3)
    assert np.allclose(found.basis, plain.basis, atol=1e-6)
    assert np.allclose(found.matrices, plain.matrices, atol=1e-5)
