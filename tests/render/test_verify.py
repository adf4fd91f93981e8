import numpy as np
import pytest

from prtnet import gl
from prtnet.export import glsl, grid, limits, texel_grid
from prtnet.netspec import NetSpec
from prtnet.render import verify
from tests.nets import random_grid, random_hash, random_net, random_texels, random_uv

HEADS = [
    {"activation": "leaky_relu", "output": "tanh"},
    {"activation": "gelu", "output": "linear", "residual": True},
    {"activation": "silu", "output": "linear", "residual": True},
    {"activation": "hard_gelu", "output": "linear"},
    {"activation": "relu", "output": "linear", "encoding": "identity"},
    {"activation": "sine", "output": "linear", "encoding": "triangle"},
]


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize(("bands", "depth"), [(1, 2), (4, 2), (5, 2), (4, 0)])
def test_the_driver_computes_what_numpy_computes(head, bands, depth):
    net = random_net(width=16, depth=depth, position_frequencies=10, normal_frequencies=4, bands=bands, **head)
    positions, normals = verify.random_points(3000, np.random.default_rng(1))
    errors = verify.glsl_error(net, glsl.emit(net), positions, normals)
    assert errors.highest <= verify.TOLERANCE
    assert errors.mean <= 1e-6


def test_more_coefficients_than_one_pass_can_write():
    net = random_net(bands=7, residual=True, output="linear")
    assert glsl.vectors(net) == 13
    positions, normals = verify.random_points(100, np.random.default_rng(2))
    assert verify.glsl_error(net, glsl.emit(net), positions, normals).highest <= verify.TOLERANCE


@pytest.mark.parametrize("bands", [1, 3, 4, 5])
def test_four_groups_are_padded_one_by_one(bands):
    net = random_net(bands=bands, groups=4, residual=True, output="linear")
    assert glsl.vectors(net) == 4 * -(-(bands**2) // 4)
    positions, normals = verify.random_points(300, np.random.default_rng(2))
    assert verify.run(net, glsl.emit(net), positions, normals).shape == (300, 4 * bands**2)
    assert verify.glsl_error(net, glsl.emit(net), positions, normals).highest <= verify.TOLERANCE


@pytest.mark.parametrize("kind", ["float16", "float32"])
def test_grids_are_fetched_as_numpy_interpolates(kind):
    """Sides that differ, a grid of one cell, corners of the cube and points between cells."""
    grids = (random_grid(7, 4, 3, 12, kind), random_grid(1, 1, 1, 4, kind), random_grid(16, 8, 32, 8, kind))
    net = random_net(width=16, grids=grids)
    positions, normals = verify.random_points(3000, np.random.default_rng(6))
    positions[:8] = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3)
    positions[8:400] = np.round(positions[8:400] * 8) / 8
    assert verify.glsl_error(net, glsl.emit(net), positions, normals).highest <= verify.TOLERANCE


@pytest.mark.parametrize("kind", ["float16", "float32"])
def test_hashed_grids_are_fetched_as_numpy_hashes(kind):
    """Both signs, corners of the cube, and places on corners of cells."""
    hashes = (random_hash(128, 512, 8, kind), random_hash(7, 256, 4, kind))
    net = random_net(width=16, grids=(random_grid(3, 2, 2),), hashes=hashes)
    positions, normals = verify.random_points(3000, np.random.default_rng(6))
    positions[:8] = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3)
    positions[8:400] = np.round(positions[8:400] * 24) / 24
    assert verify.glsl_error(net, glsl.emit(net), positions, normals).highest <= verify.TOLERANCE
    wrong = glsl.emit(net).replace("805459861u", "805459863u")
    assert verify.glsl_error(net, wrong, positions, normals).highest > 0.1


