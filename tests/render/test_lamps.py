"""Direct light of lamps on screen and at measurement points: closed forms, shadow edges, and rays."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from prtnet import PrtnetError, gl, sh
from prtnet.data import atlas, builtin, texture
from prtnet.data.atlas import Atlas
from prtnet.data.lighting import direct
from prtnet.data.lighting.lamp import Lamp, Lighting, arriving, together
from prtnet.data.samples import area_uniform
from prtnet.data.tracer import Tracer
from prtnet.data_driven import Measurement
from prtnet.export import lamps as export
from prtnet.render.camera import Camera
from prtnet.render.lamps import LampMethod
from prtnet.render.measure import Measure
from prtnet.render.raster import Raster
from prtnet.render.shadow_maps import ShadowMaps
from tests.render.meshes import quad, scene, sphere

SIZE, MAP = 96, 512
ABOVE = Camera((0.0, 3.0, 0.001), (0.0, 0.0, 0.0), fov_y=40.0, near=0.1, far=10.0)
INTO = Camera((0.4, 0.3, 3.6), (0.0, 0.0, 0.0), near=0.5, far=8.0)


def towards(start, end) -> tuple:
    aim = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    return tuple(aim.tolist())


HIGH = (0.2, 0.8, 0.3)
LAMPS = {
    "point": Lamp("point", (3.0, 2.0, 1.0), HIGH),
    "spot": Lamp("spot", (3.0, 2.0, 1.0), HIGH, towards(HIGH, (0.0, 0.0, 0.1)), 20.0, 35.0),
    "wide spot": Lamp("spot", (3.0, 2.0, 1.0), HIGH, towards(HIGH, (0.4, 0.0, 0.1)), 30.0, 70.0),
    "directional": Lamp("directional", (3.0, 2.0, 1.0), aim=towards((0.2, 0.8, 0.3), (0.0, 0.0, 0.0))),
}


def lit(*names: str, environment=None) -> Lighting:
    return Lighting(tuple(LAMPS[name] for name in names), environment)


def bare(parts_of) -> Raster:
    """Without a place for each point in an atlas."""
    split = parts_of.centred().split_sides()
    return Raster(Atlas(split, np.zeros((len(split.vertices), 2), np.float32), "none", float("nan")), SIZE)


def floor(**more):
    return quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), name="floor", **more)


def roof():
    """Half a unit above the floor; the floor stays the largest."""
    return quad((-0.4, 0.5, 0.3), (0.8, 0, 0), (0, 0, -0.6), name="roof", two_sided=True)


@pytest.fixture(scope="module")
def covered():
    return bare(scene(floor(), roof()))


@pytest.fixture(scope="module")
def cornell():
    return bare(builtin.make("cornell", tessellation=0.25))


def drawn(method: LampMethod, camera: Camera, lighting: Lighting):
    """(irradiance at the covered pixels, the G-buffer)"""
    found = method.raster.gbuffer(camera)
    image = method.draw(camera, lighting).reshape(-1, 3)[found.pixel]
    return image * pi / found.albedo, found


def unblocked(lighting: Lighting, positions, normals) -> np.ndarray:
    total = np.zeros((len(positions), 3))
    for lamp in lighting.lamps:
        direction, _, strength = arriving(lamp, positions)
        cosine = np.maximum(np.einsum("ni,ni->n", direction, normals), 0)
        total += (strength * cosine)[:, None] * np.array(lamp.colour)
    return total


def received(shadows: ShadowMaps, lighting: Lighting, positions, normals, sides=None) -> np.ndarray:
    """Irradiance by the shader at exact points, which those of pixels are not."""
    place, normal, side = (
        np.asarray(v, np.float32)[:, None] for v in (positions, normals, normals if sides is None else sides)
    )
    nothing = np.zeros((len(place), 0, 3), np.float32)
    measure = Measure(Measurement(place, normal, side, np.full_like(place, pi), nothing), shadows)
    measure.draw(lighting)
    return measure.read()


def on_floor(height: float = 0.0, count: int = 5000):
    """(points, their normals)"""
    found = np.random.default_rng(7).uniform(-1, 1, (count, 3)) * [1, 0, 1] + [0, height, 0]
    return found, np.tile([0.0, 1.0, 0.0], (count, 1))


@pytest.mark.parametrize("name", LAMPS)
def test_an_open_floor_is_lit_in_closed_form(name):
    shadows = ShadowMaps(scene(floor()), 64)
    expected = unblocked(lit(name), *on_floor())
    assert (expected > 0.1).mean() > 0.2
    np.testing.assert_allclose(received(shadows, lit(name), *on_floor()), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", LAMPS)
def test_the_shadow_of_a_plate_is_where_it_is_in_closed_form(covered, name):
    # centred, the floor is a quarter below and the roof a quarter above the middle
    floor_points, up = on_floor(-0.25)
    found = received(ShadowMaps(covered.scene, MAP), lit(name), floor_points, up)
    direction = arriving(LAMPS[name], floor_points)[0]
    crossing = floor_points + direction * (0.5 / direction[:, 1:2])
    past = np.maximum(np.abs(crossing[:, 0]) - 0.4, np.abs(crossing[:, 2]) - 0.3)
    # the widest texel there is on the floor, of parallel light across the diagonal
    texel = 3.0 / MAP
    expected = unblocked(lit(name), floor_points, up)
    assert (past < -1.5 * texel).sum() > 300
    assert not found[past < -1.5 * texel].any()
    far = past > 1.5 * texel
    np.testing.assert_allclose(found[far], expected[far], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("size", [64, 1024])
@pytest.mark.parametrize("name", LAMPS)
def test_a_sphere_has_no_shadow_on_its_lit_side(name, size):
    """No acne at any angle nor in any size of map; the other side is dark."""
    ball, lamp = scene(sphere(48)), LAMPS[name]
    if lamp.kind != "directional":
        lamp = replace(lamp, position=(1.2, 1.6, 2.0), aim=towards((1.2, 1.6, 2.0), (0.1, 0.0, 0.2)))
    points, lighting = area_uniform(ball, 4000, np.random.default_rng(0)), Lighting((lamp,))
    side = np.einsum("ni,ni->n", arriving(lamp, points.positions)[0], points.geometric_normals)
    found = received(ShadowMaps(ball, size), lighting, points.positions, points.geometric_normals)
    expected = unblocked(lighting, points.positions, points.geometric_normals)
    assert (side > 0.01).sum() > 500
    # where facets meet at grazing angles a tap in the corner of the filter may differ
    np.testing.assert_allclose(found[side > 0.01], expected[side > 0.01], rtol=1e-3, atol=0.01)
    assert not found[side < -1e-4].any()


def test_pixels_are_lit_like_their_points(covered):
    """With the normals of triangles from derivatives of positions."""
    for raster, camera in ((covered, ABOVE), (bare(scene(sphere(24))), Camera((1.0, 1.0, 3.0), (0.0, 0.0, 0.0)))):
        shadows = ShadowMaps(raster.scene, MAP)
        for name in LAMPS:
            found, points = drawn(LampMethod(raster, shadows=shadows), camera, lit(name))
            expected = received(shadows, lit(name), points.positions, points.normals, points.geometric_normals)
            off = np.abs(found - expected).max(axis=1) / max(expected.max(), 1)
            assert np.mean(off > 0.01) < 0.005
            assert np.median(off) < 1e-4


@pytest.mark.parametrize("name", LAMPS)
def test_a_room_of_boxes_is_lit_as_rays_say(cornell, name):
    """But at the edges of shadows, where a map has texels."""
    lamp = LAMPS[name]
    lamp = replace(lamp, aim=towards((0.3, 0.4, 0.9), (0, 0, 0))) if name == "directional" else lamp
    method = LampMethod(cornell, shadows=ShadowMaps(cornell.scene, MAP))
    found, points = drawn(method, INTO, Lighting((lamp,)))
    surface = points.positions.astype(np.float64), points.normals, points.geometric_normals
    expected = direct.irradiance(Lighting((lamp,)), Tracer(cornell.scene), *surface)
    wrong = np.abs(found - expected).max(axis=1) > 0.02 * np.percentile(expected, 95)
    assert wrong.mean() < 0.02
    shown = np.zeros(SIZE * SIZE)
    shown[points.pixel] = 1 + (expected.max(axis=1) > 0)
    image = shown.reshape(SIZE, SIZE)
    inner = (minimum_filter(image, 3) == maximum_filter(image, 3)).reshape(-1)[points.pixel]
    assert inner.mean() > 0.7
    assert (wrong & inner).mean() < 1e-3


def test_shading_normals_bend_the_cosine_but_let_no_light_through():
    leaning = np.array([0.6, 0.8, 0.0])
    part = floor(normals=np.tile(leaning, (4, 1)))
    lamps = [Lamp("directional", (1.0, 1.0, 1.0), aim=towards((0, 0, 0), aim)) for aim in ((-1, -1, 0), (-1, 0.1, 0))]
    raster = bare(scene(part))
    method = LampMethod(raster)
    found, _ = drawn(method, ABOVE, Lighting((lamps[0],)))
    np.testing.assert_allclose(found, 1.4 / np.sqrt(2), rtol=1e-4)
    # from below, though the shading normal would see it
    assert not drawn(method, ABOVE, Lighting((lamps[1],)))[0].any()


def test_lamps_add_up_and_none_is_dark(covered):
    method = LampMethod(covered, shadows=ShadowMaps(covered.scene, 64))
    each = [method.draw(ABOVE, lit(name)) for name in ("point", "spot", "directional")]
    np.testing.assert_allclose(method.draw(ABOVE, lit("point", "spot", "directional")), sum(each), atol=1e-5)
    assert not method.draw(ABOVE, Lighting()).any()
    alone = LampMethod(covered, shadows=ShadowMaps(covered.scene, 64, room=1))
    np.testing.assert_allclose(alone.draw(ABOVE, lit("spot")), each[1], atol=1e-6)


def test_maps_follow_lamps_and_are_kept_for_lamps_that_stay(covered, monkeypatch):
    shadows, moved = ShadowMaps(covered.scene, 64), replace(LAMPS["point"], position=(-0.3, 0.9, 0.1))
    method, layers = LampMethod(covered, shadows=shadows), []
    draw = ShadowMaps._draw
    monkeypatch.setattr(
        ShadowMaps, "_draw", lambda self, layer, matrix: (layers.append(layer), draw(self, layer, matrix))
    )
    first = method.draw(ABOVE, lit("point"))
    assert layers == list(range(6))
    # another colour, the same place
    brighter = replace(LAMPS["point"], colour=(6.0, 4.0, 2.0))
    np.testing.assert_allclose(method.draw(ABOVE, Lighting((brighter,))), 2 * first, rtol=1e-5)
    assert len(layers) == 6
    second = method.draw(ABOVE, Lighting((moved,)))
    assert np.abs(second - first).max() > 0.1
    fresh = LampMethod(covered, shadows=ShadowMaps(covered.scene, 64)).draw(ABOVE, Lighting((moved,)))
    np.testing.assert_array_equal(second, fresh)
    # another method with the same maps and another light in between
    other = LampMethod(covered, shadows=shadows)
    other.set_lighting(lit("point"))
    method.render(ABOVE)
    np.testing.assert_array_equal(covered.target.read()[..., :3], second)
    assert method.milliseconds(ABOVE, lit("directional"), 1, moving=True) > 0
    assert layers[-2:] == [0, 0]


def test_light_from_far_away_is_added_by_transfer_textures():
    laid = atlas.make(scene(floor()), size=32)
    rng = np.random.default_rng(4)
    transfer, light = rng.random(9), rng.normal(size=(9, 3)).astype(np.float32)
    # of a bake with bounces the first group counts
    page = texture.page_of(np.broadcast_to(np.concatenate([transfer, np.full(27, 9.0)]), (32, 32, 36)))
    method = LampMethod(Raster(laid, SIZE), pages=[page], groups=4)
    for bands in (3, 2):
        some = light[: sh.count(bands)]
        lamps_alone, points = drawn(method, ABOVE, lit("spot"))
        found, _ = drawn(method, ABOVE, lit("spot", environment=some))
        expected = np.broadcast_to(transfer[: len(some)] @ some, (len(points.pixel), 3))
        np.testing.assert_allclose(found - lamps_alone, expected, rtol=1e-4, atol=1e-4)
    with pytest.raises(PrtnetError, match="environment of 16 SH coefficients, expected at most 9"):
        method.set_lighting(Lighting((), np.zeros((16, 3), np.float32)))


def test_callers_add_irradiance_radiance_and_textures(covered):
    extra = gl.upload(np.full((1, 1, 3), 0.25, np.float32))
    source = "uniform sampler2D extra;\nvec3 more() { return texture(extra, atlas_uv).rgb * position.y; }\n"
    shadows = ShadowMaps(covered.scene, 64)
    plain, points = drawn(LampMethod(covered, shadows=shadows), ABOVE, lit("spot"))
    words = {"source": source, "textures": {"extra": extra}, "shadows": shadows}
    received, _ = drawn(LampMethod(covered, received="more()", **words), ABOVE, lit("spot"))
    expected = 0.25 * points.positions[:, 1:2]
    np.testing.assert_allclose(received - plain, np.broadcast_to(expected, plain.shape), atol=1e-5)
    alone = LampMethod(covered, leaving="more()", direct=False, **words).draw(ABOVE, lit("spot"))
    leaving = alone.reshape(-1, 3)[points.pixel]
    np.testing.assert_allclose(leaving, np.broadcast_to(expected, plain.shape), atol=1e-5)


def test_what_cannot_be_drawn_is_said(covered):
    with pytest.raises(PrtnetError, match="size of 63 texels, expected 64 to"):
        ShadowMaps(covered.scene, 63)
    method = LampMethod(covered, shadows=ShadowMaps(covered.scene, 64, room=1))
    with pytest.raises(PrtnetError, match="2 lamps, expected at most 1"):
        method.draw(ABOVE, lit("spot", "point"))
    with pytest.raises(PrtnetError, match="environment of 4 SH coefficients, expected at most 0"):
        method.draw(ABOVE, lit("spot", environment=np.ones((4, 3), np.float32)))


def measured(scene_of, count: int, each: int, coefficients: int = 0) -> Measurement:
    """Surface points in no order, so that their means are of shadows as well."""
    rng = np.random.default_rng(6)
    found = area_uniform(scene_of, count * each, rng)
    shaped = [v.reshape(count, each, 3) for v in (found.positions, found.normals, found.geometric_normals)]
    albedo, transfer = rng.random((count, each, 3)), rng.normal(size=(count, coefficients, 3))
    return Measurement(*(np.asarray(v, np.float32) for v in (*shaped, albedo, transfer)))


def by_rays(measurement: Measurement, lighting: Lighting, tracer: Tracer) -> np.ndarray:
    fields = measurement.positions, measurement.normals, measurement.geometric_normals
    flat = [v.reshape(-1, 3).astype(np.float64) for v in fields]
    got = direct.irradiance(lighting, tracer, *flat).reshape(measurement.positions.shape)
    return (measurement.albedo / pi * got).mean(axis=1)


def test_the_direct_vector_is_what_rays_find(cornell):
    points, tracer = measured(cornell.scene, 60, 8), Tracer(cornell.scene)
    measure = Measure(points, ShadowMaps(cornell.scene, 1024))
    for lighting in (lit("point"), lit("spot"), lit("wide spot", "directional"), lit("point", "spot")):
        measure.draw(lighting)
        expected = by_rays(points, lighting, tracer)
        assert expected.max() > 0.1
        # one of eight points at the edge of a shadow may say otherwise
        off = np.abs(measure.read() - expected).max(axis=1) / expected.max()
        assert np.mean(off > 1e-3) < 0.1
        assert off.mean() < 0.01
    assert measure.texture.size == (60, 1)


def test_the_direct_vector_is_linear_and_takes_light_from_far_away(cornell):
    points = measured(cornell.scene, 20, 3, 9)
    measure = Measure(points, ShadowMaps(cornell.scene, 64))
    light = np.random.default_rng(1).normal(size=(9, 3)).astype(np.float32)
    one, other = lit("point"), lit("spot", environment=light)
    vectors = []
    for lighting in (one, other, together([one, other]), lit("spot")):
        measure.draw(lighting)
        vectors.append(measure.read())
    np.testing.assert_allclose(vectors[2], vectors[0] + vectors[1], atol=1e-5)
    expected = np.einsum("mkc,kc->mc", points.transfer, light)
    np.testing.assert_allclose(vectors[1] - vectors[3], expected, atol=1e-5)
    with pytest.raises(PrtnetError, match="environment of 16 SH coefficients, expected at most 9"):
        measure.draw(Lighting((), np.zeros((16, 3), np.float32)))


def test_points_outside_of_the_scene_are_lit_where_nothing_is_in_the_way(covered):
    """A hull reaches further than what casts shadows."""
    shadows, tracer = ShadowMaps(covered.scene, 64), Tracer(covered.scene)
    (map_of_sun,) = export.shadow_matrices(LAMPS["directional"], shadows.box)
    beside = np.array([[1.4, 0.1, 0.0], [0.0, -1.3, 0.5], [0.95, 0.95, 2.0], [0.0, 0.0, 3.0], [-0.97, 0.0, 0.2]])
    places = np.linalg.solve(map_of_sun[:3, :3], (beside - map_of_sun[:3, 3]).T).T
    up = np.tile([0.0, 1.0, 0.0], (len(places), 1))
    for name in ("point", "directional"):
        expected = direct.irradiance(lit(name), tracer, places, up, up)
        assert (expected > 0).any()
        np.testing.assert_allclose(received(shadows, lit(name), places, up), expected, rtol=1e-4)
