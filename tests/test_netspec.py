import json
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from safetensors import safe_open
from safetensors.numpy import save_file
from scipy.interpolate import RegularGridInterpolator

from prtnet import PrtnetError, netspec, sh
from prtnet.encoding import HashGrid, encode, encoded_size, hashed, trilinear
from tests.nets import random_grid, random_hash, random_net, random_points, random_texels, random_uv

coordinates = st.floats(-1, 1, width=32)


@given(coordinates, st.integers(0, 12))
def test_encoding_is_the_sine_of_the_exact_argument(x, frequencies):
    encoded = encode(np.full((1, 3), x, np.float32), frequencies)[0].reshape(-1, 3)[:, 0]
    expected = [x]
    for j in range(frequencies):
        # float64 holds 2^j x / 2 exactly, and its whole turns too
        angle = 2 * np.pi * ((2.0**j * x / 2) % 1.0)
        expected += [np.sin(angle), np.cos(angle)]
    np.testing.assert_allclose(encoded, expected, rtol=0, atol=1e-15)


@given(coordinates, st.integers(1, 12))
def test_triangle_waves_are_arcsines_of_the_sines(x, frequencies):
    point = np.full((1, 3), x, np.float32)
    waves = encode(point, frequencies, "triangle")
    expected = 2 / np.pi * np.arcsin(encode(point, frequencies)[:, 3:])
    np.testing.assert_array_equal(waves[:, :3], point)
    # the slope of the arcsine is infinite where a sine is 1
    np.testing.assert_allclose(waves[:, 3:], expected, rtol=0, atol=1e-7)


def test_identity_leaves_the_point_as_it_is():
    positions, _ = random_points(5)
    np.testing.assert_array_equal(encode(positions, 7, "identity"), positions)
    assert encoded_size(7, 3, "identity") == 6


def test_grids_are_interpolated_between_the_middles_of_cells():
    grid = random_grid(5, 4, 3, kind="float32")
    middles = [(np.arange(side) + 0.5) / side * 2 - 1 for side in grid.shape[:3]]
    oracle = RegularGridInterpolator(middles, grid.astype(float))
    positions, _ = random_points(500)
    # scipy refuses what lies outside of the outermost middles: there the value stays as it is
    inside = [np.clip(positions[:, 2 - axis], where[0], where[-1]) for axis, where in enumerate(middles)]
    np.testing.assert_allclose(trilinear(grid, positions), oracle(np.stack(inside, 1)), rtol=0, atol=1e-12)
    corner = trilinear(grid, np.array([[1.0, -1.0, 1.0]]))
    np.testing.assert_array_equal(corner[0], grid[-1, 0, -1])


def test_features_follow_the_encoded_normal():
    grids = (random_grid(2, 3, 4), random_grid(3, 1, 1, channels=4, seed=1))
    net = random_net(depth=0, output="linear", bands=2, output_scale=1.0, grids=grids)
    positions, normals = random_points(9)
    parts = [encode(positions, 3), encode(normals, 2)]
    inputs = np.concatenate([*parts, *[trilinear(grid, positions) for grid in grids]], 1)
    expected = inputs @ net.weights[0].T.astype(float) + net.biases[0]
    np.testing.assert_allclose(netspec.evaluate_unit(net, positions, normals), expected, atol=2e-6)


def test_fetches_and_bytes_of_grids_are_counted():
    grids = (random_grid(2, 3, 4), random_grid(5, 1, 1, channels=4, kind="float32"))
    net, inputs = random_net(width=8, depth=1, bands=2, grids=grids), 6 + 6 * 5 + 12
    assert netspec.macs(net) == inputs * 8 + 8 * 4 + 8 * (8 + 4)
    assert netspec.byte_count(net) == 4 * (inputs * 8 + 8 + 8 * 4 + 4) + 2 * 24 * 8 + 4 * 5 * 4


def test_a_hashed_grid_is_linear_between_the_entries_of_its_corners():
    """Against integers of Python, which have no width."""
    grid = random_hash(5, entries=256)
    positions = np.concatenate([random_points(50)[0], [[1, -1, 0.2]], [[-0.4, 0.4, 0]]]).astype(np.float64)

    def feature(corner):
        primes = [corner[axis] % 2**32 * prime % 2**32 for axis, prime in enumerate((1, 2654435761, 805459861))]
        return grid.table[(primes[0] ^ primes[1] ^ primes[2]) % 256].astype(float)

    for position, found in zip(positions, hashed(grid, positions), strict=True):
        place = [2.5 * x for x in position.tolist()]
        total = np.zeros(4)
        for step in np.ndindex(2, 2, 2):
            corner = [int(np.floor(x)) + s for x, s in zip(place, step, strict=True)]
            total += np.prod([max(0.0, 1 - abs(x - c)) for x, c in zip(place, corner, strict=True)]) * feature(corner)
        np.testing.assert_allclose(found, total, rtol=0, atol=1e-12)


