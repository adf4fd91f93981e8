"""What rays meet: sides, black backs and textures at the point hit."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet.data.met import meet
from prtnet.data.tracer import Tracer
from tests.render.meshes import bilinear, quad, scene

AROUND = [(-1, 1, -1), (2, 0, 0), (0, 0, 2)]


def met(made, origins, directions):
    face, where, _ = Tracer(made).hits(np.asarray(origins, np.float32), np.asarray(directions, np.float32))
    assert (face >= 0).all()
    return meet(made, face, where, np.asarray(directions, np.float32))


@pytest.mark.parametrize("two_sided", [False, True])
def test_sides(two_sided):
    """A level square that faces down, from below and from above."""
    made = scene(
        quad(*AROUND, albedo=np.array([0.2, 0.4, 0.8]), two_sided=two_sided), quad((-1, -1, -1), (2, 0, 0), (0, 0, 2))
    )
    found = met(made, [[0.3, 0, 0.1], [0.3, 3, 0.1]], [[0, 1, 0], [0, -1, 0]])
    np.testing.assert_allclose(found.positions, [[0.3, 1, 0.1]] * 2, atol=1e-6)
    for normals in (found.normals, found.geometric_normals):
        np.testing.assert_allclose(normals, [[0, -1, 0], [0, 1, 0]], atol=1e-6)
    back = [0.2, 0.4, 0.8] if two_sided else [0, 0, 0]
    np.testing.assert_allclose(found.albedo, [[0.2, 0.4, 0.8], back], atol=1e-6)


def test_textures_are_looked_up_where_the_ray_hits():
    texture = np.random.default_rng(0).random((8, 8, 3)).astype(np.float32)
    part = replace(quad(*AROUND), texture=texture, albedo=np.array([1, 0.5, 0.25]))
    made = scene(part, quad((-1, -1, -1), (2, 0, 0), (0, 0, 2)))
    x, z = np.random.default_rng(1).uniform(-0.8, 0.8, (2, 50))
    found = met(made, np.stack([x, 0 * x, z], -1), np.tile([0, 1.0, 0], (50, 1)))
    expected = bilinear(texture, np.stack([(x + 1) / 2, (z + 1) / 2], -1)) * [1, 0.5, 0.25]
    np.testing.assert_allclose(found.albedo, expected, atol=1e-4)
