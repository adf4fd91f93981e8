"""Files of data-driven transfer: what they hold is enough to get the indirect light back without this package's
evaluator."""

import json
import re

import numpy as np
import pytest
from safetensors import safe_open

from prtnet import PrtnetError, data_driven
from prtnet.export import data_driven as spelt
from prtnet.export import glsl
from prtnet.export.texture_file import read_exr
from tests.operators import direct, random_spec

MEASURED = {"errors": {"texels": {"max": 0.0, "mean": 0.0, "bound": 1.0}}}


@pytest.mark.parametrize("banks", [1, 3])
def test_indirect_light_from_the_files_alone(banks, tmp_path):
    """Texels of the EXR times M x of the arrays, by hand."""
    spec = random_spec(banks=banks)
    spelt.write(tmp_path, spec, MEASURED)
    facts = json.loads((tmp_path / "certificate.json").read_text())["data_driven"]
    names = spelt.channel_names(spec)
    assert names[-1] == ("e05" if banks == 1 else "blue.e05")
    (image,) = read_exr(tmp_path / spelt.EXR, names)
    with safe_open(tmp_path / spelt.SPEC, "numpy") as file:
        matrices, texels = file.get_tensor("matrices")[0], file.get_tensor("texels")
    light = direct(spec)
    expected = data_driven.indirect(spec, light)
    for colour in range(3):
        bank = colour % banks
        basis = image.reshape(-1, banks, spec.elements)[texels, bank] / facts["scale"]
        found = basis @ (matrices[bank] @ light[:, colour])
        np.testing.assert_allclose(found, expected[:, colour], atol=2e-3 * np.abs(expected).max())


def test_charts_are_grown():
    """A texel beside one in use reads the mean of such neighbours, three texels on there is still something, and no
    further."""
    spec = random_spec(texels=np.array([10 * 24 + 10, 10 * 24 + 11]), elements=2)
    page = spelt.basis_page(spec)
    image = page.levels[0]
    assert page.used.sum() == 2
    assert image.shape == (24, 24, 4)
    np.testing.assert_allclose(image[10, 10, :2], spec.basis[0, :, 0] * spelt.scale_of(spec))
    np.testing.assert_allclose(image[10, 9], image[10, 10])
    np.testing.assert_allclose(image[9, 10], (image[10, 10] + image[10, 11]) / 2)
    assert image[10, 7].any()
    assert not image[10, 6].any()
    assert not image[..., 2:].any()


def test_scale_is_a_power_of_two():
    """Dividing the matrix by it and multiplying the basis with it changes no digit."""
    scale, spec = 0.0, random_spec()
    for size in (4, 24, 70):
        spec = random_spec(size=size, elements=3)
        scale = spelt.scale_of(spec)
        assert np.log2(scale) % 1 == 0
        assert 0.7 < scale / np.sqrt(len(spec.texels)) < 1.42
    table = spelt.matrix_texels(spec).reshape(4, 24)
    np.testing.assert_array_equal(table[:3, :23] * scale, spec.matrices[0, 0])
    assert not table[3].any()
    assert not table[:, 23].any()


@pytest.mark.parametrize("version", ["330", "300 es"])
@pytest.mark.parametrize(("banks", "gamma"), [(1, 1.0), (3, 2.2)])
def test_both_languages(version, banks, gamma):
    spec = random_spec(banks=banks, gamma=gamma)
    texts = spelt.files(spec, version)
    whole = [text for name, text in texts.items() if name.endswith(".frag")]
    assert len(whole) == 4
    assert all(glsl.validate(text) in ("", None) for text in whole)
    for held in spelt.HELD:
        text = spelt.indirect(spec, held=held)
        assert glsl.validate(glsl.whole(version, spelt.whole(spec, text))) in ("", None)
    # four elements to a look-up
    assert len(re.findall(r"texture\(prt_basis", texts[spelt.BLEND])) == 2 * banks


def test_nothing_is_written_of_what_is_wrong(tmp_path):
    spec = random_spec()
    spelt.write(tmp_path, spec, MEASURED)
    wrong = {"errors": {"texels": {"max": 2.0, "mean": 0.0, "bound": 1.0}}}
    with pytest.raises(PrtnetError, match=r"export: texels: found an error of 2, expected at most 1"):
        spelt.write(tmp_path, spec, wrong)
    assert not list(tmp_path.iterdir())
