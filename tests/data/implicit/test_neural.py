import json

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save_file

from prtnet import PrtnetError
from prtnet.data.implicit import neural
from prtnet.data.implicit.field import Field
from prtnet.data.implicit.march import evaluated, walked
from prtnet.data.implicit.neural import METADATA_KEY, Neural
from prtnet.data.scene import Frame
from tests.neural_fields import random_field, waves

RNG = np.random.default_rng(11)
# in the box and around it
POINTS = RNG.uniform(-2, 2, (3000, 3))
FIELD = random_field(half=(1.1, 0.7, 1.2), lipschitz=2.5, frame=Frame(np.array([1.5, -2, 1e6]), 0.3))


def test_it_is_a_field():
    assert isinstance(FIELD, Field)
    assert (FIELD.part(POINTS) == 0).all()


def test_the_gradient_is_that_of_differences():
    step = 1e-5
    differences = [
        (FIELD.distance(POINTS + step * axis) - FIELD.distance(POINTS - step * axis)) / (2 * step) for axis in np.eye(3)
    ]
    np.testing.assert_allclose(FIELD.gradient(POINTS), np.stack(differences, axis=1), atol=1e-6)


def test_outside_of_its_box_it_is_continuous_and_no_steeper():
    half = np.array(FIELD.half)
    face = np.clip(POINTS, -half, half)
    outside = (face != POINTS).any(axis=1)
    assert 0.5 < outside.mean() < 1
    beyond = FIELD.distance(face + 1e-7 * (POINTS - face))[outside]
    np.testing.assert_allclose(beyond, np.abs(FIELD.distance(face))[outside], atol=1e-5)
    slopes = np.linalg.norm(FIELD.gradient(POINTS), axis=1)
    along = np.linalg.norm(FIELD.gradient(face), axis=1)
    assert (slopes <= np.maximum(along, 1) + 1e-9)[outside].all()


def test_outside_of_its_box_it_never_claims_more_than_the_distance():
    # a ball of radius 1/2 as its exact distance, in a box about it: the claim at p is made at the clamped point
    half, radius = np.array([0.6, 0.7, 0.8]), 0.5
    face = np.clip(POINTS, -half, half)
    claimed = np.hypot(np.linalg.norm(POINTS - face, axis=1), np.linalg.norm(face, axis=1) - radius)
    outside = (face != POINTS).any(axis=1)
    assert (claimed <= np.linalg.norm(POINTS, axis=1) - radius + 1e-12)[outside].all()


def test_the_compiled_form_gives_the_same_numbers():
    points = POINTS.astype(np.float32)
    np.testing.assert_allclose(evaluated(FIELD, points), FIELD.distance(points), atol=1e-5)


@pytest.mark.parametrize("field", [FIELD, random_field(5, 1), random_field(8, 3)], ids=["13 x 2", "5 x 1", "8 x 3"])
def test_the_text_gives_the_same_numbers_without_a_compiler(field):
    names = {"np": np, "F": np.float32, "sin": np.sin, "sqrt": np.sqrt, "FAST": True, "njit": lambda **_: lambda f: f}
    exec(field.source(), names)
    points = POINTS[:20].astype(np.float32)
    found = [names["distance"](*point) for point in points]  # pyright: ignore[reportCallIssue]
    np.testing.assert_allclose(found, field.distance(points), atol=1e-5)


def test_a_file_gives_back_the_field(tmp_path):
    path = tmp_path / "neural_sdf.safetensors"
    neural.save(FIELD, path)
    again = neural.load(path)
    assert again.digest() == FIELD.digest()
    assert (again.half, again.lipschitz, again.frame.scale) == (FIELD.half, FIELD.lipschitz, FIELD.frame.scale)
    assert again.frame.centre.tolist() == FIELD.frame.centre.tolist()
    np.testing.assert_array_equal(again.distance(POINTS[:50]), FIELD.distance(POINTS[:50]))
    first = path.read_bytes()
    neural.save(again, path)
    assert path.read_bytes() == first


