import logging

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import directions as sets
from prtnet.data import samples, transfer
from prtnet.data.scene import frame_of
from prtnet.data.tracer import Tracer
from tests.data.ray_scenes import clipped_lobe, join, quad, scene, soup, surface_points

FAR_BITS = quad([90, 90, 90], [1, 0, 0], [0, 1, 0])  # somewhere to hit, far from where the tests look


def unit(vectors):
    vectors = np.asarray(vectors, np.float64)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def bake(tracer, positions, normals, seed=0, **options):
    return transfer.bake(tracer, positions, normals, rng=np.random.default_rng(seed), **options)


@pytest.fixture(scope="module")
def open_sky():
    """Points that nothing occludes, with normals all around."""
    normals = unit(np.random.default_rng(0).normal(size=(2000, 3)))
    return Tracer(join(FAR_BITS)), np.tile([-90.0, -90, -90], (2000, 1)), normals


def test_unoccluded_is_the_cosine_lobe(open_sky):
    tracer, positions, normals = open_sky
    error = bake(tracer, positions, normals, directions=1024) - sh.cosine_lobe(normals, 5)
    assert np.sqrt((error**2).mean()) < 1e-3
    error = bake(tracer, positions, normals, directions=4096) - sh.cosine_lobe(normals, 5)
    assert np.abs(error).max() < 1e-3


@pytest.mark.parametrize(("kind", "limit"), [("uniform", 2e-3), ("stratified", 8e-3), ("random", 8e-2)])
def test_unoccluded_by_the_other_kinds(open_sky, kind, limit):
    tracer, positions, normals = open_sky
    error = bake(tracer, positions, normals, directions=1024, kind=kind) - sh.cosine_lobe(normals, 5)
    assert np.sqrt((error**2).mean()) < limit


@pytest.mark.parametrize("bands", range(1, 9))
def test_unoccluded_at_any_bands(open_sky, bands):
    tracer, positions, normals = open_sky
    error = bake(tracer, positions[:200], normals[:200], bands=bands, directions=4096)
    error -= sh.cosine_lobe(normals[:200], bands)
    assert np.abs(error).max() < 2e-3


@pytest.fixture(scope="module")
def wall():
    """A floor point at the foot of a wall so large that it hides the half-space x < 0, in a few turned copies."""
    side = 1e3
    vertices, faces = quad([0, -side, -side], [0, 2 * side, 0], [0, 0, 2 * side])
    normals, edges = [[0, 1, 0], [0, 0.6, 0.8], [0, 0, -1]], [1, 0, 0]
    # a millionth of the wall's size away from it: it covers the half-space up to 1e-3 rad
    positions = np.tile([side * 1e-3, 0.0, 0.0], (len(normals), 1))
    free = np.stack([clipped_lobe(normal, edges, 5) for normal in normals])
    return Tracer(scene(vertices, faces)), positions, np.asarray(normals, float), free


def test_clipped_lobes_of_both_halves_make_the_whole():
    whole = clipped_lobe([0, 1, 0], [1, 0, 0], 5) + clipped_lobe([0, 1, 0], [-1, 0, 0], 5)
    np.testing.assert_allclose(whole, sh.cosine_lobe(np.array([0.0, 1, 0]), 5), atol=1e-12)


@pytest.mark.parametrize("kind", sets.KINDS)
def test_a_wall_hides_half(wall, kind):
    tracer, positions, normals, free = wall
    limit = {"cosine_fibonacci": 3e-3, "uniform": 4e-3, "stratified": 8e-3, "random": 4e-2}[kind]
    many = [np.repeat(rows, 200, axis=0) for rows in (positions, normals, free)]
    error = bake(tracer, many[0], many[1], directions=4096, kind=kind) - many[2]
    assert np.sqrt((error**2).mean()) < limit


def test_a_half_space_hides_all(wall):
    """Normals into the wall's side see nothing but it; away from it, everything."""
    tracer, positions, _, _ = wall
    normals = np.array([[-1.0, 0, 0], [1, 0, 0]])
    found = bake(tracer, positions[:2], normals, directions=4096)
    assert np.abs(found[0]).max() < 3e-3
    np.testing.assert_allclose(found[1], sh.cosine_lobe(normals[1], 5), atol=1e-3)


