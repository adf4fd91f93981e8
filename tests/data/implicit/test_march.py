"""Sphere-traced visibility: against plain NumPy, a linear search and closed forms."""

import numpy as np
import pytest

from prtnet.data.implicit.field import Analytic
from prtnet.data.implicit.march import MarchTracer, walked
from prtnet.data.implicit.operators import moved, union
from prtnet.data.implicit.shapes import box, sphere, torus


@pytest.fixture(scope="module")
def field():
    return Analytic(
        (
            union(moved(sphere(0.3), -0.5, 0, 0), moved(box(0.2, 0.5, 0.3, round=0.02), 0.4, 0, 0.1), smooth=0.1),
            torus(0.8, 0.05),
        )
    )


@pytest.fixture(scope="module")
def tracer(field):
    return MarchTracer(field)


@pytest.fixture(scope="module")
def some_rays():
    rng = np.random.default_rng(1)
    origins = rng.uniform(-1, 1, (4000, 3)).astype(np.float32)
    towards = rng.normal(size=origins.shape)
    return origins, (towards / np.linalg.norm(towards, axis=1, keepdims=True)).astype(np.float32)


def test_the_compiled_walk_ends_where_the_plain_one_does(field, tracer, some_rays):
    origins, towards = some_rays
    found, (_, _, length) = tracer.trace(origins, towards), tracer.hits(origins, towards)
    plain = walked(field, origins.astype(np.float64), towards.astype(np.float64), epsilon=5e-6, steps=2048)
    assert np.mean(found != np.isfinite(plain)) < 1e-3
    both = np.isfinite(plain) & np.isfinite(length)
    assert 0.1 < both.mean() < 0.9
    assert np.quantile(np.abs(length[both] - plain[both]), 0.99) < 1e-3
