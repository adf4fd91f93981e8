"""The GLSL of a network's distance gives the numbers of NumPy."""

import re
import shutil

import numpy as np
import pytest

from prtnet import PrtnetError, gl
from prtnet.export import glsl, neural_field
from prtnet.render import pixelwise
from prtnet.render.pixelwise import Pass
from tests.neural_fields import random_field

FIELD = random_field(half=(1.1, 0.7, 1.2))
FRAGMENT = """
uniform sampler2D positions;
layout(location = 0) out vec4 found;
void main() {
  vec3 p = texelFetch(positions, ivec2(gl_FragCoord.xy), 0).xyz;
  found = vec4(prt_distance(p) + float(prt_part(p)), prt_gradient(p));
}
"""


def test_distances_and_gradients_are_those_of_numpy():
    points = np.random.default_rng(5).uniform(-2, 2, (4000, 3)).astype(np.float32)
    points[0] = 0
    shown = Pass(neural_field.emit(FIELD) + FRAGMENT, {"positions": gl.upload(pixelwise.image(points))})
    found = shown.read()[: len(points)]
    np.testing.assert_allclose(found[:, 0], FIELD.distance(points), atol=2e-6)
    np.testing.assert_allclose(found[:, 1:], FIELD.gradient(points), atol=2e-5)


@pytest.mark.skipif(shutil.which("glslangValidator") is None, reason="glslangValidator is absent: glslang-tools has it")
@pytest.mark.parametrize("version", glsl.VERSIONS)
@pytest.mark.parametrize("field", [FIELD, random_field(4, 1)], ids=["13 x 2", "4 x 1"])
def test_every_version_is_valid(version, field):
    assert glsl.validate(glsl.whole(version, neural_field.emit(field) + FRAGMENT)) == ""


def test_it_stands_beside_a_net_of_sines():
    from tests.nets import random_net

    names = set(re.findall(r"\w+ (prt_\w+)\(", neural_field.emit(FIELD)))
    others = set(re.findall(r"\w+ (prt_\w+)\(", glsl.emit(random_net(activation="sine"))))
    assert {"prt_distance", "prt_gradient", "prt_part"} <= names
    assert not names & others


def test_too_large_a_network_is_refused():
    with pytest.raises(PrtnetError, match=r"found 4\d{4} multiply-adds, expected at most 20000.*sdf\.width"):
        neural_field.emit(random_field(200, 2))