@pytest.mark.parametrize("change", ["weight", "lipschitz", "scale"])
def test_altered_files_are_refused(tmp_path, change):
    path = tmp_path / "field.safetensors"
    neural.save(FIELD, path)
    with safe_open(path, framework="numpy") as file:
        words, tensors = json.loads(file.metadata()[METADATA_KEY]), {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    if change == "weight":
        tensors["layer.1.weight"][0, 0] += 1e-3
    else:
        words[change] *= 0.5
    save_file(tensors, path, {METADATA_KEY: json.dumps(words)})
    with pytest.raises(PrtnetError, match=r"field\.safetensors: .*checksum differs.*fit it again"):
        neural.load(path)


def test_what_is_no_such_file_is_refused_by_name(tmp_path):
    with pytest.raises(PrtnetError, match=r"none\.safetensors: no such file.*fit one"):
        neural.load(tmp_path / "none.safetensors")
    save_file({"a": np.zeros(3)}, tmp_path / "other.safetensors")
    (tmp_path / "half.safetensors").write_bytes(b"12345678")
    for name in ("other", "half"):
        with pytest.raises(PrtnetError, match=rf"{name}\.safetensors: .*Expected a whole neural distance"):
            neural.load(tmp_path / f"{name}.safetensors")


def test_numbers_that_are_none_are_refused():
    weights, biases = FIELD.weights, FIELD.biases
    with pytest.raises(PrtnetError, match="NaN or infinity"):
        Neural((np.full_like(weights[0], np.nan), *weights[1:]), biases)
    with pytest.raises(PrtnetError, match="chain that takes 3 inputs"):
        Neural(weights[1:], biases[1:])
    with pytest.raises(PrtnetError, match="found 13, expected 1"):
        Neural(weights[:1], biases[:1])
    with pytest.raises(PrtnetError, match="lipschitz 0"):
        Neural(weights, biases, lipschitz=0.0)


def test_digests_differ_with_the_surface_and_not_with_the_frame():
    assert random_field(seed=1).digest() != random_field().digest() == random_field(frame=FIELD.frame).digest()
    assert random_field(lipschitz=2.0).digest() != random_field().digest()


def test_the_steepest_slope_is_found():
    # the gradient of y - 0.05 sin 16 x is (-0.8 cos 16 x, 1)
    assert neural.steepest(waves(), np.random.default_rng(0), count=4096)[0] == pytest.approx(
        np.hypot(0.8, 1), rel=1e-4
    )


def crossings(field, origins, directions, far=2.0, samples=4000):
    """The least length with a distance below 0, looked for everywhere."""
    lengths = np.linspace(0, far, samples)
    points = origins[:, None] + lengths[:, None] * directions[:, None]
    inside = field.distance(points.reshape(-1, 3)).reshape(len(origins), -1) < 0
    return np.where(inside.any(axis=1), lengths[inside.argmax(axis=1)], np.inf)


def grazing(count=60):
    """Rays along x low over the crests of the waves, and some of them a little down."""
    rng = np.random.default_rng(3)
    origins = np.stack([np.full(count, -1.0), rng.uniform(0.02, 0.2, count), rng.uniform(-0.5, 0.5, count)], axis=1)
    directions = np.stack([np.ones(count), rng.uniform(-0.12, 0, count), np.zeros(count)], axis=1)
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_steps_by_the_slope_found_miss_nothing_that_a_dense_search_finds():
    steep = waves(amplitude=0.2, turns=12.0)
    slope = 1.05 * neural.steepest(steep, np.random.default_rng(0), count=4096)[0]
    safe = waves(amplitude=0.2, turns=12.0, lipschitz=float(slope))
    origins, directions = grazing()
    dense = crossings(safe, origins, directions)
    found = walked(safe, origins, directions, steps=3000)
    hit = np.isfinite(dense)
    assert hit.mean() > 0.3
    assert (found <= dense + 1e-9)[hit].all()
    np.testing.assert_allclose(found[hit], dense[hit], atol=0.02)
    # the same walk by steps as long as the distance jumps through crests
    bold = walked(steep, origins, directions, steps=3000)
    assert (bold[hit] > dense[hit] + 0.02).any()