def test_hashed_grids_are_counted_and_come_back_from_the_file(tmp_path):
    hashes = (random_hash(48), random_hash(128, 512, 8, "float32"))
    plain, net = random_net(), random_net(hashes=hashes)
    assert netspec.macs(net) - netspec.macs(plain) == 12 * 8 + 8 * 12
    assert netspec.byte_count(net) - netspec.byte_count(plain) == 4 * 12 * 8 + 2 * 256 * 4 + 4 * 512 * 8
    netspec.save(net, tmp_path / "a")
    again = netspec.load(tmp_path / "a")
    for found, expected in zip(again.hashes, hashes, strict=True):
        assert found.cells == expected.cells
        assert found.table.dtype == expected.table.dtype
        np.testing.assert_array_equal(found.table, expected.table)
    netspec.save(plain, tmp_path / "b")
    assert b"hash" not in (tmp_path / "b").read_bytes()


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        (random_hash(4, entries=100), r"hash: found 4 cells, \(100, 4\) in float16, expected .*2\^m entries"),
        (random_hash(0), "found 0 cells"),
        (random_hash(4, channels=6), "4 n channels"),
        (HashGrid(4, np.full((4, 4), np.nan, np.float32)), "hash: found NaN or infinity"),
    ],
)
def test_hashed_grids_that_mean_nothing_are_refused(grid, message):
    with pytest.raises(PrtnetError, match=message):
        replace(random_net(), hashes=(grid,))


def test_grids_come_back_from_the_file_in_their_type(tmp_path):
    net = random_net(grids=(random_grid(2, 3, 4), random_grid(5, 1, 1, channels=4, kind="float32")))
    netspec.save(net, tmp_path / "a")
    again = netspec.load(tmp_path / "a")
    for found, expected in zip(again.grids, net.grids, strict=True):
        assert found.dtype == expected.dtype
        np.testing.assert_array_equal(found, expected)
    netspec.save(again, tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    cut = (tmp_path / "a").read_bytes().replace(b'\\"grids\\": 2', b'\\"grids\\": 3')
    (tmp_path / "c").write_bytes(cut)
    with pytest.raises(PrtnetError, match=r"c: .*grid\.2"):
        netspec.load(tmp_path / "c")


def test_texels_are_counted_and_come_back_from_the_file(tmp_path):
    texels = random_texels(3, 2, 8), random_texels(5, 5, 4, "float32")
    plain, net = random_net(), random_net(texels=texels)
    assert netspec.macs(net) - netspec.macs(plain) == 12 * 8 + 4 * 12
    assert netspec.byte_count(net) - netspec.byte_count(plain) == 4 * 12 * 8 + 2 * 6 * 8 + 4 * 25 * 4
    netspec.save(net, tmp_path / "a")
    again = netspec.load(tmp_path / "a")
    for found, expected in zip(again.texels, texels, strict=True):
        assert found.dtype == expected.dtype
        np.testing.assert_array_equal(found, expected)
    netspec.save(plain, tmp_path / "b")
    assert b"texels" not in (tmp_path / "b").read_bytes()


def test_a_net_with_texels_is_a_function_of_the_place_in_the_atlas():
    (positions, normals), uv = random_points(33_000), random_uv(33_000)
    net = random_net(bands=2, texels=(random_texels(4, 4),), centre=(1.0, 2.0, 3.0), scale=0.5)
    whole = netspec.evaluate_unit(net, positions, normals, uv=uv)
    positions, normals, uv = positions[-9:], normals[-9:], uv[-9:]
    np.testing.assert_array_equal(whole[-9:], netspec.evaluate_unit(net, positions, normals, uv=uv))
    found = netspec.evaluate(net, positions / 0.5 + np.array([1, 2, 3]), normals, uv)
    np.testing.assert_allclose(found, whole[-9:], atol=1e-6)
    assert np.abs(whole[-9:] - netspec.evaluate_unit(net, positions, normals, uv=uv[::-1])).max() > 0.1
    with pytest.raises(PrtnetError, match=r"net texels: found no uv, expected .* in the atlas"):
        netspec.evaluate_unit(net, positions, normals)
    # one without has no use for it
    plain = random_net()
    np.testing.assert_array_equal(
        netspec.evaluate(plain, positions, normals, uv), netspec.evaluate(plain, positions, normals)
    )


@pytest.mark.parametrize(
    ("texels", "message"),
    [
        (random_texels(2, 2, channels=6), r"texels: found \(2, 2, 6\) in float16, expected .* 4 n channels"),
        (random_texels(2, 2, kind="float64"), "in float64"),
        (random_texels(2, 2) * np.float16("nan"), "texels: found NaN or infinity"),
    ],
)
def test_texels_that_mean_nothing_are_refused(texels, message):
    with pytest.raises(PrtnetError, match=message):
        replace(random_net(), texels=(texels,))


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        (random_grid(2, 2, 2, channels=6), r"grid: found \(2, 2, 2, 6\) in float16, expected .* 4 n channels"),
        (random_grid(2, 2, 2, kind="float64"), "in float64"),
        (random_grid(2, 2, 2) * np.float16("inf"), "grid: found NaN or infinity"),
    ],
)
def test_grids_that_mean_nothing_are_refused(grid, message):
    with pytest.raises(PrtnetError, match=message):
        replace(random_net(), grids=(grid,))


