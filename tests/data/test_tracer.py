import logging
import sys

import numpy as np
import pytest
import trimesh

from prtnet import PrtnetError, sh
from prtnet.data import builtin, embree, kernels, samples
from prtnet.data import directions as sets
from prtnet.data.tracer import Tracer, rays, to_world
from tests.data.ray_scenes import join, quad, soup, surface_points


def grid(n):
    """A bumpy height field: many shared edges that grazing rays run along."""
    x, z = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij")
    height = 0.1 * np.sin(7 * x) * np.cos(5 * z)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + n], 1), np.stack([i + 1, i + n + 1, i + n], 1)])
    return np.stack([x, height, z], -1).reshape(-1, 3), faces


def box(low, high):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    return np.asarray(low) + corners * (np.asarray(high) - low), faces


SCENES = {
    "soup": lambda: soup(3000, 1),
    "field": lambda: join(grid(60)),
    "boxes": lambda: join(
        box([-1, 0, -1], [1, 1, 1]), box([-0.3, 0, -0.3], [0.3, 0.5, 0.3]), box([1, 0, 1], [2, 2, 2])
    ),
    "plants": lambda: builtin.make("plants"),
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("width", [16, 8, 4])
def test_fused_and_plain_agree_on_every_ray(name, width):
    scene = SCENES[name]()
    fused, plain = Tracer(scene, kind="fused", width=width), Tracer(scene, kind="embreex")
    positions, normals = surface_points(scene, 600, 2)
    # shading normals that lean send some rays along and below the surface; every fifth set grazes
    rng = np.random.default_rng(3)
    leaning = normals + rng.normal(size=normals.shape) * 0.3
    local, _ = sets.local_set("cosine_fibonacci", 256, rng)
    local[::5, 2] = 1e-4
    local /= np.linalg.norm(local, axis=1, keepdims=True)
    frames = sets.frames(sets.turns(leaning, rng.random(len(normals)) * 7))
    origins, towards = rays(fused.origins(positions, normals), frames, local.astype(np.float32))
    found = fused.trace(origins, towards)
    np.testing.assert_array_equal(found, plain.trace(origins, towards))
    assert 0.02 < found.mean() < 0.98


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("width", [16, 8, 4])
def test_closest_hits_agree_and_lie_on_their_faces(name, width):
    scene = SCENES[name]()
    fused, plain = Tracer(scene, kind="fused", width=width), Tracer(scene, kind="embreex")
    rng = np.random.default_rng(0)
    origins = rng.uniform(-1, 1, (20_001, 3)).astype(np.float32)
    towards = rng.normal(size=origins.shape)
    towards = (towards / np.linalg.norm(towards, axis=1, keepdims=True)).astype(np.float32)
    face, where, distance = fused.hits(origins, towards)
    twin, _, twin_distance = plain.hits(origins, towards)
    np.testing.assert_array_equal(distance, twin_distance)
    # of coincident faces either may be named
    assert np.mean(face != twin) < (0.01 if name == "boxes" else 1e-9)
    hit = face >= 0
    assert 0.02 < hit.mean() < 0.98
    np.testing.assert_array_equal(np.isinf(distance), ~hit)
    np.testing.assert_array_equal(fused.trace(origins, towards), hit)
    corners = fused.frame.to_unit(scene.vertices)[scene.faces[face[hit]]]
    u, v = where[hit].T.astype(np.float64)
    found = np.einsum("ni,nij->nj", np.stack([1 - u - v, u, v], 1), corners)
    reached = origins[hit] + distance[hit, None].astype(np.float64) * towards[hit]
    assert np.abs(found - reached).max() < 1e-5


@pytest.mark.parametrize("width", [16, 8, 4])
def test_rays_at_edges_do_not_slip_through(width):
    """From inside a ball, at its edges. Without the robust flag a tenth leaks, and single rays differ from packets."""
    ball = trimesh.creation.icosphere(5)
    scene = join((ball.vertices, ball.faces))
    fused, plain = Tracer(scene, kind="fused", width=width), Tracer(scene, kind="embreex")
    rng = np.random.default_rng(0)
    ends = np.asarray(ball.vertices)[ball.edges_unique].astype(np.float32)
    share = rng.random((len(ends), 1), np.float32)
    origins = np.tile(np.float32([0.21, -0.13, 0.32]), (len(ends), 1))
    towards = ends[:, 0] * share + ends[:, 1] * (1 - share) - origins
    found = fused.trace(origins, towards)
    np.testing.assert_array_equal(found, plain.trace(origins, towards))
    assert found.mean() > 0.99


def test_both_twins_trace_the_very_same_rays():
    rng = np.random.default_rng(7)
    local = sets.local_set("random", 16, rng)[0].astype(np.float32)
    packet, _ = kernels.packet(16)
    for frame in sets.frames(sets.turns(rng.normal(size=(200, 3)), rng.random(200) * 7)):
        kernels.aim(16, frame, np.ascontiguousarray(local.T), packet)
        _, towards = rays(np.zeros((1, 3), np.float32), frame[None], local)
        np.testing.assert_array_equal(packet[4:7].T, towards)


@pytest.mark.parametrize("width", [16, 8, 4])
def test_the_compiled_sums_see_the_occlusions_of_the_plain_twin(width):
    """Rows of a unit matrix and a turn by nothing bring each ray's answer out of the kernel."""
    scene = builtin.make("plants")
    fused, plain = Tracer(scene, kind="fused", width=width), Tracer(scene, kind="embreex")
    positions, normals = surface_points(scene, 1000, 9)
    table = sets.Table(*sets.local_set("cosine_fibonacci", 256, np.random.default_rng(0)), 16)
    table.rows = np.eye(256, dtype=np.float32)
    turns = sets.turns(normals, np.random.default_rng(6).random(1000) * 7)
    origins, frames = fused.origins(positions, normals), sets.frames(turns)
    still = np.tile([1.0, 0, 1, 0, 1, 0], (1000, 1))
    free = fused._gather_fused(fused._scene, origins, frames, still, table)
    found = plain.trace(*rays(origins, frames, table.directions)).reshape(1000, 256)
    np.testing.assert_array_equal(free < 0.5, found)


@pytest.mark.parametrize("width", [16, 8, 4])
@pytest.mark.parametrize("bands", [1, 2, 5, 8])
def test_gather_equals_its_twin_and_a_direct_projection(width, bands):
    scene = SCENES["soup"]()
    fused, plain = Tracer(scene, kind="fused", width=width), Tracer(scene, kind="embreex")
    positions, normals = surface_points(scene, 50, 4)
    table = sets.Table(*sets.local_set("stratified", 128, np.random.default_rng(5)), bands)
    turns = sets.turns(normals, np.random.default_rng(6).random(50) * 7)
    origins, frames = fused.origins(positions, normals), sets.frames(turns)
    mine, twin = fused.gather(origins, turns, table), plain.gather(origins, turns, table)
    np.testing.assert_allclose(mine, twin, atol=1e-5)
    # the oracle: every free world direction by itself, projected on world axes
    weights = table.rows[:, 0] / sh.evaluate(np.array([0.0, 0, 1]), 1)[0]
    for i in range(0, 50, 7):
        start, towards = rays(origins[i : i + 1], frames[i : i + 1], table.directions)
        free = ~plain.trace(start, towards)
        direct = sh.project(free[:, None].astype(float), towards.astype(float), weights, bands)[:, 0]
        np.testing.assert_allclose(mine[i], direct, atol=1e-5)


def test_rotation_to_world_is_orthogonal_and_right_at_any_bands():
    rng = np.random.default_rng(0)
    normals = np.concatenate([rng.normal(size=(20, 3)), np.eye(3), -np.eye(3)])
    turns = sets.turns(normals, rng.random(len(normals)) * 7)
    frames = sets.frames(turns).astype(np.float64)
    for bands in range(1, 11):
        local = rng.normal(size=(len(normals), bands * bands))
        world = to_world(local, turns)
        np.testing.assert_allclose(np.linalg.norm(world, axis=1), np.linalg.norm(local, axis=1), rtol=1e-12)
        for frame, before, after in zip(frames[::5], local[::5], world[::5], strict=True):
            np.testing.assert_allclose(sh.rotate(before[:, None], frame)[:, 0], after, atol=3e-6)


def test_occluded_takes_scene_coordinates():
    far = np.array([1000.0, -2000, 500])
    scene = join(quad(far + [-5, 0, -5], [10, 0, 0], [0, 0, 10]), quad(far + [-5, 4, -5], [10, 0, 0], [0, 0, 10]))
    for kind in ("fused", "embreex"):
        tracer = Tracer(scene, kind=kind)
        up, aside = np.array([[0.0, 1, 0]]), np.array([[1.0, 0, 0]])
        middle = far[None] + [0, 2, 0]
        assert tracer.occluded(middle, up).all()
        assert not tracer.occluded(middle, aside).any()
        assert not tracer.occluded(middle + [0, 3, 0], up).any()
        assert tracer.rays_traced == 3


def test_a_list_that_fills_no_packet():
    tracer = Tracer(SCENES["soup"]())
    assert tracer.occluded(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)
    for count in (1, 15, 17):
        assert tracer.occluded(np.full((count, 3), 9.0), np.tile([1.0, 0, 0], (count, 1))).tolist() == [False] * count


def test_resolved_kind_is_logged(caplog):
    with caplog.at_level(logging.INFO):
        assert Tracer(SCENES["soup"]()).kind == "fused"
    assert "tracer: fused (Embree, packets of" in caplog.text


def test_a_missing_library_is_never_silent(monkeypatch, caplog):
    def absent():
        raise embree.EmbreeUnavailable("no libembree4 beside it")

    monkeypatch.setattr(embree, "library", absent)
    tracer = Tracer(SCENES["soup"]())
    assert tracer.kind == "embreex"
    assert "NOT the fused path" in caplog.text
    assert "no libembree4 beside it" in caplog.text
    with pytest.raises(PrtnetError, match="no libembree4"):
        Tracer(SCENES["soup"](), kind="fused")


def test_without_embreex_the_line_to_type(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    with pytest.raises(PrtnetError, match="pip install 'embreex"):
        Tracer(SCENES["soup"]())


def test_unknown_kind():
    with pytest.raises(PrtnetError, match="'optix'"):
        Tracer(SCENES["soup"](), kind="optix")


def test_measure_leaves_no_trace():
    scene = SCENES["soup"]()
    tracer = Tracer(scene)
    positions, normals = surface_points(scene, 5000, 0)
    assert tracer.measure(positions, normals) > 1e5
    assert tracer.rays_traced == 0


def test_measure_takes_samples():
    scene = builtin.make("cornell")
    picked = samples.area_uniform(scene, 100, np.random.default_rng(0))
    assert Tracer(scene).measure(picked.positions, picked.normals) > 1e5


@pytest.mark.parametrize("kind", ["fused", "embreex"])
def test_clearance_is_the_longest_free_way(kind):
    tracer = Tracer(join(box([-1, -1, -2], [1, 1, 2])), kind=kind)
    sides = np.array([[0, 0, 1.0], [0, 0, -1.0]])
    found = tracer.clearance(np.array([[0.1, 0.2, -2.0], [0.0, 0.1, -2.0]]), sides, directions=256)
    # the box is 2 long in unit lengths; its far corners are a little further. Outwards nothing is in the way
    assert 1.9 < found[0] < np.hypot(2, 2**0.5)
    assert np.isinf(found[1])
