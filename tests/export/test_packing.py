"""Arrays packed for a page come back whole, or as near as their bits allow."""

import hypothesis.extra.numpy as npst
import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from prtnet import PrtnetError
from prtnet.export import packing
from tests.nets import random_points

KINDS = st.sampled_from([np.uint8, np.uint16, np.uint32])


@settings(max_examples=40, deadline=None)
@given(KINDS.flatmap(lambda kind: npst.arrays(kind, npst.array_shapes(min_dims=2, max_dims=2))), st.booleans())
def test_arrays_come_back(values, delta):
    block = packing.pack(values, delta=delta)
    np.testing.assert_array_equal(packing.unpack(block), values)
    assert packing.pack(values, delta=delta).data == block.data


def test_floats_are_no_integers():
    with pytest.raises(PrtnetError, match="float64"):
        packing.pack(np.zeros((2, 2)))


def test_floats_keep_their_bits():
    for kind in (np.float16, np.float32):
        values = np.random.default_rng(0).normal(size=(3, 4, 4)).astype(kind)
        found = packing.unpack(packing.pack_floats(values)).ravel()
        np.testing.assert_array_equal(np.ascontiguousarray(found).view(kind), values.ravel())


def test_positions_are_off_by_half_a_step_at_most():
    positions, _ = random_points(1000)
    box = packing.box_of(positions)
    found = packing.from_steps(packing.to_steps(positions, box), box)
    assert np.abs(found - positions).max() < 0.5001 * box.span.max() / packing.TOP + 1e-7
    flat = positions * np.array([1, 0, 1], np.float32)
    assert np.isfinite(packing.from_steps(packing.to_steps(flat, packing.box_of(flat)), packing.box_of(flat))).all()


def test_normals_turn_by_less_than_a_hundredth_of_a_degree():
    _, normals = random_points(5000)
    normals = np.concatenate([normals, np.eye(3, dtype=np.float32), -np.eye(3, dtype=np.float32)])
    found = packing.from_octahedron(packing.to_octahedron(normals))
    sine = np.linalg.norm(np.cross(found.astype(np.float64), normals), axis=1)
    assert (np.einsum("ni,ni->n", found, normals) > 0).all()
    assert np.degrees(sine).max() < 0.01


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 100), st.floats(0, 1))
def test_texels_come_back(seed, share):
    rng = np.random.default_rng(seed)
    used = rng.uniform(size=(7, 9)) < share
    image = rng.integers(0, 256, (7, 9, 3)).astype(np.uint8) * used[..., None]
    found = packing.unpredicted(packing.predicted(image, used), used)
    np.testing.assert_array_equal(found, image)
