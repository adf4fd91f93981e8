"""The picture of docs/deploying.md shows what its labels say."""

import numpy as np
from PIL import Image

from experiments import conventions


def test_each_axis_lights_in_its_own_colour():
    """Irradiance at a normal n under lights from +x, +y and +z is n, where it is above 0."""
    image, covered = conventions.lit_sphere(128)
    assert 0.2 < covered.mean() < 0.5
    normals = np.random.default_rng(0).normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    seen = np.sum(normals * (conventions.CAMERA.eye - normals), axis=1) > 1
    columns, rows = np.rint(conventions.on_screen(normals[seen], 128)).astype(int).T
    found, expected = np.pi * image[rows, columns], np.clip(normals[seen], 0, 1)
    assert expected.max(axis=0).min() > 0.8
    # five bands of a light from one direction, and pixels that are not the very point
    np.testing.assert_allclose(found, expected, atol=0.09)


def test_the_picture_is_drawn(tmp_path):
    conventions.draw(tmp_path / "conventions.png")
    with Image.open(tmp_path / "conventions.png") as image:
        assert image.size[0] > 1000