def test_error_falls_as_it_should_with_the_number_of_directions(wall, open_sky):
    counts = 2 ** np.arange(5, 13)

    def slope(case, kind):
        tracer, positions, normals, exact = case
        errors = []
        for count in counts:
            found = bake(tracer, positions, normals, directions=int(count), kind=kind, seed=int(count))
            errors.append(np.sqrt(((found - exact) ** 2).mean()))
        return np.polyfit(np.log(counts), np.log(errors), 1)[0]

    tracer, positions, normals, free = wall
    at_wall = tracer, np.tile(positions, (100, 1)), np.tile(normals, (100, 1)), np.tile(free, (100, 1))
    tracer, positions, normals = open_sky
    in_open = tracer, positions[:300], normals[:300], sh.cosine_lobe(normals[:300], 5)
    found = {
        (place, kind): slope(case, kind)
        for place, case in (("open", in_open), ("wall", at_wall))
        for kind in ("cosine_fibonacci", "random")
    }
    assert -0.75 < found["open", "random"] < -0.3, found
    assert -0.75 < found["wall", "random"] < -0.3, found
    assert found["open", "cosine_fibonacci"] < -0.9, found
    assert -1.0 < found["wall", "cosine_fibonacci"] < -0.65, found


def test_the_two_sides_of_a_leaf_differ():
    """A horizontal leaf below a roof: its upper side is dark, its lower side free."""
    leaf, roof = quad([-1, 0, -1], [2, 0, 0], [0, 0, 2]), quad([-50, 1, -50], [100, 0, 0], [0, 0, 100])
    normals = np.array([[0.0, 1, 0], [0, -1, 0]])
    found = bake(Tracer(join(leaf, roof)), np.zeros((2, 3)) + [0.1, 0, 0.2], normals, directions=1024)
    assert found[0, 0] < 2e-3
    np.testing.assert_allclose(found[1], sh.cosine_lobe(normals[1], 5), atol=4e-3)


def test_rays_start_on_the_geometric_side():
    """A shading normal that leans far over still starts on the face's own side."""
    leaf = quad([-1, 0, -1], [2, 0, 0], [0, 0, 2])
    shading, geometric = unit([[1.0, 0.02, 0]]), np.array([[0.0, 1, 0]])
    for sign in (1.0, -1.0):
        found = bake(
            Tracer(join(leaf)), np.zeros((1, 3)), shading, geometric_normals=geometric * sign, directions=4096
        )[0]
        # half of the lobe is beneath the leaf, or above it
        half = clipped_lobe([1, 0, 0], [0, sign, 0], 5)
        np.testing.assert_allclose(found, half, atol=2e-2)


@pytest.mark.parametrize(("scale", "shift"), [(1e-3, 0.0), (1.0, 0.0), (1e6, 0.0), (1.0, 1e5), (1e-3, 1e3)])
def test_scaled_and_moved_scenes_give_the_same(scale, shift):
    still = soup(400, 1)
    positions, normals = surface_points(still, 300, 2)
    expected = bake(Tracer(still), positions, normals)
    move = np.array([1.0, -2, 0.5]) * shift
    moved = scene(still.vertices * scale + move, still.faces)
    found = bake(Tracer(moved), positions * scale + move, normals)
    # float64 keeps 1e-9 of a scene 1e-6 as large as its distance: a ray or two may pass an edge on the other side
    assert np.abs(found - expected).max() < 2e-2
    assert np.sqrt(((found - expected) ** 2).mean()) < 5e-4


def test_no_surface_shadows_itself_at_any_scale():
    """A fine sphere sees its whole sky but for the offset: the same at every size and place."""
    n = 60
    theta, phi = np.meshgrid(np.linspace(1e-3, np.pi - 1e-3, n), np.linspace(0, 2 * np.pi, 2 * n), indexing="ij")
    ball = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1).reshape(-1, 3)
    i = (np.arange(n - 1)[:, None] * 2 * n + np.arange(2 * n - 1)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + 2 * n], 1), np.stack([i + 1, i + 2 * n + 1, i + 2 * n], 1)])
    for scale, shift in ((1e-3, 0.0), (1.0, 1e4), (1e6, 0.0)):
        mesh = scene(ball * scale + shift, faces)
        positions, normals = surface_points(mesh, 500, 0)
        normals *= np.sign(np.einsum("ni,ni->n", normals, positions - shift))[:, None]
        error = bake(Tracer(mesh), positions, normals, directions=256) - sh.cosine_lobe(normals, 5)
        assert np.abs(error[:, 0]).max() < 5e-3


