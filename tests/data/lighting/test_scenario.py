"""Lights of a scenario: where they stand, how bright they are, and scenes that they do not reach."""

from functools import cache

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import builtin
from prtnet.data.lighting import direct, placing, scenario
from prtnet.data.lighting.lamp import to_dict, together
from prtnet.data.samples import area_uniform
from prtnet.data.tracer import Tracer
from tests.data.lighting.test_placing import TABLE, WALLS, scene_of

SCENES = {name: builtin.make(name, tessellation=0.3).centred() for name in ("cornell", "plants")}
TRACERS = {name: Tracer(scene) for name, scene in SCENES.items()}


def draw(name, kinds, count=24, seed=0, **words):
    return scenario.draw(kinds, count, SCENES[name], TRACERS[name], np.random.default_rng(seed), **words)


@cache
def lit_points(name):
    scene = SCENES[name]
    points = area_uniform(scene, 1000, np.random.default_rng(5))
    worth, _ = placing.Places(scene, TRACERS[name]).worth(points)
    return tuple(each[worth] for each in (points.positions, points.normals, points.geometric_normals))


def received(name, lightings):
    """Irradiance at points of the scene that light can reach, of one colour."""
    return direct.irradiances(lightings, TRACERS[name], *lit_points(name), threads=1)[..., 0]


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("kind", ["point", "spot", "directional"])
def test_lamps_stand_free_and_light_the_scene_to_the_order_of_one(name, kind):
    drawn = draw(name, [kind])
    placing.check(together(drawn), SCENES[name], TRACERS[name])
    assert all(len(each.lamps) == 1 and each.lamps[0].kind == kind for each in drawn)
    found = received(name, drawn)
    assert np.all(np.any(found > 0, axis=1))
    means = found.sum(axis=1) / np.sum(found > 0, axis=1)
    # of other points than those they were scaled by
    assert 0.5 < np.median(means) < 2
    assert 2 < means.max() / means.min() < 16


def test_lamps_stay_between_walls_and_go_around_things():
    inner, outer = (np.array([each.lamps[0].position for each in draw(name, ["point"], 64)]) for name in SCENES)
    assert np.abs(inner).max() < 1
    low, high = SCENES["plants"].vertices.min(axis=0), SCENES["plants"].vertices.max(axis=0)
    share = np.mean(np.any((outer < low) | (outer > high), axis=1))
    assert 0.2 < share < 0.8
    assert np.all(outer[:, 1] > low[1])
    assert np.all(outer.std(axis=0) > 0.2)


def test_spots_see_what_they_aim_at():
    scene, tracer = SCENES["cornell"], TRACERS["cornell"]
    angles = []
    for lighting in draw("cornell", ["spot"]):
        (spot,) = lighting.lamps
        angles.append(spot.outer)
        at, aim = np.array([spot.position]), np.array([spot.aim])
        face, _, _ = tracer.hits(at.astype(np.float32), aim.astype(np.float32))
        # the front of a surface
        assert face[0] >= 0
        assert scene.face_normals[face[0]] @ aim[0] < 0
    assert scenario.HALF_ANGLES[0] <= min(angles) < max(angles) <= scenario.HALF_ANGLES[1]


def test_most_light_from_afar_comes_from_above():
    aims = np.array([each.lamps[0].aim for each in draw("plants", ["directional"], 64)])
    np.testing.assert_allclose(np.linalg.norm(aims, axis=1), 1, rtol=1e-6)
    assert 0.8 < np.mean(aims[:, 1] < 0) <= 1
    assert np.all(np.abs(aims[:, [0, 2]].mean(axis=0)) < 0.3)


def test_environments_are_smooth_and_bright_enough():
    directions, weights = sh.quadrature(20)
    lowest, means = [], []
    for lighting in draw("plants", ["environment"], 64, colours="random", bands=5):
        assert lighting.lamps == ()
        assert lighting.environment is not None
        assert lighting.environment.shape == (25, 3)
        radiance = sh.evaluate(directions, 5) @ lighting.environment
        means.append(weights @ radiance / (4 * np.pi))
        lowest.append(radiance.min() / radiance.max())
    brightness = np.mean(means, axis=1)
    assert 0.5 <= brightness.min() < 0.7
    assert 1.5 < brightness.max() <= 2
    # ringing stays small
    assert np.quantile(lowest, 0.1) > -0.02
    assert min(lowest) > -0.1
    assert np.median(np.ptp(means, axis=1) / brightness) > 0.2


def test_random_colours_are_colours_and_white_is_white():
    colours = np.array([each.lamps[0].colour for each in draw("cornell", ["point"], 64, colours="random")])
    shares = colours / colours.sum(axis=1, keepdims=True)
    assert np.all(np.ptp(shares, axis=1) > 0.15)
    # all hues
    assert set(shares.argmax(axis=1)) == {0, 1, 2}
    white = np.array([each.lamps[0].colour for each in draw("cornell", ["point"])])
    np.testing.assert_allclose(white, np.repeat(white[:, :1], 3, axis=1))


def test_kinds_take_turns_and_few_are_the_first_of_many():
    kinds = ["spot", "environment", "point", "directional"]
    many = draw("cornell", kinds, 10, seed=3)
    for index, lighting in enumerate(many):
        kind = lighting.lamps[0].kind if lighting.lamps else "environment"
        assert kind == kinds[index % 4]
    few = draw("cornell", kinds, 6, seed=3)
    assert [to_dict(each) for each in few] == [to_dict(each) for each in many[:6]]
    assert to_dict(draw("cornell", kinds, 1, seed=4)[0]) != to_dict(many[0])


@pytest.mark.parametrize("kind", ["directional", "environment"])
def test_a_scenario_without_light(kind):
    scene = scene_of((*WALLS, "room"), (*TABLE, "solid"))
    tracer, rng = Tracer(scene), np.random.default_rng(0)
    assert len(scenario.draw(["point", "spot"], 4, scene, tracer, rng)) == 4
    with pytest.raises(PrtnetError, match=f"no {kind} light that reaches the scene boxes"):
        scenario.draw([kind], 4, scene, tracer, rng)


def test_a_scene_without_room_for_a_lamp(monkeypatch):
    full = scene_of((*WALLS, "room"), ([-0.99] * 3, [0.99] * 3, "solid"))
    with pytest.raises(PrtnetError, match="no point light that reaches the scene boxes"):
        scenario.draw(["point"], 1, full, Tracer(full), np.random.default_rng(0))
    monkeypatch.setattr(placing.Places, "free", lambda self, positions, clear: np.zeros(len(positions), bool))
    with pytest.raises(PrtnetError, match="no free place for a lamp"):
        draw("plants", ["point"])


def test_unknown_words():
    for kinds in ([], ["spot", "moon"]):
        with pytest.raises(PrtnetError, match=r"data_driven\.scenario: found .* expected one or more of point, spot"):
            scenario.check(kinds, "white")
    with pytest.raises(PrtnetError, match=r"data_driven\.colours: found 'pink', expected white or random"):
        scenario.check(["spot"], "pink")
