"""Light between surfaces, bounce by bounce: furnaces, linearity, noise that is true, and the path tracer."""

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data import samples
from prtnet.data.lighting import direct
from prtnet.data.lighting.lamp import Lamp, Lighting
from prtnet.data.lightmap import bounces, paths
from prtnet.data.scene import assemble
from tests.data.lightmap.enclosures import closed_box, cornell, ground, quad

ALBEDO = np.array([0.8, 0.5, 0.1])


@pytest.mark.parametrize("count", [1, 4, 40])
def test_furnace(count):
    """In a closed box where 1 arrives everywhere, bounce b brings albedo^b: in the limit albedo / (1 - albedo)."""
    made = ground(closed_box(ALBEDO), 32)
    one = np.ones((2, len(made.albedo), 3), np.float32)
    found = bounces.indirect(*made.texels, one, bounces=count, directions=64, rng=np.random.default_rng(0))
    expected = sum(ALBEDO**bounce for bounce in range(1, count + 1))
    np.testing.assert_allclose(found.values, np.broadcast_to(expected, one.shape), rtol=1e-4)
    assert found.noise.max() < 1e-5
    limit = ALBEDO / (1 - ALBEDO)
    assert found.left_out == pytest.approx((limit - expected).sum() / expected.sum(), rel=1e-3, abs=1e-6)


def test_light_adds_up_and_noise_is_what_repeats_differ_by():
    made, rng = ground(cornell(), 32), np.random.default_rng(0)
    one, other = rng.random((2, len(made.albedo), 3), np.float32)
    every = np.stack([one, other, 0.5 * one + 2 * other])
    first, second = (
        bounces.indirect(*made.texels, every, bounces=2, directions=64, rng=np.random.default_rng(seed))
        for seed in (0, 1)
    )
    np.testing.assert_allclose(first.values[2], 0.5 * first.values[0] + 2 * first.values[1], rtol=1e-4, atol=1e-6)
    spread = np.sqrt(np.mean((first.values - second.values) ** 2) / 2)
    assert np.sqrt(np.mean(first.noise**2)) == pytest.approx(spread, rel=0.1)


def test_configurations_do_not_depend_on_what_is_rendered_with_them(monkeypatch):
    """As many as fit one group: the same rays. More: other rays, the same light."""
    made = ground(closed_box([0.5, 0.5, 0.5]), 32)
    every = np.random.default_rng(0).random((3, len(made.albedo), 3), np.float32)
    options = {"bounces": 2, "directions": 512}
    together = bounces.indirect(*made.texels, every, rng=np.random.default_rng(0), **options)
    monkeypatch.setattr(bounces, "GROUP", 2)
    done = []
    apart = bounces.indirect(*made.texels, every, rng=np.random.default_rng(0), progress=done.append, **options)
    np.testing.assert_array_equal(together.values[:2], apart.values[:2])
    assert done[-1] == 2 * 2 * 2 * len(made.albedo)
    error = np.sqrt(np.mean((together.values[2] - apart.values[2]) ** 2))
    assert 0 < error < 2 * np.sqrt(2 * np.mean(together.noise**2))


def test_direct_and_indirect_light_are_the_path_tracers():
    made, rng = ground(cornell(), 64), np.random.default_rng(0)
    lights = [
        Lighting((Lamp("point", (1, 1, 1), (0.0, 0.5, 0.0)),)),
        Lighting((Lamp("spot", (2, 1, 1), (0.3, 0.4, 0.6), (0.0, -0.8, -0.6)),)),
    ]
    points = made.points
    received = direct.irradiances(lights, made.tracer, points.positions, points.normals, points.geometric_normals)
    found = bounces.indirect(*made.texels, received, directions=256, rng=rng)
    shown = np.flatnonzero(~bounces.hidden(made.tracer, points, made.surface))
    # the undersides of the boxes, a gap above the floor, see texels that are half in the shade
    shown = shown[(points.geometric_normals[shown, 1] > -0.5) & (found.values[0, shown, 0] > 1e-3)]
    some = np.sort(rng.permutation(shown)[:400])
    few = samples.select(points, some)
    traced = paths.radiance(made.tracer, made.scene, few, made.albedo[some], lights, samples=256, rng=rng)
    np.testing.assert_allclose(traced.direct, received[:, some], atol=1e-6)
    for one, other, noise in zip(traced.indirect, found.values[:, some], traced.noise, strict=True):
        error = np.sqrt(np.sum(noise**2)) / len(some)
        assert abs(np.mean(one - other)) < 3 * error + 0.01 * one.mean()
        assert np.median(np.abs(one - other)) < np.median(noise)


def test_a_floor_that_runs_on_below_a_wall_is_not_dark_there():
    """A solid stands on a floor: hidden texels take the values of those beside it, and only these do."""
    box = np.array([[-0.5, 0], [0.5, 0]])
    walls = [
        quad("floor", [-1, 0, 1], [2, 0, 0], [0, 0, -2], two_sided=False),
        quad("east", [box[1, 0], -0.1, 0.5], [0, 0, -1], [0, 1, 0], two_sided=False),
        quad("west", [box[0, 0], -0.1, -0.5], [0, 0, 1], [0, 1, 0], two_sided=False),
        quad("south", [box[0, 0], -0.1, 0.5], [1, 0, 0], [0, 1, 0], two_sided=False),
        quad("north", [box[1, 0], -0.1, -0.5], [-1, 0, 0], [0, 1, 0], two_sided=False),
        quad("roof", [box[0, 0], 0.9, 0.5], [1, 0, 0], [0, 0, -1], two_sided=False),
    ]
    scene = assemble("block", walls)
    made = ground(scene, 64)
    within = bounces.hidden(made.tracer, made.points, made.surface)
    at, floor = made.points.positions, made.points.normals[:, 1] > 0.5
    expected = (np.abs(at[:, [0, 2]]).max(axis=1) < 0.5) & (at[:, 1] < 0.01) & floor
    np.testing.assert_array_equal(within & floor, expected)
    source = bounces.sources(made.points, within)
    np.testing.assert_array_equal(source[~within], np.flatnonzero(~within))
    changed = source != np.arange(len(source))
    edge = expected & (np.abs(at[:, [0, 2]]).max(axis=1) > 0.45)
    assert changed[edge].all()
    assert not changed[np.abs(at[:, [0, 2]]).max(axis=1) < 0.2].any()
    assert not within[source[changed]].any()
    assert np.all(np.einsum("ni,ni->n", made.points.normals, made.points.normals[source]) > 0.5)


def test_what_does_not_fit_is_refused():
    made = ground(closed_box([0.5, 0.5, 0.5]), 32)
    one, rng = np.ones((1, len(made.albedo), 3), np.float32), np.random.default_rng(0)
    with pytest.raises(PrtnetError, match="expected the same number"):
        bounces.indirect(*made.texels, one[:, 1:], rng=rng)
    with pytest.raises(PrtnetError, match="bounces: found 0"):
        bounces.indirect(*made.texels, one, bounces=0, rng=rng)
    with pytest.raises(PrtnetError, match="not finite"):
        bounces.indirect(*made.texels, one * np.float32(np.nan), rng=rng)
    dark = bounces.indirect(*made.texels, 0 * one, directions=16, bounces=1, rng=rng)
    assert not dark.values.any()
    assert dark.left_out == 0