@given(st.integers(-1024, 1024), st.integers(1, 10))
def test_encoding_has_the_period_of_its_octave(steps, j):
    x, period = steps / 1024, 4.0 / 2**j
    first, second = (encode(np.full((1, 3), value), j)[0, -6:] for value in (x, x + period))
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-12)


def test_evaluate_is_the_written_formula():
    net = random_net(width=5, depth=1, activation="silu", output="tanh", residual=True, bands=3, output_scale=2.0)
    positions, normals = random_points(7)
    inputs = np.concatenate([encode(positions, 3), encode(normals, 2)], 1)
    hidden = inputs @ net.weights[0].T.astype(float) + net.biases[0]
    hidden = hidden / (1 + np.exp(-hidden))
    expected = 2.0 * np.tanh(hidden @ net.weights[1].T.astype(float) + net.biases[1])
    expected += sh.cosine_lobe(normals.astype(float), 3)
    np.testing.assert_allclose(netspec.evaluate_unit(net, positions, normals), expected, atol=2e-6)


def test_activations_at_known_places():
    x = np.array([-200.0, -1.0, 0.0, 1.0, 200.0])
    np.testing.assert_allclose(netspec.activation("leaky_relu", 0.01)(x), [-2, -0.01, 0, 1, 200])
    np.testing.assert_allclose(netspec.activation("relu")(x), [0, 0, 0, 1, 200])
    np.testing.assert_allclose(netspec.activation("sine")(x * np.pi / 4), [0, -(0.5**0.5), 0, 0.5**0.5, 0], atol=1e-13)
    np.testing.assert_allclose(netspec.activation("hard_gelu")(x / 2), [0, -0.125, 0, 0.375, 100])
    np.testing.assert_allclose(netspec.activation("silu")(x), [0, -0.268941421, 0, 0.731058579, 200], atol=1e-9)
    # the published values of the exact GELU are -0.158655 and 0.841345; the tanh form is within 2e-4 of them
    np.testing.assert_allclose(netspec.activation("gelu")(x), [0, -0.158808, 0, 0.841192, 200], atol=1e-6)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_evaluate_keeps_the_type_of_the_positions(kind):
    positions, normals = random_points(3)
    assert netspec.evaluate(random_net(), positions.astype(kind), normals).dtype == kind


def test_a_net_far_from_the_origin_gives_the_same_transfer():
    positions, normals = random_points(500)
    near, far = random_net(), random_net(centre=(1e6, -2e6, 3.0e6), scale=0.125)
    moved = positions.astype(np.float64) / 0.125 + np.array(far.centre)
    found = netspec.evaluate(far, moved, normals)
    # what is left is the rounding of 1e6 in float64, scaled up by the encoding's 2^3 pi
    np.testing.assert_allclose(found, netspec.evaluate(near, positions.astype(np.float64), normals), atol=1e-6)


def test_chunks_do_not_show():
    positions, normals = random_points(40_000)
    whole = netspec.evaluate_unit(random_net(), positions, normals)
    np.testing.assert_array_equal(whole[-5:], netspec.evaluate_unit(random_net(), positions[-5:], normals[-5:]))


@pytest.mark.parametrize("fields", [{}, {"activation": "sine", "residual": True, "grids": (random_grid(4, 3, 2),)}])
def test_sums_in_float32_differ_by_roundings(fields):
    net, (positions, normals) = random_net(width=64, depth=4, **fields), random_points(2000)
    exact, quick = (netspec.evaluate_unit(net, positions, normals, sums) for sums in (np.float64, np.float32))
    assert quick.dtype == np.float32
    assert 0 < np.abs(quick - exact).max() < 2e-5


