"""Direct irradiance: closed forms, what stands in the way, and the compiled rays against their NumPy twin."""

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import builtin
from prtnet.data.lighting import direct
from prtnet.data.lighting.lamp import Lamp, Lighting, together
from prtnet.data.samples import area_uniform
from prtnet.data.tracer import Tracer
from tests.data.ray_scenes import join, quad

FLOOR = quad([-1, 0, -1], [0, 0, 2], [2, 0, 0])
UP = np.array([[0.0, 1, 0]])


def under(lamp, point, *others, normal=UP, side=UP, kind="auto"):
    """Irradiance of one point on the floor, other quads in the scene. The floor is the scene's longest extent."""
    tracer = Tracer(join(FLOOR, *others).centred(), kind=kind)
    middle = join(FLOOR, *others).frame.centre
    found = direct.irradiance(Lighting((lamp,)), tracer, np.array([point]) - middle, normal, side)
    assert found.shape == (1, 3)
    assert found.dtype == np.float32
    return found[0]


def above(lamp_kind="point", *, height=0.5, shift=0.0, **words):
    return Lamp(lamp_kind, (1.0, 2.0, 3.0), (0.0, height - shift, 0.0), **words)


def test_a_point_lamp_sends_its_colour_by_the_square_of_the_distance_and_the_cosine():
    squared = 0.5**2 + 0.3**2
    expected = np.array([1, 2, 3]) / squared * 0.5 / np.sqrt(squared)
    np.testing.assert_allclose(under(above(), [0.3, 0, 0]), expected, rtol=1e-6)


@pytest.mark.parametrize("kind", ["fused", "embreex"])
def test_only_what_is_between_a_lamp_and_a_point_casts_a_shadow(kind):
    def with_quad_at(height):
        # the frame's centre moves up by half the height
        lid = quad([-0.5, height, -0.5], [0, 0, 1], [1, 0, 0])
        return under(above(shift=height / 2), [0.1, 0, 0], lid, kind=kind)

    np.testing.assert_array_equal(with_quad_at(0.4), 0)
    # beyond the lamp, and nearly at it
    squared = 0.5**2 + 0.1**2
    expected = np.array([1, 2, 3]) * 0.5 / squared**1.5
    np.testing.assert_allclose(with_quad_at(0.6), expected, rtol=1e-6)
    np.testing.assert_allclose(with_quad_at(0.501), expected, rtol=1e-6)


def test_a_spot_fades_between_its_angles():
    spot = above("spot", aim=(0.0, -1.0, 0.0), inner=20.0, outer=40.0)
    for degrees, share in ((0, 1), (19.9, 1), (40.1, 0)):
        x = 0.5 * np.tan(np.radians(degrees))
        full = under(above(), [x, 0, 0])
        np.testing.assert_allclose(under(spot, [x, 0, 0]), share * full, rtol=1e-5)
    x = 0.5 * np.tan(np.radians(30))
    step = (np.cos(np.radians(30)) - np.cos(np.radians(40))) / (np.cos(np.radians(20)) - np.cos(np.radians(40)))
    np.testing.assert_allclose(under(spot, [x, 0, 0]), (3 - 2 * step) * step**2 * under(above(), [x, 0, 0]), rtol=1e-5)


def test_light_from_afar_comes_along_its_aim_and_not_from_behind():
    aim = np.array([0.6, -0.8, 0])
    sun = Lamp("directional", (1.0, 2.0, 3.0), aim=(0.6, -0.8, 0.0))
    np.testing.assert_allclose(under(sun, [0, 0, 0]), 0.8 * np.array([1, 2, 3]), rtol=1e-6)
    leaning = -aim[None]
    np.testing.assert_allclose(under(sun, [0, 0, 0], normal=leaning), [1, 2, 3], rtol=1e-6)
    # the shading normal sees the light, the surface does not
    np.testing.assert_array_equal(under(sun, [0, 0, 0], normal=leaning, side=-UP), 0)
    np.testing.assert_array_equal(under(sun, [0, 0, 0], normal=aim[None]), 0)


LAMPS = {
    "point": Lamp("point", (1.0, 1.0, 1.0), (0.3, 0.4, 0.2)),
    "spot": Lamp("spot", (1.0, 1.0, 1.0), (0.9, 0.7, 0.2), aim=(-0.8, -0.6, 0.0), inner=10.0, outer=45.0),
    "directional": Lamp("directional", (1.0, 1.0, 1.0), aim=(0.48, -0.8, 0.36)),
}


def test_compiled_rays_and_their_twin_agree_on_every_point():
    scene = builtin.make("plants", tessellation=0.3).centred()
    points = area_uniform(scene, 5003, np.random.default_rng(0))
    places = points.positions, points.normals, points.geometric_normals
    fused, plain = Tracer(scene, kind="fused"), Tracer(scene, kind="embreex")
    for lamp in LAMPS.values():
        found = direct.irradiance(Lighting((lamp,)), fused, *places)
        twin = direct.irradiance(Lighting((lamp,)), plain, *places)
        np.testing.assert_allclose(found, twin, rtol=1e-6)
        assert 0.02 < np.mean(found > 0) < 0.98
    assert fused.rays_traced == 3 * 5003


def test_lights_add_up_and_many_are_as_one_by_one():
    scene = builtin.make("cornell").centred()
    points, tracer = area_uniform(scene, 500, np.random.default_rng(0)), Tracer(scene)
    places = points.positions, points.normals, points.geometric_normals
    rng = np.random.default_rng(1)
    transfer = rng.random((500, 9)).astype(np.float32)
    sky = Lighting((), rng.normal(size=(4, 3)).astype(np.float32))
    every = [*(Lighting((lamp,)) for lamp in LAMPS.values()), sky]
    found = direct.irradiances(every, tracer, *places, transfer=transfer, threads=2)
    for lighting, values in zip(every, found, strict=True):
        np.testing.assert_array_equal(direct.irradiance(lighting, tracer, *places, transfer=transfer), values)
    # bands that the transfer has and the light has not are 0; what rings stays negative
    np.testing.assert_allclose(found[3], transfer[:, :4] @ sky.environment, rtol=1e-5, atol=1e-6)
    assert found[3].min() < 0
    np.testing.assert_allclose(
        direct.irradiance(together(every), tracer, *places, transfer=transfer), found.sum(axis=0), rtol=1e-4, atol=1e-5
    )


def test_no_points_and_bad_input():
    tracer = Tracer(join(FLOOR).centred())
    lit, sky = Lighting((above(),)), Lighting((), np.zeros((9, 3), np.float32))
    nothing = np.zeros((0, 3))
    assert direct.irradiance(lit, tracer, nothing, nothing, nothing).shape == (0, 3)
    with pytest.raises(PrtnetError, match="9 SH coefficients and a transfer of 0"):
        direct.irradiance(sky, tracer, UP, UP, UP)
    with pytest.raises(PrtnetError, match="9 SH coefficients and a transfer of 4"):
        direct.irradiance(sky, tracer, UP, UP, UP, transfer=sh.cosine_lobe(UP, 2))
    with pytest.raises(PrtnetError, match="not finite"):
        direct.irradiance(lit, tracer, UP * np.nan, UP, UP)
