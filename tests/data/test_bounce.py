"""Interreflection: what a point gets from the surfaces it sees, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from prtnet import sh
from prtnet.data import atlas, builtin, samples, surface, texture, transfer
from prtnet.data.part import Part
from prtnet.data.scene import IDENTITY, assemble
from prtnet.data.tracer import Tracer

SIZE = 256


def closed_box(albedo):
    """Seen from inside."""
    box = trimesh.creation.box((2, 2, 2))
    walls = Part("walls", np.asarray(box.vertices), box.faces[:, ::-1], albedo=np.asarray(albedo), two_sided=False)
    return assemble("box", [walls])


def kept(scene):
    """(surface, texels, albedo) of an atlas of the scene."""
    made = atlas.make(scene, size=SIZE)
    texels = texture.gbuffer(made, SIZE)
    return surface.of_atlas(scene, made, [texels]), texels, surface.texel_albedo(made, [texels])


def bounce(tracer, points, *args, seed=0, **options):
    options.setdefault("geometric_normals", points.geometric_normals)
    rng = np.random.default_rng(seed)
    return transfer.bounce(tracer, points.positions, points.normals, *args, rng=rng, **options)


@pytest.mark.parametrize("kind", ["cosine_fibonacci", "uniform"])
@pytest.mark.parametrize("tracer", ["fused", "embreex"])
def test_in_a_closed_box_constant_transfer_comes_back_times_the_albedo(kind, tracer):
    scene = closed_box([0.8, 0.5, 0.1]).centred()
    found, _, albedo = kept(scene)
    constant = np.random.default_rng(0).normal(size=(9, 3))
    sent = surface.outgoing(albedo, np.broadcast_to(constant, (len(albedo), 9, 3)))
    points = samples.area_uniform(scene, 200, np.random.default_rng(1))
    back = bounce(Tracer(scene, kind=tracer), points, found, sent, kind=kind)
    np.testing.assert_allclose(back, np.broadcast_to(constant * [0.8, 0.5, 0.1], back.shape), atol=2e-5)


def test_compiled_and_plain_agree():
    scene = builtin.make("plants", tessellation=0.4).centred()
    found, texels, albedo = kept(scene)
    rng = np.random.default_rng(0)
    sent = surface.outgoing(albedo, rng.normal(size=(len(texels.index), 4)).astype(np.float32))
    points = samples.area_uniform(scene, 100, rng)
    fused, plain = (Tracer(scene, kind=kind) for kind in ("fused", "embreex"))
    first, second = (bounce(tracer, points, found, sent, directions=128) for tracer in (fused, plain))
    assert np.abs(first).max() > 0.05
    np.testing.assert_allclose(first, second, atol=1e-6)
    light = np.ascontiguousarray(sent[:, 0])
    one, two = (
        transfer.incident(tracer, points.positions, points.normals, found, light, rng=np.random.default_rng(0))
        for tracer in (fused, plain)
    )
    np.testing.assert_allclose(one, two, atol=1e-6)


def test_free_directions_and_unseen_backs_send_nothing():
    """A one-sided floor below a one-sided ceiling that both look up: the floor sees the ceiling's back."""
    floor = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1.0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    for two_sided, least, most in ((False, 0, 0), (True, 0.02, 1)):
        ceiling = Part("ceiling", floor + [0, 0.5, 0], faces, two_sided=two_sided)
        scene = assemble("sheets", [Part("floor", floor, faces, two_sided=False), ceiling]).centred()
        found, texels, albedo = kept(scene)
        sent = surface.outgoing(albedo, np.ones((len(texels.index), 1), np.float32))
        points = samples.area_uniform(scene, 400, np.random.default_rng(0))
        below = points.positions[:, 1] < 0.01 * np.ptp(scene.vertices[:, 1]) + scene.vertices[:, 1].min()
        back = bounce(Tracer(scene), samples.select(points, np.flatnonzero(below)), found, sent)
        assert least <= back.mean() <= most
        assert (back.max() > 0) == two_sided


def test_backs_answer_where_they_are_hit():
    """A large sheet: its back's texels lie behind the points that are hit, not mirrored within their triangles."""
    corners = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1.0]])
    sheet = Part("sheet", corners, np.array([[0, 1, 2], [0, 2, 3]]), two_sided=True)
    scene = assemble("sheet", [sheet]).centred()
    found, texels, _ = kept(scene)
    rng = np.random.default_rng(0)
    face, weights = rng.integers(2, size=500).astype(np.int32), rng.dirichlet([1, 1, 1], 500)
    points = np.einsum("ni,nij->nj", weights, scene.vertices[scene.faces[face]])
    for front in (True, False):
        rows = found.rows(face, weights[:, 1:].astype(np.float32), np.full(500, front))
        assert np.linalg.norm(points - texels.positions[rows], axis=1).max() < 0.03
        assert np.all((texels.normals[rows] @ scene.face_normals[0] > 0) == front)


def test_incident_light_is_a_function_of_direction():
    """In a closed box of constant radiance nothing is free: J is the cosine lobe times the radiance, per colour."""
    scene = closed_box([1.0, 1, 1]).centred()
    found, texels, _ = kept(scene)
    sent = np.tile(np.float32([0.2, 1, 3]), (len(texels.index), 1))
    points = samples.area_uniform(scene, 100, np.random.default_rng(1))
    options = {"geometric_normals": points.geometric_normals, "rng": np.random.default_rng(0), "directions": 2048}
    back = transfer.incident(Tracer(scene), points.positions, points.normals, found, sent, bands=4, **options)
    expected = sh.cosine_lobe(points.normals, 4)[:, :, None] * sent[0]
    assert np.abs(back - expected).max() < 6e-3