@pytest.mark.parametrize(("sizes", "kind"), [((7, 160), "float16"), ((1, 225), "float32"), ((4096, 2), "float16")])
def test_texels_are_fetched_as_numpy_interpolates(sizes, kind):
    """Sides that differ, one texel, corners, edges and middles of texels."""
    texels = tuple(random_texels(x, 3, channels, kind) for x, channels in zip(sizes, (4, 12), strict=True))
    net = random_net(width=16, hashes=(random_hash(8),), texels=texels)
    positions, normals = verify.random_points(3000, np.random.default_rng(6))
    uv = random_uv(3000)
    uv[:4], uv[4:400] = [[0, 0], [0, 1], [1, 0], [1, 1]], np.round(uv[4:400] * 320) / 320
    # the least of drivers have textures of 1024 texels
    source = glsl.emit(net, target=limits.of_driver(gl.context().info))
    assert verify.glsl_error(net, source, positions, normals, uv).highest <= verify.TOLERANCE
    wrong = source.replace("- 0.5 +", "- 0.49 +")
    assert verify.glsl_error(net, wrong, positions, normals, uv).highest > verify.TOLERANCE


def test_the_texture_of_texels_begins_at_the_bottom():
    values = random_texels(5, 3, 8)
    image = texel_grid.texels(values)
    assert image.shape == (3, 10, 4)
    np.testing.assert_array_equal(image[0, 2 * 3 + 1], values[2, 3, 4:])


def test_the_texture_of_a_grid_has_blocks_of_four_channels():
    values = random_grid(5, 4, 3, 8)
    volume = grid.texels(values)
    assert volume.shape == (6, 4, 5, 4)
    np.testing.assert_array_equal(volume[3 + 2, 1, 4], values[2, 1, 4, 4:])


def test_large_arguments_stay_finite():
    """Hidden values of several hundred: neither exp nor tanh may overflow into NaN."""
    for head in HEADS:
        net = random_net(width=4, depth=1, bands=1, **head)
        big = tuple(weight * np.float32(300) for weight in net.weights[:1]) + net.weights[1:]
        net = type(net)(**{**vars(net), "weights": big})
        positions, normals = verify.random_points(500, np.random.default_rng(3))
        found = verify.run(net, glsl.emit(net), positions, normals)
        assert np.isfinite(found).all()
        errors = verify.glsl_error(net, glsl.emit(net), positions, normals)
        assert errors.highest <= 1e-3  # hidden values reach 1000, and float32 has seven digits


def test_corners_of_the_encoding():
    """Whole, half and quarter turns of each octave, and normals along the axes."""
    net = random_net(position_frequencies=10, normal_frequencies=6, width=12)
    grid = np.linspace(-1, 1, 9, dtype=np.float32)
    positions = np.stack(np.meshgrid(grid, grid, grid), -1).reshape(-1, 3)
    normals = np.tile(np.concatenate([np.eye(3), -np.eye(3)]), (122, 1))[: len(positions)].astype(np.float32)
    assert verify.glsl_error(net, glsl.emit(net), positions, normals).highest <= verify.TOLERANCE


@pytest.mark.parametrize("turns", [0.5, 16, 1024])
def test_the_sine_activation_is_off_by_rounding_alone(turns):
    """Each driver's own sine may be off by 1e-3; this one is a polynomial after whole turns are taken off exactly."""
    reach = 2 * np.pi * turns
    weight = np.zeros((4, 6), np.float32)
    weight[0, 0] = 2.0 ** np.floor(np.log2(reach))  # a power of 2 rounds nothing
    biases = (np.zeros(4, np.float32), np.zeros(1, np.float32))
    last = np.float32([[1, 0, 0, 0]])
    net = NetSpec((weight, last), biases, 0, 0, activation="sine", output="linear", output_scale=1.0, bands=1)
    positions, normals = verify.random_points(4000, np.random.default_rng(5))
    assert verify.glsl_error(net, glsl.emit(net), positions, normals).highest <= 4e-7


def test_a_wrong_digit_is_seen():
    net = random_net()
    positions, normals = verify.random_points(100, np.random.default_rng(4))
    weight = glsl.number(net.weights[1][0, 0])
    wrong = glsl.emit(net).replace(weight, glsl.number(net.weights[1][0, 0] + 1e-4), 1)
    assert verify.glsl_error(net, wrong, positions, normals).highest > verify.TOLERANCE
