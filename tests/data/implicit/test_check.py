"""Distances that are none are refused, with where and what to do; those that are good pass."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data.implicit import builtin, operators
from prtnet.data.implicit.check import check
from prtnet.data.implicit.expression import constant, floor, length, select, sqrt
from prtnet.data.implicit.shapes import box, plane, sphere
from prtnet.data.implicit.surface import described

COLOUR = (0.5, 0.5, 0.5)
HALF = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))


def surface(shape, *, lipschitz=1.0, low=HALF[0], high=HALF[1]):
    return described("mine", {"all": (shape, COLOUR)}, low, high, lipschitz=lipschitz)


BAD = {
    "nan": (lambda p: sqrt(p[0]) - 0.5, "distance is no finite number at .* of .* points"),
    "infinite": (lambda p: 1 / (p[0] * 0.0 + constant(0) * p[1]) - length(*p), "no finite number"),
    "nothing": (operators.moved(sphere(0.5), 3, 0, 0), "found no surface within the bounds.* there is one at"),
    "empty": (lambda p: length(*p) + 0.3, "the least distance is 0.3"),
    "flipped": (lambda p: -sphere(3)(p), "found no surface within the bounds"),
    "full": (sphere(3), "below 0 at all of"),
    "inverted": (lambda p: 0.5 - length(*p), "below 0 on all of the bounds.*turn the sign round"),
    "endless": (plane(), r"the surface leaves the bounds .* expected larger bounds, or a flat box"),
    "beyond": (sphere(1.1), "the surface leaves the bounds"),
    "steep": (lambda p: 2 * sphere(0.5)(p), r"slope of 2 at .* expected at most 1.*declare lipschitz = 2.02"),
    "squared": (lambda p: p[0] * p[0] + p[1] * p[1] + p[2] * p[2] - 0.25, "declare lipschitz"),
    "jump": (lambda p: select(p[0], 0.2, sphere(0.5)(p), sphere(0.3)(p)), "mend the distance"),
    # the nearest copy may be in the next cell
    "cells": (
        lambda p: box(0.18, 0.3, 0.3)((p[0] - 0.8 * floor(p[0] / 0.8) - 0.25, p[1], p[2])),
        "mend the distance",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_distance_is_refused(name):
    shape, words = BAD[name]
    low, high = ((-1.6, -1.0, -1.0), (1.6, 1.0, 1.0)) if name == "cells" else HALF
    if name == "cells":
        shape = operators.intersection(shape, box(1.5, 0.9, 0.9))
    with pytest.raises(PrtnetError, match="mine: .*" + words):
        check(surface(shape, low=low, high=high))


@pytest.mark.parametrize(
    ("low", "high"), [((0, 0, 0), (1, 0, 1)), ((0.0, 0, 0), (float("inf"), 1, 1)), ((1, 1, 1), (-1, -1, -1))]
)
def test_bounds_that_are_no_box(low, high):
    with pytest.raises(PrtnetError, match="bounds: found"):
        check(surface(sphere(0.5), low=low, high=high))


def test_too_long_for_compilers(monkeypatch):
    monkeypatch.setattr("prtnet.data.implicit.check.LONGEST", 5)
    with pytest.raises(PrtnetError, match="expected at most 5: say copies"):
        check(surface(sphere(0.5)))


def test_declared_slopes_pass():
    check(surface(lambda p: 2 * sphere(0.5)(p), lipschitz=2))
    check(surface(lambda p: (p[0] ** 2 + p[1] ** 2 + p[2] ** 2) - 0.25, lipschitz=4.4))


def test_small_and_touching_surfaces_pass():
    check(surface(sphere(1.0)))
    check(surface(operators.moved(sphere(0.01), 0.3, 0.2, 0.9)))
    check(surface(box(1, 1, 1)))


def test_flat_distances_are_warned_about(caplog):
    with caplog.at_level(logging.WARNING):
        check(surface(lambda p: 0.01 * sphere(0.5)(p)))
    assert "slowly" in caplog.text
    caplog.clear()
    check(surface(sphere(0.5)))
    assert not caplog.text


@pytest.mark.parametrize("name", builtin.NAMES)
def test_built_in_surfaces_are_ones(name):
    made = builtin.make(name)
    check(made)
    names = [material.name for material in made.materials]
    assert len(set(names)) == len(names) == len(made.field.shapes)
    # every material is to be seen somewhere
    rng = np.random.default_rng(3)
    at = rng.uniform(made.low, made.high, (8000, 3))
    for _ in range(2):
        at -= made.field.distance(at)[:, None] * made.field.gradient(at)
    near = np.abs(made.field.distance(at)) < 1e-3
    seen = {names[part] for part in np.unique(made.field.part(at[near]))}
    assert seen == set(names)


def test_unknown_names_are_refused():
    with pytest.raises(PrtnetError, match="found 'sdf_cat', expected one of sdf_car, sdf_fish"):
        builtin.make("sdf_cat")


def test_a_check_changes_nothing():
    made = surface(sphere(0.5))
    before = replace(made)
    check(made)
    assert made.field is before.field
