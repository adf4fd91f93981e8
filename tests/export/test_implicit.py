"""The GLSL of implicit surfaces gives the numbers of NumPy."""

import re
import shutil

import numpy as np
import pytest

from prtnet import gl
from prtnet.data.implicit.field import Analytic
from prtnet.data.implicit.operators import difference, intersection, mirrored, moved, repeated, shell, turned, union
from prtnet.data.implicit.shapes import box, capsule, cone, cylinder, ellipsoid, plane, sphere, torus
from prtnet.export import glsl, implicit
from prtnet.render import pixelwise
from prtnet.render.pixelwise import Pass

VERSIONS = ("330", "430", "300 es")
PARTS = (
    union(
        mirrored(moved(ellipsoid(0.3, 0.2, 0.15), 0.4, 0.2, 0)),
        turned(box(0.3, 0.1, 0.2, round=0.05), (1, 2, 0.5), 40),
        capsule((0, 0, 0), (0.3, 0.8, -0.2), 0.2, 0.05),
        smooth=0.2,
    ),
    difference(shell(sphere(0.8), 0.02), plane((1, 1, 0), 0.3), smooth=0.1),
    repeated(intersection(cone(0.1, 0, 0.15), cylinder(0.08, 0.2), smooth=0.02), "z", 0.3, 3),
    turned(torus(0.5, 0.08), "x", 90),
)
FIELD = Analytic(PARTS, smooth=0.05)

FRAGMENT = """
uniform sampler2D positions;
layout(location = 0) out vec4 first;
layout(location = 1) out vec4 second;
void main() {
  vec3 p = texelFetch(positions, ivec2(gl_FragCoord.xy), 0).xyz;
  first = vec4(prt_distance(p), float(prt_part(p)), 0.0, 0.0);
  second = vec4(prt_gradient(p), 0.0);
}
"""


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(5).uniform(-1, 1, (4000, 3)).astype(np.float32)


@pytest.fixture(scope="module")
def drawn(points):
    shown = Pass(implicit.emit(FIELD) + FRAGMENT, {"positions": gl.upload(pixelwise.image(points))}, outputs=2)
    return shown.read()[: len(points)]


def test_distances_are_those_of_numpy(points, drawn):
    np.testing.assert_allclose(drawn[:, 0], FIELD.distance(points), atol=1e-5)


def test_gradients_are_those_of_numpy(points, drawn):
    wrong = np.abs(drawn[:, 4:7] - FIELD.gradient(points)).max(axis=1) > 1e-5
    # on a crease float32 may choose the other side
    assert wrong.mean() < 0.002


def test_parts_are_those_of_numpy(points, drawn):
    wrong = drawn[:, 1] != FIELD.part(points)
    assert wrong.mean() < 0.002
    assert len(np.unique(drawn[:, 1])) == len(PARTS)


@pytest.mark.skipif(shutil.which("glslangValidator") is None, reason="glslangValidator is absent: glslang-tools has it")
@pytest.mark.parametrize("version", VERSIONS)
def test_every_version_is_valid(version):
    assert glsl.validate(glsl.whole(version, implicit.emit(FIELD) + FRAGMENT)) == ""


def test_literals_have_points_and_nothing_is_declared_outside():
    text = implicit.emit(FIELD)
    without_parts = re.sub(r"part = \d+", "", text)
    assert not re.search(r"(?<![\w.+-])\d+(?![\w.])", without_parts), "an int where a float is asked for"
    for word in ("uniform", "for", "while", "#", "[", "main"):
        assert word not in text, word


def test_a_field_of_one_part():
    text = implicit.emit(Analytic((sphere(1.0),)))
    assert "int prt_part(vec3 p)" in text
    assert "if" not in text
