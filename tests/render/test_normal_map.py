"""Normal maps on screen: shaders see the n' that NumPy does; parts without a map stay smooth."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import sh
from prtnet.data import atlas, texture
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import shade
from prtnet.render.material import Material
from prtnet.render.method import NetMethod, TextureMethod
from prtnet.render.raster import Raster
from tests.render.meshes import quad, scene, sphere

SIZE = 96
EYE = Camera((0.4, 0.9, 2.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
LIGHT = np.random.default_rng(3).normal(size=(9, 3)).astype(np.float32)
# the normal itself, so that a net shader shows which one it was given
FUNCTION = """
void prt_transfer(vec3 position, vec3 normal, out vec4 t0, out vec4 t1, out vec4 t2) {
  t0 = vec4(normal, 1.0);
  t1 = vec4(0.0);
  t2 = vec4(0.25, 0.0, 0.0, 0.0);
}
"""


def relief(size: int = 8) -> np.ndarray:
    """A smooth map with slopes of all directions."""
    y, x = np.mgrid[:size, :size] / size * 2 * np.pi
    vectors = np.stack([0.5 * np.sin(x), 0.5 * np.cos(y), np.ones_like(x)], -1)
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)


@pytest.fixture(scope="module")
def drawing() -> Raster:
    """A ball with a map, a card with another one, seen from behind, and a floor with none."""
    ball = replace(sphere(40, radius=0.5), normal_map=relief())
    card = quad([-0.4, -0.4, 0.2], [-0.6, 0, -0.2], [0, 0.9, 0], name="card", two_sided=True, normal_map=relief(5))
    floor = quad([-1, -0.6, 1], [2, 0, 0], [0, 0, -2], name="floor")
    return Raster(atlas.make(scene(ball, card, floor), size=256), SIZE)


def mapped(drawing, found):
    return drawing.atlas.scene.part[found.face] < 2


def test_the_gbuffer_is_bent_where_there_is_a_map(drawing):
    found = drawing.gbuffer(EYE)
    part = drawing.atlas.scene.part[found.face]
    off = np.linalg.norm(found.normals - found.geometric_normals, axis=1)
    assert (off[part == 2] == 0).all()
    assert np.median(off[part == 0]) > 0.2
    assert np.median(off[part == 1]) > 0.2
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1, atol=1e-5)


def test_the_net_shader_gets_the_same_normal(drawing):
    found = drawing.gbuffer(EYE)
    n, one = found.normals, np.ones((len(found.normals), 1), np.float32)
    transfer = np.concatenate([n, one, 0 * one, 0 * one, 0 * one, 0 * one, 0.25 * one], axis=1)
    error = np.abs(NetMethod(drawing, FUNCTION).draw(EYE, LIGHT) - shade(found, transfer, LIGHT)).max(axis=-1)
    error = error.reshape(-1)[found.pixel]
    # filters have 8 bits of fraction
    assert np.median(error) < 5e-3
    assert np.percentile(error, 99) < 0.05
    smooth = Raster(replace(drawing.atlas, scene=replace(drawing.atlas.scene, tangents=None)), SIZE)
    flat = NetMethod(smooth, FUNCTION).draw(EYE, LIGHT)
    off = np.abs(flat - shade(found, transfer, LIGHT)).max(axis=-1).reshape(-1)[found.pixel]
    assert np.median(off[mapped(drawing, found)]) > 0.05


def test_gloss_mirrors_at_the_same_normal(drawing):
    """Constant transfer, so that all relief in the picture is that of the highlight."""
    found, glossy = drawing.gbuffer(EYE), Material(0.0, (1.0, 1.0, 1.0), 8.0, "full")
    values = np.tile(sh.cosine_lobe(np.array([[0.0, 0.0, 1.0]]), 3), (len(found.pixel), 1)).astype(np.float32)
    drawn = TextureMethod(drawing, np.tile(values[0], (16, 16, 1)), material=glossy).draw(EYE, LIGHT)
    expected = shade(found, values, LIGHT, glossy)
    error = np.abs(drawn - expected).max(axis=-1).reshape(-1)[found.pixel]
    assert np.median(error) < 0.01 * np.abs(expected).max()
    assert np.percentile(error, 99) < 0.1 * np.abs(expected).max()


def test_baked_relief_is_that_of_the_gbuffer(drawing):
    """Texels keep the transfer of n': open cosine lobes drawn from the texture are those of the pixels' normals."""
    texels = texture.gbuffer(drawing.atlas, 256)
    image = texture.assemble(texels, sh.cosine_lobe(texels.normals, 3))
    found = drawing.gbuffer(EYE)
    expected = shade(found, sh.cosine_lobe(found.normals, 3), LIGHT).reshape(-1, 3)[found.pixel]
    drawn = TextureMethod(drawing, image).draw(EYE, LIGHT).reshape(-1, 3)[found.pixel]
    bent = mapped(drawing, found)
    assert np.median(np.abs(drawn - expected)[bent].max(axis=-1)) < 0.02
    smooth = shade(found, sh.cosine_lobe(found.geometric_normals, 3), LIGHT).reshape(-1, 3)[found.pixel]
    assert np.median(np.abs(smooth - expected)[bent].max(axis=-1)) > 0.1
