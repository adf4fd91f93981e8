"""Storages, rounding and limits of exported shaders, without a driver."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.export import fold, form, glsl, limits, shading, uniform_block, weight_texture
from prtnet.export.form import Form
from tests.nets import random_grid, random_hash, random_net

ROOMY = limits.Limits("a test", 1 << 20, 99, 1 << 20, 1 << 20, 1 << 20, 99)


def test_auto_is_literal_up_to_20_thousand_multiply_adds():
    """16 * 20 * 60 = 19 200 of the hidden layer and 16 * 6 * 60 = 5760 of the others, or a quarter of that."""
    small, large = [24, 80, 4], [24, 240, 240, 4]
    assert form.padded_macs_of(small, 1) < 20_000 < form.padded_macs_of(large, 1)
    assert [Form().of_sizes(sizes).storage for sizes in (small, large)] == ["literal", "texture"]
    assert Form(storage="texture").of_sizes(small).storage == "texture"


def test_only_literals_are_refused_for_size():
    net = random_net(width=160, depth=4)
    with pytest.raises(PrtnetError, match=r"padded multiply-adds, expected at most 60000.*export\.storage=texture"):
        glsl.emit(net)
    for storage in ("auto", "texture"):
        assert len(glsl.emit(net, storage=storage)) < 10_000


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"storage": "ssbo"}, "export.storage: found 'ssbo', expected one of auto, literal, texture, ubo"),
        ({"version": "310 es"}, "export.version: found '310 es', expected one of 330, 430, 300 es"),
        ({"precision": "int8"}, "export.precision: found 'int8', expected one of float32, float16"),
        ({"digits": 3}, "export.digits: found 3, expected one of 4, 5, 6, 7, 8, 9"),
        ({"precision": "float16", "storage": "ubo"}, "found float16 with export.storage=ubo"),
    ],
)
def test_words_that_mean_nothing_are_refused(fields, message):
    with pytest.raises(PrtnetError, match=message):
        Form(**fields)


def test_rows_of_the_weight_texture():
    """As the docstring says: four outputs in a row, their biases, then their weights for each input in turn."""
    net = random_net(width=6, depth=1, bands=2, groups=4)
    image = weight_texture.texels(net)
    hidden, inputs = 2, net.weights[0].shape[1]
    assert image.shape == (hidden + 4, 1 + 4 * -(-inputs // 4), 4)
    np.testing.assert_array_equal(image[1, 0], [*net.biases[0][4:], 0, 0])
    np.testing.assert_array_equal(image[0, 1 + 5], net.weights[0][:4, 5])
    np.testing.assert_array_equal(image[hidden + 3, 1 + 2], net.weights[1][12:, 2])
    assert not image[hidden:, 9:].any()
    assert weight_texture.texels(net, "float16").dtype == np.float16


def test_rounding_is_that_of_float16_or_of_the_digits():
    net = random_net()
    half = form.rounded(net, Form(storage="texture", precision="float16"))
    np.testing.assert_array_equal(half.weights[0], net.weights[0].astype(np.float16).astype(np.float32))
    short = form.rounded(net, Form(storage="literal", digits=6))
    error = np.abs(short.biases[1] / net.biases[1] - 1)
    assert 1e-8 < error.max() <= 5e-6
    text = glsl.emit(net, digits=6)
    assert len(text) < 0.85 * len(glsl.emit(net))
    assert f"{net.weights[1][0, 0]:.6g}" in text
    # digits are those of literals
    np.testing.assert_array_equal(form.rounded(net, Form(storage="texture", digits=6)).weights[0], net.weights[0])


def test_weights_beyond_float16_are_refused():
    net = random_net()
    large = replace(net, weights=(net.weights[0] * np.float32(1e6), *net.weights[1:]))
    with pytest.raises(PrtnetError, match=r"found a weight of .*, expected at most 65504 in float16"):
        glsl.emit(large, precision="float16", storage="texture")


def test_blocks_hold_all_rows_and_no_more_than_they_may():
    net = random_net(width=64, depth=2)
    blocks = uniform_block.blocks(net, 16_384)
    assert max(each.nbytes for each in blocks) <= 16_384
    rows = [form.rows(net, layer).reshape(-1, 4) for layer in range(3)]
    np.testing.assert_array_equal(np.concatenate(blocks), np.concatenate(rows))
    assert len(uniform_block.blocks(net, 1 << 20)) == 1


TINY = {"width": 8, "depth": 1}


@pytest.mark.parametrize(
    ("net", "arguments", "short", "message"),
    [
        (TINY, {"storage": "texture"}, {"source_bytes": 1000}, "bytes of source, expected at most 1000"),
        (TINY, {"storage": "ubo"}, {"block_bytes": 256}, "bytes in a uniform block, expected at most 256.*=texture"),
        ({"width": 96, "depth": 4}, {"storage": "ubo"}, {"block_bytes": 16_384, "blocks": 4}, "uniform blocks, .* 4"),
        ({"width": 96, "depth": 1}, {"storage": "texture"}, {"texture_side": 64}, "weight texture.*model.width"),
        ({"hashes": (random_hash(9, 65_536),)}, {}, {"texture_side": 200}, "found 256 texels.*train.hash_entries"),
        ({"grids": (random_grid(2, 2, 20),)}, {}, {"volume_side": 39}, "found 40 texels.*3D.*train.grid_cells"),
        ({"grids": (random_grid(2, 2, 2),) * 3}, {"storage": "texture"}, {"samplers": 5}, "found 6 samplers"),
    ],
)
def test_what_a_target_cannot_hold_is_refused_with_both_numbers(net, arguments, short, message):
    made = random_net(**net)
    with pytest.raises(PrtnetError, match=message) as caught:
        glsl.emit(made, target=replace(ROOMY, **short), **arguments)
    assert ", the limit of a test; choose " in str(caught.value)
    assert glsl.emit(made, target=ROOMY, **arguments)


def test_the_least_of_webgl_holds_the_folded_layer_of_no_network_too_wide():
    text = fold.irradiance(random_net(width=128, depth=1, output="linear"), Form("300 es"))
    assert "prt_folded[96]" in text
    with pytest.raises(PrtnetError, match=r"found 1204 uniform components, expected at most 896, the limit of WebGL 2"):
        fold.irradiance(random_net(width=400, depth=1, output="linear"), Form("300 es", "texture"))


def test_only_linear_outputs_are_folded():
    with pytest.raises(PrtnetError, match="found a net with output tanh, expected linear"):
        fold.irradiance(random_net(), Form())
    with pytest.raises(PrtnetError, match="found a net with output tanh, expected linear"):
        fold.fold(random_net(), np.ones((25, 3)))


@pytest.mark.skipif(shutil.which("glslangValidator") is None, reason="glslangValidator is absent: glslang-tools has it")
@pytest.mark.parametrize("version", glsl.VERSIONS)
@pytest.mark.parametrize("storage", ["literal", "texture", "ubo"])
def test_every_storage_is_valid_in_every_version(version, storage):
    """With all functions that are built on it, of one group and of four, with a hidden layer and without."""
    nets = [{"output": "linear", "residual": True, "grids": (random_grid(3, 2, 2),)}, {"bands": 3, "groups": 4}]
    for fields in [*nets, {"depth": 0, "output": "linear", "encoding": "identity", "hashes": (random_hash(8),)}]:
        net = random_net(**fields)
        text = glsl.emit(net, version=version, storage=storage)
        wholes = [shading.around(net, text + shading.functions(net), glossy=True)]
        if fold.can_fold(net):
            folded = fold.irradiance(net, Form(version, storage)) + shading.diffuse_on_irradiance(net)
            wholes.append(shading.around(net, folded))
        for each in wholes:
            assert glsl.validate(glsl.whole(version, each)) == ""
