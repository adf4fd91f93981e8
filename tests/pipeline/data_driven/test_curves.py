"""Curves of one database: what they say of transports that are known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from prtnet.data.lighting.lamp import Lamp, Lighting, together
from prtnet.models.data_driven import Pairs, learn
from prtnet.pipeline.data_driven import colours, curves, errors

TEXELS, POINTS = 400, 32
ALBEDO = np.array([0.8, 0.5, 0.3])


def transport(seed: int) -> np.ndarray:
    """Smooth along a line of texels, points in any order: every beginning of them is spread."""
    order = np.random.default_rng(1).permutation(POINTS)
    across = np.linspace(0, 1, TEXELS)[:, None] - np.linspace(0, 1, POINTS)[None, order]
    return np.exp(-((across - 0.1 * seed) ** 2) / 0.02) / POINTS


def pairs(count: int, seed: int, moved: int = 0) -> Pairs:
    """Lights of random width and place along the line."""
    rng = np.random.default_rng(seed)
    order = np.random.default_rng(1).permutation(POINTS)
    place, width = rng.random((count, 1)), rng.uniform(0.05, 0.2, (count, 1))
    light = np.exp(-(((np.linspace(0, 1, POINTS)[order] - place) / width) ** 2))
    direct = (rng.uniform(0.5, 2, (count, 1)) * light)[..., None] * ALBEDO
    maps = np.einsum("tm,cmh->cth", transport(moved), direct)
    return Pairs(maps.astype(np.float32), direct.astype(np.float32))


@pytest.fixture(scope="module")
def database():
    return pairs(40, 2), pairs(9, 3)


LIGHTINGS = [Lighting((Lamp(kind, (1, 1, 1)),)) for kind in ("spot", "point", "spot")] * 3
WORDS = {"elements": 6, "ridge": 1e-3, "rng": np.random.default_rng(5)}


@pytest.fixture(scope="module")
def measured(database):
    noise = np.full(TEXELS, 2e-3, np.float32)
    return curves.measure(*database, noise=noise, lightings=LIGHTINGS, **WORDS)


def test_errors_are_those_of_the_evaluator_light_by_light(database):
    # a transport of its own for red
    one, others = np.array([1, 0, 0], np.float32), np.array([0, 1, 1], np.float32)
    training, unseen = (
        replace(each, lightmaps=each.lightmaps[:, ::-1] * one + each.lightmaps * others) for each in database
    )
    learned = learn(training, elements=5, ridge=1e-3, channels="separate", gamma=2.2)
    found = curves.errors(learned, unseen, gamma=2.2)
    wrong, far, whole = 0.0, 0.0, 0.0
    for maps, direct in zip(unseen.lightmaps.astype(float), unseen.direct.astype(float), strict=True):
        for h in range(3):
            scale = 1 / np.sum(direct[:, h] ** 2)
            made = np.maximum(learned.basis[h].T @ (learned.matrices[0, h] @ direct[:, h] ** (1 / 2.2)), 0) ** 2.2
            near = np.maximum(learned.basis[h].T @ (learned.basis[h] @ maps[:, h] ** (1 / 2.2)), 0) ** 2.2
            wrong += scale * np.sum((made - maps[:, h]) ** 2)
            far += scale * np.sum((near - maps[:, h]) ** 2)
            whole += scale * np.sum(maps[:, h] ** 2)
    assert found == pytest.approx((np.sqrt(wrong / whole), np.sqrt(far / whole)), rel=1e-4)


def test_fewer_coordinates_say_the_same(database):
    few = curves.compressed(*database)
    assert few[0].lightmaps.shape[1] == 3 * (40 + 9) < TEXELS
    for elements in (2, 6):
        plain, short = (learn(each, elements=elements, ridge=1e-3) for each in (database[0], few[0]))
        assert curves.errors(short, few[1]) == pytest.approx(curves.errors(plain, database[1]), rel=2e-3, abs=1e-6)


def test_a_database_of_more_lights_than_texels_stays_as_it_is(database):
    training, unseen = (replace(each, lightmaps=each.lightmaps[:, :20]) for each in database)
    assert curves.compressed(training, unseen)[0] is training


def test_the_first_elements_of_a_basis_are_those_of_a_smaller_one(database, measured):
    line = next(line for line in measured["elements"] if line["elements"] == 4)
    operator, projection = curves.errors(learn(database[0], elements=4, ridge=1e-3), database[1])
    assert (line["unseen"], line["projection"]) == pytest.approx((operator, projection), rel=1e-3)


def test_more_elements_never_raise_the_error_on_lights_learned_from(measured):
    found = [line["training"] for line in measured["elements"]]
    assert len(found) > 3
    assert all(after <= before * (1 + 1e-6) for before, after in pairwise(found))


def test_no_operator_comes_nearer_than_the_projection(measured):
    for what in ("elements", "ridge", "configurations", "lights"):
        assert measured[what]
        assert all(line["unseen"] >= line["projection"] * (1 - 1e-6) for line in measured[what]), what


def test_all_points_and_all_configurations_are_the_plain_setting(database, measured):
    plain = curves.errors(learn(database[0], elements=6, ridge=1e-3), database[1])[0]
    ends = [measured["points"][-1], measured["configurations"][-1], measured["noise"][0], measured["spaces"][0]]
    ends += [line for line in measured["ridge"] if line["ridge"] == 1e-3]
    assert [line["unseen"] for line in ends] == pytest.approx([plain] * 5, rel=2e-3)
    assert measured["points"][-1]["points"] == POINTS
    fewer = learn(Pairs(database[0].lightmaps[:20], database[0].direct[:20]), elements=6, ridge=1e-3)
    assert [line["configurations"] for line in measured["configurations"]] == [10, 20, 40]
    assert measured["configurations"][1]["unseen"] == pytest.approx(curves.errors(fewer, database[1])[0], rel=2e-3)


def test_fewer_points_are_asked_of_by_the_light_at_all_of_them(database, measured):
    training, unseen = (replace(each, direct=each.direct[:, :16]) for each in database)
    line = next(line for line in measured["points"] if line["points"] == 16)
    learned = learn(training, elements=6, ridge=1e-3)
    found = curves.errors(learned, unseen, sizes=errors.norms(database[1].direct))
    assert (line["unseen"], line["projection"]) == pytest.approx(found, rel=2e-3)


def test_noise_is_that_of_fewer_rays(database, measured):
    lines = measured["noise"]
    assert [line["rays"] for line in lines][:3] == [1, 1 / 4, 1 / 16]
    assert lines[2]["noise"] == pytest.approx(4 * lines[0]["noise"])
    level = np.sqrt(np.mean(np.square(database[0].lightmaps, dtype=np.float64)))
    assert lines[0]["noise"] == pytest.approx(2e-3 / level, rel=1e-5)
    # what was learned from is as noisy as it says, since six elements fit no noise of 120 columns
    assert lines[-1]["unseen"] > 1.5 * lines[0]["unseen"]


def test_one_vector_of_all_colours_learns_the_colour_of_the_light(measured):
    of = {(line["channels"], line["gamma"]): line for line in measured["spaces"]}
    assert len(of) == 5
    # white lights were learned from: in other colours each channel keeps its own error
    for channels in ("shared", "separate"):
        line = of[channels, 1.0]
        assert line["coloured"] == pytest.approx(line["unseen"], rel=1e-3)
    assert of["joint", 1.0]["unseen"] < 1.3 * of["shared", 1.0]["unseen"]
    assert of["joint", 1.0]["coloured"] > 0.3 > 3 * of["shared", 1.0]["coloured"]


def test_tints_are_lights_of_that_colour(database):
    coloured = colours.tinted(database[0])
    brightest = coloured.direct.max(axis=1) / database[0].direct.max(axis=1)
    assert brightest[:4] == pytest.approx(np.array([*colours.TINTS, colours.TINTS[0]]), rel=1e-5)
    for colour in range(3):
        made = transport(0) @ coloured.direct[..., colour].T
        assert np.allclose(made.T, coloured.lightmaps[..., colour], atol=1e-6)


def test_lights_are_told_apart_by_kind(database, measured):
    found = {line["kind"]: line["unseen"] for line in measured["lights"]}
    assert set(found) == {"spot", "point"}
    learned = learn(database[0], elements=6, ridge=1e-3)
    points = curves.chosen(database[1], np.arange(9) % 3 == 1)
    assert found["point"] == pytest.approx(curves.errors(learned, points)[0], rel=2e-3)
    alike = curves.measure(*database, noise=np.zeros(TEXELS), lightings=LIGHTINGS, scenario=["point"], **WORDS)
    assert alike["lights"] == measured["lights"]
    assert [alike[name][-1]["unseen"] for name in ("points", "configurations")] == pytest.approx([found["point"]] * 2)
    lamp = Lighting((Lamp("spot", (1, 1, 1)),))
    distant = Lighting(environment=np.ones((1, 3), np.float32))
    assert [curves.kind_of(each) for each in (lamp, distant, together([lamp, distant]))] == [
        "spot", "environment", "mixed",
    ]  # fmt: skip


def test_one_matrix_for_all_poses_mixes_them_up():
    def posed(count, seed):
        both = [pairs(count, seed + number, moved=number) for number in range(2)]
        rows = {name: np.concatenate([getattr(each, name) for each in both]) for name in ("lightmaps", "direct")}
        return Pairs(**rows, keyframe=np.repeat([0, 1], count))

    found = curves.measure(
        posed(24, 11), posed(5, 21), noise=np.zeros(TEXELS), elements=8, ridge=1e-4, rng=np.random.default_rng(0)
    )
    each, one = found["matrices"]
    assert (each["matrices"], one["matrices"]) == ("each", "one")
    assert one["unseen"] > 2 * each["unseen"]
    assert [line["configurations"] for line in found["configurations"]] == [12, 24]
    assert found["lights"] == []


def test_what_a_database_is_too_small_for_has_no_line(database):
    few = curves.first(database[0], 5)
    found = curves.measure(few, database[1], noise=np.zeros(TEXELS), elements=16, rng=np.random.default_rng(0))
    assert found["configurations"] == found["ridge"] == []
    assert found["elements"][0]["elements"] == 1


def test_errors_on_training_lights_are_of_those_that_were_learned_from(database):
    training, unseen = database
    missed = training.direct.copy()
    missed[3] *= 1e-3
    rest = curves.chosen(training, np.arange(len(missed)) != 3)
    found, plain = (curves.by_elements(each, unseen, 1e-3) for each in (replace(training, direct=missed), rest))
    assert [line["training"] for line in found] == pytest.approx([line["training"] for line in plain], rel=1e-3)
