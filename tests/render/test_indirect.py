"""The operator on the driver: u and texels against NumPy, and a certificate that sees a wrong text."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError, data_driven, gl
from prtnet.data import quantise
from prtnet.export import certificate
from prtnet.export import data_driven as spelt
from prtnet.render import data_driven_check
from prtnet.render.indirect import Indirect
from tests.operators import direct, random_spec


def texels_of(operator: Indirect) -> np.ndarray:
    spec = operator.spec
    program = gl.program(gl.shader("fullscreen.vert.glsl"), spelt.whole(spec, operator.text))
    target = gl.target(spec.size, spec.size)
    operator.bind(program)
    gl.fullscreen(program, target)
    return target.read()[..., :3].reshape(-1, 3)[spec.texels]


@pytest.mark.parametrize("held", spelt.HELD)
@pytest.mark.parametrize(("banks", "gamma"), [(1, 1.0), (3, 1.0), (1, 2.2), (3, 2.2)])
def test_it_is_the_twin(banks, gamma, held):
    """Elements and points that are no multiples of four, and the second of two keyframes."""
    spec = random_spec(banks=banks, gamma=gamma, keyframes=2)
    light = direct(spec)
    operator = Indirect(spec, texels="float32", held=held)
    operator.reduce(data_driven_check.upload(light), 1)
    u = data_driven.coefficients(spec, light, 1)
    np.testing.assert_allclose(operator.coefficients(), u, atol=2e-6 * np.abs(u).max())
    expected = np.maximum(data_driven.indirect(spec, light, 1), 0)
    assert (expected == 0).any()
    assert expected.max() > 0.1
    np.testing.assert_allclose(texels_of(operator), expected, atol=5e-6 * expected.max())
    # the same where u comes from elsewhere
    operator.set(np.zeros_like(u))
    assert not texels_of(operator).any()
    operator.set(u)
    np.testing.assert_allclose(texels_of(operator), expected, atol=5e-6 * expected.max())


@pytest.mark.parametrize("texels", list(quantise.FORMATS))
def test_formats_of_texels(texels):
    """What the shader reads is what NumPy decodes; half floats keep a basis whatever the number of its texels."""
    spec = random_spec(size=96)
    light = direct(spec)
    operator = Indirect(spec, texels=texels)
    operator.reduce(data_driven_check.upload(light))
    kept = replace(spec, basis=data_driven_check._stored(operator))
    expected = np.maximum(data_driven.indirect(kept, light), 0)
    np.testing.assert_allclose(texels_of(operator), expected, atol=1e-5 * expected.max())
    rounding = np.abs(kept.basis - spec.basis).max() / np.abs(spec.basis).max()
    assert rounding <= {"float32": 0, "float16": 2**-11, "uint8": 1 / 255}[texels]
    assert operator.bytes == 96 * 96 * 8 * quantise.FORMATS[texels] + 8 * 6 * 16


def test_direct_light_in_several_rows():
    """Texel j is counted row by row, from the texel (0, 0) on."""
    spec = random_spec(points=20)
    light = direct(spec)
    table = np.zeros((4, 5, 4), np.float32)
    table[..., :3] = light.reshape(4, 5, 3)
    operator = Indirect(spec)
    operator.reduce(gl.upload_table(table))
    u = data_driven.coefficients(spec, light)
    np.testing.assert_allclose(operator.coefficients(), u, atol=2e-6 * np.abs(u).max())


@pytest.mark.parametrize(("banks", "gamma"), [(1, 1.0), (3, 2.2)])
def test_certificate(banks, gamma, tmp_path):
    spec = random_spec(banks=banks, gamma=gamma, keyframes=2, size=32)
    lights = np.stack([direct(spec, seed) for seed in range(3)])
    measured = data_driven_check.errors_and_timing(spec, lights, np.array([0, 1, 1]))
    assert measured["executed"]
    assert measured["vectors"] == 3
    errors = measured["errors"]
    assert list(errors) == ["rounding of the basis", "coefficients", "texels"]
    certificate.refuse(errors)
    # the bound is near: half of what half floats do to the basis would be seen
    assert errors["texels"]["bound"] < 0.5 * errors["rounding of the basis"]["max"]
    spelt.write(tmp_path, spec, measured)
    written = certificate.check(tmp_path)
    assert set(written["files"]) == set(spelt.NAMES)
    assert written["data_driven"]["points"] == 23


@pytest.mark.parametrize(
    ("function", "change", "what"),
    [
        ("reduce", ("4 * q + 1", "4 * q + 2"), "coefficients"),
        ("indirect", ("u1 * texture", "1.0001 * u1 * texture"), "texels"),
        ("indirect", ("max(sum, 0.0)", "sum"), "texels"),
    ],
)
def test_a_wrong_text_is_seen(monkeypatch, tmp_path, function, change, what):
    spec = random_spec()
    right = getattr(spelt, function)
    assert change[0] in right(spec)
    monkeypatch.setattr(spelt, function, lambda *given, **more: right(*given, **more).replace(*change))
    measured = data_driven_check.errors_and_timing(spec, direct(spec)[None])
    with pytest.raises(PrtnetError, match=f"export: {what}: found an error"):
        spelt.write(tmp_path, spec, measured)
    assert not list(tmp_path.iterdir())


def test_no_light_to_check_with():
    spec = random_spec()
    with pytest.raises(PrtnetError, match="found no direct light to check"):
        data_driven_check.errors_and_timing(spec, np.zeros((0, 23, 3), np.float32))