@given(st.integers(1, 70), st.integers(1, 5), st.integers(0, 10), st.integers(0, 6), st.integers(1, 6))
def test_macs_have_a_closed_form(width, depth, position_frequencies, normal_frequencies, bands):
    net = random_net(
        width=width,
        depth=depth,
        position_frequencies=position_frequencies,
        normal_frequencies=normal_frequencies,
        bands=bands,
    )
    inputs = 6 * (1 + position_frequencies + normal_frequencies)
    parameters = inputs * width + (depth - 1) * width**2 + width * bands**2
    assert netspec.macs(net) == parameters
    assert netspec.byte_count(net) == 4 * (parameters + depth * width + bands**2)


def test_published_size_in_multiply_adds():
    net = random_net(width=64, depth=4, position_frequencies=10, normal_frequencies=4)
    assert netspec.macs(net) == 90 * 64 + 3 * 64 * 64 + 64 * 25 == 19648


def test_round_trip_of_fields_and_bytes(tmp_path):
    net = random_net(activation="gelu", output="linear", residual=True, centre=(1e6, 0.1, -2.5), scale=1 / 3, name="né")
    first, second = tmp_path / "a.safetensors", tmp_path / "b.safetensors"
    netspec.save(net, first)
    again = netspec.load(first)
    netspec.save(again, second)
    assert first.read_bytes() == second.read_bytes()
    for field in fields(net):
        if field.name not in ("weights", "biases"):
            assert getattr(again, field.name) == getattr(net, field.name), field.name
    for found, expected in zip(again.weights + again.biases, net.weights + net.biases, strict=True):
        np.testing.assert_array_equal(found, expected)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.safetensors", "b.safetensors"]


@pytest.mark.parametrize(("fields", "written"), [({}, False), ({"encoding": "triangle"}, True)])
def test_fields_that_came_later_are_written_where_they_are_used(fields, written, tmp_path):
    netspec.save(random_net(**fields), tmp_path / "net")
    assert (b"encoding" in (tmp_path / "net").read_bytes()) == written
    assert netspec.load(tmp_path / "net").encoding == fields.get("encoding", "frequency")


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.9, 0.999])
def test_a_truncated_file_is_named(tmp_path, share):
    path = tmp_path / "cut.safetensors"
    netspec.save(random_net(), path)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(PrtnetError, match=r"cut\.safetensors"):
        netspec.load(path)


def test_other_files_are_refused_by_name(tmp_path):
    with pytest.raises(PrtnetError, match=r"none\.safetensors: no such file"):
        netspec.load(tmp_path / "none.safetensors")
    path = tmp_path / "other.safetensors"
    save_file({"a": np.zeros(3, np.float32)}, path)
    with pytest.raises(PrtnetError, match=r"other\.safetensors: found no descriptor"):
        netspec.load(path)
    netspec.save(random_net(), path)
    later = path.read_bytes().replace(b'\\"format\\": 1', b'\\"format\\": 9')
    path.write_bytes(later)
    with pytest.raises(PrtnetError, match=r"other\.safetensors: found format 9"):
        netspec.load(path)
    save_file({"a": np.zeros(3, np.float32)}, path, {"prtnet_net": json.dumps({"format": 1, "layers": 2})})
    with pytest.raises(PrtnetError, match=r"other\.safetensors"):
        netspec.load(path)


def test_weights_that_were_edited_are_refused(tmp_path):
    """Files from before there was a checksum are still read."""
    path, net = tmp_path / "net.safetensors", random_net()
    netspec.save(net, path)
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    with pytest.raises(PrtnetError, match=r"net\.safetensors: found other weights than were written"):
        netspec.load(path)
    with safe_open(path, framework="numpy") as file:
        descriptor = json.loads(file.metadata()["prtnet_net"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    del descriptor["sha256"]
    save_file(tensors, path, {"prtnet_net": json.dumps(descriptor)})
    assert netspec.checksum(netspec.load(path)) != netspec.checksum(net)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"activation": "cosine"}, "activation: found 'cosine'"),
        ({"encoding": "hash"}, "encoding: found 'hash', expected one of identity, frequency, triangle"),
        ({"encoding": "identity"}, "layers: found .* 6 inputs"),
        ({"output": "softmax"}, "output: found 'softmax'"),
        ({"bands": 4}, "outputs: found 25, expected 16"),
        ({"position_frequencies": 4}, "layers"),
        ({"scale": 0.0}, "scale 0.0"),
        ({"centre": (float("nan"), 0.0, 0.0)}, "centre"),
    ],
)
def test_fields_that_do_not_fit_are_refused(change, message):
    with pytest.raises(PrtnetError, match=message):
        replace(random_net(), **change)


def test_a_net_of_nans_is_refused():
    net = random_net()
    bad = (net.weights[0] * np.float32("nan"), *net.weights[1:])
    with pytest.raises(PrtnetError, match="NaN"):
        replace(net, weights=bad)
