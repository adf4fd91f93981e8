"""Strands of hair: splines against their polygons and scipy's, arc length, texels and where they lie in a texture."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from prtnet import PrtnetError
from prtnet.data.builtin import make
from prtnet.data.lightmap import strands
from prtnet.data.lightmap.strands import Strands
from prtnet.data.scene import assemble


@pytest.fixture
def some() -> Strands:
    rng = np.random.default_rng(5)
    return Strands(np.cumsum(rng.normal(size=(7, 6, 3)) * 0.1, axis=1), 0.01)


def test_spline_is_scipys_and_reaches_both_ends(some):
    along = np.linspace(0, some.segments - 1e-9, 41)
    for number in range(some.count):
        place, tangent = some.at(np.full(41, number), along)
        controls = some.controls[number]
        spline = BSpline(np.arange(-3, len(controls) + 1), controls, 3)
        np.testing.assert_allclose(place, spline(along), atol=1e-9)
        slope = spline.derivative()(along)
        np.testing.assert_allclose(tangent, slope / np.linalg.norm(slope, axis=1, keepdims=True), atol=1e-7)
    ends, _ = some.at(np.arange(7)[:, None], np.array([[0.0, some.segments]]))
    np.testing.assert_allclose(ends, some.points[:, [0, -1]], atol=1e-12)


def test_share_and_parameter_are_inverse(some):
    rng = np.random.default_rng(0)
    strand, share = rng.integers(0, 7, 500), np.concatenate([[0.0, 1.0], rng.random(498)])
    parameter = some.parameter(strand, share)
    assert parameter.min() >= 0
    assert parameter.max() <= some.segments
    np.testing.assert_allclose(some.share(strand, parameter), share, atol=1e-12)


def test_texels_are_even_along_a_straight_strand():
    line = Strands(np.array([[[0, 0, 0], [0, 0.1, 0], [0, 0.5, 0], [0, 1.0, 0]]]), 0.01)
    places, tangents = strands.texels(line)
    np.testing.assert_allclose(places[:, 1], np.arange(0.05, 1, 0.1), atol=2e-3)
    np.testing.assert_allclose(tangents, np.broadcast_to([0, 1, 0], (10, 3)), atol=1e-12)


def test_blend_between_the_middles_of_texels():
    at, weights = strands.blend(np.array([2, 2, 2, 2]), np.array([0.0, 0.25, 0.30, 1.0]))
    np.testing.assert_allclose(np.sum(at * weights, axis=1) - 20, [0, 2.0, 2.5, 9], atol=1e-12)
    assert at.min() >= 20
    assert at.max() <= 29


@pytest.mark.parametrize("count", [1, 2, 11, 600])
def test_layout_gives_every_strand_ten_texels_of_a_row(count):
    index, size = strands.layout(count)
    assert len(np.unique(index)) == 10 * count
    assert index.max() < size * size
    rows = (index // size).reshape(count, 10)
    assert (rows == rows[:, :1]).all()
    assert (np.diff(index.reshape(count, 10)) == 1).all()


def test_strands_of_the_builtin_hair_lie_where_its_triangles_do():
    curves, body = strands.of_builtin(60)
    whole, scene = strands.of_builtin(1800)[0], make("hair")
    part = next(i for i, material in enumerate(scene.materials) if material.name == "hair")
    corners = scene.vertices[np.unique(scene.faces[scene.part == part])]
    wide = np.ptp(whole.points.reshape(-1, 3), axis=0)
    # the scene's own coordinates are another scale of the same shape
    ratio = wide / np.ptp(corners, axis=0)
    np.testing.assert_allclose(ratio, ratio[0], rtol=0.03)
    assert np.abs(curves.points).max() <= 1 + 1e-9
    assert len(body.faces) > 100
    assert curves.radius > whole.radius
    with pytest.raises(PrtnetError, match="expected 1 to"):
        strands.of_builtin(100_000)


def test_ribbons_are_as_long_and_wide_as_their_strands():
    curves = strands.straight(8, np.random.default_rng(1), radius=0.02)
    scene = assemble("tuft", [strands.ribbons(curves)])
    np.testing.assert_allclose(scene.face_areas.sum(), 8 * 1.0 * 0.04, rtol=1e-3)
    assert scene.two_sided.all()


def test_text_has_a_line_for_each_control_point(some):
    lines = strands.text(some).split("\n")
    assert sum(bool(line) for line in lines) == some.controls.shape[0] * some.controls.shape[1]
    np.testing.assert_allclose([float(word) for word in lines[0].split()[:3]], some.controls[0, 0], rtol=1e-6)


@pytest.mark.parametrize(
    ("points", "radius", "word"),
    [
        (np.zeros((1, 1, 3)), 0.1, "of 1 points"),
        (np.arange(6.0).reshape(1, 2, 3), 0.0, "radius of 0"),
        (np.zeros((1, 3, 3)), 0.1, "without length"),
    ],
)
def test_what_are_no_strands_is_refused(points, radius, word):
    with pytest.raises(PrtnetError, match=word):
        Strands(points, radius)