def test_irradiance_of_both_forms_is_the_same():
    """sqrt(4 pi) J_0 under a light is the sum of the bounced responses times that light."""
    scene = builtin.make("cornell").centred()
    found, texels, albedo = kept(scene)
    tracer, rng = Tracer(scene), np.random.default_rng(0)
    direct = transfer.bake(tracer, texels.positions, texels.normals, directions=128, bands=3, rng=rng)
    light = rng.normal(size=(9, 3)).astype(np.float32)
    points = samples.area_uniform(scene, 100, rng)
    responses = bounce(tracer, points, found, surface.outgoing(albedo, direct))
    radiance = surface.outgoing(albedo, (direct @ light)[:, None, :])[:, 0]
    options = {"geometric_normals": points.geometric_normals, "rng": np.random.default_rng(0)}
    seen = transfer.incident(tracer, points.positions, points.normals, found, radiance, bands=2, **options)
    irradiance = np.einsum("nkc,kc->nc", responses, light)
    np.testing.assert_allclose(np.sqrt(4 * np.pi) * seen[:, 0], irradiance, atol=1e-4)


def test_the_nearest_texel_answers():
    """Every point finds a texel of its own face, at most a texel away."""
    scene = builtin.make("plants", tessellation=0.4).centred()
    found, texels, _ = kept(scene)
    rng = np.random.default_rng(0)
    face = rng.integers(len(scene.faces), size=2000)
    weights = rng.dirichlet([1, 1, 1], 2000)
    front = (rng.random(2000) < 0.5) | ~scene.two_sided[face]
    rows = found.rows(face.astype(np.int32), weights[:, 1:].astype(np.float32), front)
    assert np.all(rows >= 0)
    points = np.einsum("ni,nij->nj", weights, scene.vertices[scene.faces[face]])
    away = np.linalg.norm(points - texels.positions[rows], axis=1)
    assert np.median(away) < 0.05
    normals = scene.face_normals[face] * np.where(front, 1, -1)[:, None]
    assert np.mean(np.einsum("ni,ni->n", normals, texels.geometric_normals[rows]) > 0) > 0.99


@pytest.mark.parametrize("name", ["cornell", "plants"])
def test_white_furnace(name):
    """Albedo 1 under light 1: what a point sends rises with every bounce and never exceeds 1."""
    scene = builtin.make(name, tessellation=0.4).centred()
    found, texels, _ = kept(scene)
    tracer, light = Tracer(scene), np.sqrt(4 * np.pi)
    everywhere = {"directions": 256, "bands": 1, "rng": np.random.default_rng(0)}
    direct = transfer.bake(
        tracer, texels.positions, texels.normals, geometric_normals=texels.geometric_normals, **everywhere
    )
    points = samples.area_uniform(scene, 2000, np.random.default_rng(1))
    white, options = np.ones((len(direct), 3), np.float32), {"geometric_normals": points.geometric_normals}
    radiance = transfer.bake(tracer, points.positions, points.normals, **options, **everywhere) * light / np.pi
    sent, total, means = surface.outgoing(white, direct), radiance.astype(np.float64), [radiance.mean()]
    for _ in range(4):
        back = bounce(tracer, points, found, sent, directions=256)[..., 0] * light / np.pi
        assert back.min() >= 0
        total = total + back
        means.append(total.mean())
        texel_points = samples.Samples(texels.positions, texels.normals, texels.geometric_normals, texels.face)
        sent = surface.outgoing(white, bounce(tracer, texel_points, found, sent, directions=64))
    assert np.all(np.diff(means) > 1e-4)
    assert total.max() < 1 + 0.02  # the noise of 64 rays at a texel
    assert means[-1] > means[0] + 0.02


def test_light_turned_is_scene_turned():
    """Scene and light turned by the same rotation: every point sends what it sent, directly and after a bounce."""
    scene = builtin.make("cornell", tessellation=0.4).centred()
    angle = 0.7
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    turn = turn @ np.array([[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]])
    light = np.random.default_rng(0).normal(size=(16, 3))
    points = samples.area_uniform(scene, 400, np.random.default_rng(1))

    def radiance(turned, coefficients, positions, normals):
        tracer, rng = Tracer(turned), np.random.default_rng(2)
        found, texels, albedo = kept(turned)
        options = {"bands": 4, "directions": 1024, "rng": rng}
        direct = transfer.bake(
            tracer, texels.positions, texels.normals, geometric_normals=texels.geometric_normals, **options
        )
        own = transfer.bake(tracer, positions, normals, **options)
        sent = surface.outgoing(albedo, direct)
        back = transfer.bounce(tracer, positions, normals, found, sent, directions=1024, rng=rng)
        return own @ coefficients, np.einsum("nkc,kc->nc", back, coefficients)

    moved = replace(
        scene,
        vertices=scene.vertices @ turn.T,
        normals=(scene.normals @ turn.T).astype(np.float32),
        frame=IDENTITY,
    )
    sides = points.geometric_normals.astype(np.float64)
    before = radiance(scene, light, points.positions, sides)
    after = radiance(moved, sh.rotate(light, turn), points.positions @ turn.T, sides @ turn.T)
    for first, second in zip(before, after, strict=True):
        scale = np.sqrt(np.mean(np.square(first)))
        assert scale > 0.05
        # texels lie elsewhere and rays are turned: noise, and nothing but noise
        assert np.sqrt(np.mean(np.square(first - second))) < 0.08 * scale
        assert np.abs((first - second).mean(axis=0)).max() < 0.01 * scale
