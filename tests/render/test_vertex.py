"""Vertex PRT on screen against its NumPy twin, against the texture, and on a coarse ground."""

import numpy as np
import pytest

from prtnet import PrtnetError, gl, score, sh
from prtnet.data import atlas, builtin, shapes, texture, transfer, vertex
from prtnet.data.light import project, sky
from prtnet.data.part import Part
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import GBuffer, shade
from prtnet.render.method import TextureMethod
from prtnet.render.raster import Raster
from prtnet.render.vertex import VertexMethod, pack, shade_vertices
from tests.render.meshes import quad, scene, sphere

SIZE = 96
EYE = Camera((0.4, 0.9, 2.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
ABOVE = Camera((0.3, 2.2, 1.8), (0.0, -0.1, 0.0), fov_y=45.0, near=0.1, far=10.0)
SUN = project(sky(), 5)


def random_light(count: int) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(count, 3)).astype(np.float32)


def bake(mesh: Scene, points, directions: int = 1024, **normals) -> np.ndarray:
    rng = np.random.default_rng(0)
    return transfer.bake(Tracer(mesh), points.positions, points.normals, directions=directions, rng=rng, **normals)


def baked(mesh: Scene) -> np.ndarray:
    points = vertex.points(mesh)
    return bake(mesh, points, geometric_normals=points.geometric_normals)


def reference(found: GBuffer, mesh: Scene) -> np.ndarray:
    return shade(found, bake(mesh, found, 2048, geometric_normals=found.geometric_normals), SUN)


@pytest.fixture(scope="module")
def plants() -> Scene:
    return vertex.mesh(builtin.make("plants", tessellation=0.4).centred(), ["ground"], 3)


@pytest.mark.parametrize("bands", [1, 3, 5])
def test_glsl_agrees_with_numpy(plants, bands):
    lobe = sh.cosine_lobe(plants.normals, bands) * np.linspace(0.5, 1, len(plants.vertices), dtype=np.float32)[:, None]
    method, light = VertexMethod(plants, lobe, SIZE), random_light(bands * bands)
    drawn = method.draw(EYE, light)
    expected = shade_vertices(method.raster, EYE, lobe, light)
    assert (expected != 0).any(axis=-1).mean() > 0.2
    error = np.abs(drawn - expected)
    assert np.percentile(error, 99.5) < 2e-5
    # the graphics extrapolate where a face's snapped edge covers a centre that lies outside of it
    assert error.max() < 0.05 * np.abs(expected).max()


def test_each_vertex_finds_its_own_transfer(monkeypatch, plants):
    """Noise that no neighbour shares, in rows of few vertices: the addressing of the texture."""
    noise = np.random.default_rng(0).normal(size=(len(plants.vertices), 9)).astype(np.float32)
    monkeypatch.setattr("prtnet.render.vertex.pack", lambda values, limit, groups: pack(values, 301, groups))
    method = VertexMethod(plants, noise, SIZE)
    assert method.texture.size == (300, -(-len(noise) // 100))
    error = np.abs(method.draw(EYE, random_light(9)) - shade_vertices(method.raster, EYE, noise, random_light(9)))
    assert np.percentile(error, 99) < 5e-5


def test_prepass_changes_no_pixel(plants):
    method = VertexMethod(plants, sh.cosine_lobe(plants.normals, 3), SIZE)
    drawn = method.draw(EYE, random_light(9))
    method.render(EYE, prepass=False)
    assert drawn.any()
    np.testing.assert_array_equal(method.raster.target.read()[..., :3], drawn)


def test_the_cut_mesh_covers_the_same_pixels(plants):
    unit_scene = builtin.make("plants", tessellation=0.4).centred()
    coarse, uncut = Raster(atlas.make(unit_scene, size=256), SIZE), vertex.mesh(unit_scene)
    covered = coarse.faces(EYE)[..., 0] > 0
    # the atlas has other vertices, but the same triangles
    np.testing.assert_array_equal(VertexMethod(uncut, sh.cosine_lobe(uncut.normals, 1), SIZE).covers(EYE), covered)
    method = VertexMethod(plants, sh.cosine_lobe(plants.normals, 1), SIZE)
    assert np.count_nonzero(method.covers(EYE) ^ covered) <= 2
    assert np.abs(coarse.albedo(EYE) - method.raster.albedo(EYE)).max(axis=-1).mean() < 1e-3


def stage() -> Scene:
    """A ball over a ground, both finely cut."""
    ball = sphere(48, radius=0.4)
    return scene(ball, quad([-1, -0.5, 1], [2, 0, 0], [0, 0, -2], name="ground"))


def test_on_a_dense_mesh_vertex_and_texture_agree():
    """A ball over a ground in 32 x 32 squares, against the texture: 61 dB, from 27 dB in 2 x 2 squares."""
    made = atlas.make(stage(), size=256)
    texels = texture.gbuffer(made, 256)
    image = texture.assemble(texels, bake(stage(), texels, geometric_normals=texels.geometric_normals))
    drawing = Raster(made, SIZE)
    covered = np.zeros(SIZE * SIZE, bool)
    covered[drawing.gbuffer(ABOVE).pixel] = True
    covered = covered.reshape(SIZE, SIZE)
    by_texture = TextureMethod(drawing, image).draw(ABOVE, SUN)
    exposure = score.exposure([by_texture], [covered])
    found = []
    for level in (1, 3, 5):
        mesh = vertex.mesh(stage(), ["ground"], level)
        method = VertexMethod(mesh, baked(mesh), SIZE)
        pair = (score.tone_map(method.draw(ABOVE, SUN), exposure), score.tone_map(by_texture, exposure))
        found.append(score.psnr(*pair, covered & method.covers(ABOVE)))
    assert np.all(np.diff(found) > 8)
    assert found[0] < 30
    assert found[-1] > 55


def test_a_ground_of_two_triangles_has_no_shadow_until_it_is_cut():
    """A box over a quad: PSNR against per-pixel rays on the ground's pixels grows with each cut."""
    box = shapes.box([-0.3, -0.3, -0.3], [0.3, 0.1, 0.3])
    toy = scene(quad([-1, -0.5, 1], [2, 0, 0], [0, 0, -2], name="ground"), Part("box", box.vertices, box.faces))
    mesh = vertex.mesh(toy)
    drawing = VertexMethod(mesh, sh.cosine_lobe(mesh.normals, 5), SIZE).raster
    seen = drawing.gbuffer(ABOVE)
    ground = np.zeros(SIZE * SIZE, bool)
    ground[seen.pixel[mesh.part[seen.face] == 0]] = True
    ground = ground.reshape(SIZE, SIZE)
    wanted = reference(seen, mesh)
    exposure = score.exposure([wanted], [ground])
    found = []
    for level in (0, 2, 4, 6):
        cut = vertex.mesh(toy, ["ground"], level)
        cut_method = VertexMethod(cut, baked(cut), SIZE)
        drawn = cut_method.draw(ABOVE, SUN)
        if level == 0:
            # the corners see the whole sky, or nearly
            shades = drawn[ground]
            assert np.ptp(shades, axis=0).max() < 0.1 * shades.max()
        both = ground & cut_method.covers(ABOVE)
        assert np.count_nonzero(ground & ~both) <= 2
        found.append(score.psnr(score.tone_map(drawn, exposure), score.tone_map(wanted, exposure), both))
    assert np.all(np.diff(found) > 5)
    assert found[0] < 26
    assert found[-1] > 48


def test_unshadowed_under_white_light_is_the_albedo():
    mesh = vertex.mesh(stage())
    method = VertexMethod(mesh, sh.cosine_lobe(mesh.normals, 1), SIZE)
    drawn = method.draw(EYE, np.full((1, 3), np.sqrt(4 * np.pi), np.float32))
    found = method.raster.gbuffer(EYE)
    np.testing.assert_allclose(drawn.reshape(-1, 3)[found.pixel], found.albedo, rtol=1e-5)
    assert method.milliseconds(EYE, np.ones((1, 3)), repeats=1) > 0


def test_pack_keeps_vertices_whole_and_in_order():
    values = np.arange(7 * 9, dtype=np.float32).reshape(7, 9)
    image = pack(values, 8)
    assert image.shape == (4, 6, 4)
    np.testing.assert_array_equal(image.reshape(-1, 12)[:7, :9], values)
    assert not image.reshape(-1, 12)[:7, 9:].any()


def test_errors(plants):
    with pytest.raises(PrtnetError, match="found 9 SH coefficients, expected 25"):
        VertexMethod(plants, sh.cosine_lobe(plants.normals, 5), 32).draw(EYE, random_light(9))
    with pytest.raises(PrtnetError, match="vertex transfer: found 100 vertices, expected at most 64"):
        pack(np.zeros((100, 4), np.float32), 8)
    assert gl.layer_count(sh.count(5)) == 7


def test_four_groups_at_vertices_agree_with_numpy(plants):
    transfer = np.random.default_rng(0).normal(size=(len(plants.vertices), 36)).astype(np.float32)
    method = VertexMethod(plants, transfer, SIZE, groups=4)
    expected = shade_vertices(method.raster, EYE, transfer, random_light(9), groups=4)
    error = np.abs(method.draw(EYE, random_light(9)) - expected)
    assert np.percentile(error, 99) < 1e-3 * np.abs(expected).max()
