import re
import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prtnet import PrtnetError
from prtnet.export import glsl
from tests.nets import random_grid, random_hash, random_net, random_texels


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_literals_read_back_as_the_same_float32(value):
    text = glsl.number(value)
    assert re.fullmatch(r"-?\d+(\.\d+)?(e[+-]\d+)?", text)
    assert re.search(r"[.e]", text), "GLSL ES has no implicit int -> float"
    denormal = 0 < abs(value) < np.finfo(np.float32).tiny
    assert np.float32(text) == np.float32(0 if denormal else value)


@pytest.mark.skipif(shutil.which("glslangValidator") is None, reason="glslangValidator is absent: glslang-tools has it")
@pytest.mark.parametrize("version", glsl.VERSIONS)
@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"activation": "gelu", "output": "linear", "residual": True},
        {"bands": 3, "groups": 4, "output": "linear", "residual": True},
        {"activation": "sine", "encoding": "triangle"},
        {"activation": "sine", "encoding": "frequency"},
        {"activation": "relu", "encoding": "identity"},
        {"encoding": "identity", "residual": True, "output": "linear", "depth": 0},
        {"grids": (random_grid(5, 4, 3), random_grid(2, 2, 2, channels=4))},
        {"hashes": (random_hash(48, channels=8), random_hash(128))},
        {"texels": (random_texels(6, 4, 8),), "grids": (random_grid(5, 4, 3),), "hashes": (random_hash(8),)},
        {"activation": "silu", "output": "linear", "residual": True, "bands": 7},
        {"bands": 1, "residual": True, "position_frequencies": 0, "normal_frequencies": 0, "output_scale": 1.0},
    ],
)
def test_every_version_is_valid(version, fields):
    assert glsl.validate(glsl.fragment_shader(random_net(**fields), version)) == ""


@pytest.mark.skipif(shutil.which("glslangValidator") is None, reason="glslangValidator is absent: glslang-tools has it")
def test_invalid_text_is_refused_with_the_validators_words():
    text = glsl.fragment_shader(random_net()).replace("floor(", "flor(")
    with pytest.raises(PrtnetError, match="flor"):
        glsl.validate(text)


def test_without_the_validator_nothing_is_claimed(monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert glsl.validate("no shader") is None


def test_the_text_is_one_self_contained_function():
    text = glsl.emit(random_net(name="a\nvoid main() {}", centre=(1e6, 0.5, -3.25), scale=0.125))
    assert "void prt_transfer(vec3 position, vec3 normal, out vec4 t0, out vec4 t1," in text
    assert "out vec4 t6)" in text
    assert "(file position - (1000000.0, 0.5, -3.25)) * 0.125" in text
    code = re.sub(r"//.*", "", text)
    for word in ("uniform", "for", "while", "#", "[", "main"):
        assert word not in code, word


def test_padded_multiply_adds():
    assert glsl.padded_macs(random_net(width=5, depth=2, position_frequencies=3, normal_frequencies=2)) == (
        8 * 36 + 8 * 8 + 28 * 8
    )