def test_threads_and_chunks_change_no_bit(monkeypatch):
    mesh = soup(400, 3)
    tracer = Tracer(mesh)
    positions, normals = surface_points(mesh, 1500, 4)
    one = bake(tracer, positions, normals, threads=1)
    np.testing.assert_array_equal(one, bake(tracer, positions, normals, threads=3))
    for rays in (1, 5000, 1 << 30):
        monkeypatch.setattr(transfer, "CHUNK_RAYS", rays)
        np.testing.assert_array_equal(one, bake(tracer, positions, normals, threads=2))


def test_other_points_and_their_order_change_no_bit():
    """With the azimuths fixed, a permuted or shortened input gives the permuted or shortened result."""
    mesh = soup(400, 3)
    tracer = Tracer(mesh)
    positions, normals = surface_points(mesh, 1000, 4)
    azimuth = np.random.default_rng(0).random(1000)

    class Fixed(np.random.Generator):
        def random(self, count):
            return self.values

    def with_azimuth(index):
        rng = Fixed(np.random.PCG64())
        rng.values = azimuth[index]
        return transfer.bake(tracer, positions[index], normals[index], rng=rng)

    order = np.random.default_rng(1).permutation(1000)
    whole = with_azimuth(np.arange(1000))
    np.testing.assert_array_equal(with_azimuth(order), whole[order])
    np.testing.assert_array_equal(with_azimuth(order[:37]), whole[order[:37]])


def test_fused_equals_plain():
    mesh = soup(400, 5)
    positions, normals = surface_points(mesh, 700, 6)
    fused, plain = (bake(Tracer(mesh, kind=kind), positions, normals) for kind in ("fused", "embreex"))
    np.testing.assert_allclose(fused, plain, atol=1e-5)


def test_progress_counts_to_the_end_and_the_log_names_the_tracer(monkeypatch, caplog):
    monkeypatch.setattr(transfer, "CHUNK_RAYS", 100 * 512)
    monkeypatch.setattr(transfer, "LOG_SECONDS", 0.0)
    mesh, seen = soup(100, 7), []
    positions, normals = surface_points(mesh, 450, 8)
    tracer = Tracer(mesh)
    with caplog.at_level(logging.DEBUG):
        bake(tracer, positions, normals, progress=seen.append)
    assert seen[-1] == 450
    assert seen == sorted(seen)
    assert len(seen) == 5
    assert "transfer: fused, 450 of 450 points" in caplog.text
    assert "s left" in caplog.text
    assert tracer.rays_traced == 450 * 512


def test_an_interrupt_drops_what_has_not_begun(monkeypatch):
    monkeypatch.setattr(transfer, "CHUNK_RAYS", 16)
    mesh, begun = soup(100, 7), []
    positions, normals = surface_points(mesh, 400, 8)
    tracer = Tracer(mesh)
    gather = tracer.gather
    monkeypatch.setattr(tracer, "gather", lambda *rest: begun.append(1) or gather(*rest))

    def stop(done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bake(tracer, positions, normals, directions=16, progress=stop, threads=1)
    assert len(begun) < 400


def test_no_points_no_rows():
    assert bake(Tracer(soup(10, 0)), np.zeros((0, 3)), np.zeros((0, 3))).shape == (0, 25)


def test_bad_points_are_named():
    tracer = Tracer(soup(10, 0))
    with pytest.raises(PrtnetError, match="length 2"):
        bake(tracer, np.zeros((1, 3)), np.array([[0.0, 2, 0]]))
    with pytest.raises(PrtnetError, match="not finite"):
        bake(tracer, np.full((1, 3), np.nan), np.array([[0.0, 1, 0]]))


def test_unit_scene_and_file_scene_are_one():
    mesh = soup(200, 9)
    positions, normals = surface_points(mesh, 100, 1)
    far = scene(mesh.vertices * 7 + 3, mesh.faces)
    frame = frame_of(far.vertices)
    expected = bake(Tracer(far.centred()), frame.to_unit(positions * 7 + 3), normals)
    np.testing.assert_array_equal(bake(Tracer(far), positions * 7 + 3, normals), expected)


def test_samples_go_straight_in():
    mesh = soup(50, 2)
    picked = samples.at_barycentric(mesh, np.arange(50), np.full((50, 3), 1 / 3))
    found = bake(Tracer(mesh), picked.positions, picked.normals, geometric_normals=picked.geometric_normals, bands=4)
    assert found.shape == (50, 16)
    assert found.dtype == np.float32
