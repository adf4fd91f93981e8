"""The path tracer against closed forms: an integrating sphere, a white furnace, one bounce by quadrature."""

import numpy as np
import pytest
import trimesh

from prtnet import PrtnetError
from prtnet.data import samples, transfer
from prtnet.data.lighting.lamp import Lamp, Lighting, together
from prtnet.data.lightmap import paths
from prtnet.data.part import Part
from prtnet.data.scene import assemble
from prtnet.data.tracer import Tracer
from tests.data.lightmap.enclosures import closed_box, cornell, quad

WHITE = Lighting((), np.array([[np.sqrt(4 * np.pi)] * 3], np.float32))  # radiance 1 from everywhere


def traced(scene, points, lightings, *, seed=0, kind="auto", **options):
    albedo = np.full((len(points.positions), 3), 0.5, np.float32)
    rng = np.random.default_rng(seed)
    return paths.radiance(Tracer(scene, kind=kind), scene, points, albedo, lightings, rng=rng, **options)


@pytest.mark.parametrize("kind", ["fused", "embreex"])
def test_integrating_sphere(kind):
    """A lamp in the middle of a sphere lights all of it alike: bounce b brings albedo^b of that."""
    ball, albedo = trimesh.creation.icosphere(4), np.array([0.8, 0.5, 0.1])
    inwards = -np.asarray(ball.vertices)
    shell = Part("shell", np.asarray(ball.vertices), ball.faces[:, ::-1], inwards, albedo=albedo, two_sided=False)
    scene = assemble("sphere", [shell])
    points = samples.area_uniform(scene, 40, np.random.default_rng(0))
    lamp = Lighting((Lamp("point", (1, 2, 3)),))
    found = traced(scene, points, [lamp], samples=32, bounces=5, kind=kind)
    expected = np.array([1, 2, 3]) * sum(albedo**bounce for bounce in range(1, 6))
    np.testing.assert_allclose(found.direct[0], np.broadcast_to([1, 2, 3], (40, 3)), rtol=6e-3)
    np.testing.assert_allclose(found.indirect[0], np.broadcast_to(expected, (40, 3)), rtol=1e-2)
    np.testing.assert_allclose(found.radiance, 0.5 / np.pi * (found.direct + found.indirect), rtol=1e-5)
    assert found.noise.max() < 0.01


def test_white_furnace():
    """Albedo 1 under light 1: every path that leaves brings pi, so a valley of sheets gets pi without noise."""
    sides = [
        quad(name, [0, 0, 1], [0, 0, -2], [x, 1, 0], albedo=np.ones(3), two_sided=True)
        for name, x in (("left", -0.5), ("right", 0.5))
    ]
    scene = assemble("valley", sides).centred()
    points = samples.area_uniform(scene, 50, np.random.default_rng(0))
    found = traced(scene, points, [WHITE], samples=16, bounces=50)
    assert found.indirect.max() > 1
    np.testing.assert_allclose(found.direct + found.indirect, np.full((1, 50, 3), np.pi), rtol=1e-5)
    few = traced(scene, points, [WHITE], samples=16, bounces=1)
    assert (few.direct + few.indirect).min() < 0.99 * np.pi


@pytest.mark.parametrize("flipped", [False, True])
def test_one_bounce_off_a_sheet_by_quadrature(flipped):
    """A lamp lights one side of a sheet, and that side a point: albedo / pi E_0 cos cos / d^2 over it. Turned over, the
    sheet shows its back, and its texture stays where it is."""
    image = np.ones((1, 2, 3), np.float32) * np.float32([[[0.9], [0.1]]])
    right, up = np.array([2.0, 0, 0]), np.array([0.0, 0, 2])
    options = {"texture": image, "albedo": np.ones(3), "two_sided": True}
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    if flipped:
        right, up, uv = up, right, uv[:, ::-1]
    sheet = quad("sheet", [-1, 1, -1], right, up, uv=uv, **options)
    floor = quad("floor", [-1, 0, 1], [2, 0, 0], [0, 0, -2], albedo=np.zeros(3), two_sided=False)
    scene = assemble("sheets", [floor, sheet])
    unit = scene.frame.to_unit
    lamp = np.array([-0.4, 0.5, 0.3])
    position = np.array([[0.5, 0, 0.2], [-0.7, 0, 0.1]])
    normals = np.tile(np.float32([0, 1, 0]), (2, 1))
    points = samples.Samples(position, normals, normals, np.zeros(2, np.int32))
    middle = (np.arange(400) + 0.5) / 200 - 1
    x, z = np.meshgrid(middle, middle, indexing="ij")
    at = np.stack([x.ravel(), np.ones(x.size), z.ravel()], axis=1)

    def form(origin):
        away = at - origin
        squared = np.einsum("ni,ni->n", away, away)
        return away[:, 1] / np.sqrt(squared), squared

    cosine, squared = form(lamp)
    # sheets' texture, bilinear between the two texels
    albedo = 0.9 - 0.8 * np.clip(at[:, 0] + 0.5, 0, 1)
    wrapped = np.abs(at[:, 0]) > 0.5
    albedo[wrapped] = 0.5 + 0.8 * np.where(at[wrapped, 0] < 0, at[wrapped, 0] + 1, at[wrapped, 0] - 1)
    sent = albedo / np.pi * cosine / squared
    expected = []
    for origin in position:
        cosine, squared = form(origin)
        expected.append(np.sum(sent * cosine * cosine / squared) * (2 / 400) ** 2)
    lit = Lighting((Lamp("point", (1, 1, 1), tuple(unit(lamp))),))
    found = traced(scene, points, [lit], samples=1 << 15, bounces=1)
    # distances of lamps are in unit lengths
    measured = found.indirect[0, :, 0] * scene.frame.scale**2
    np.testing.assert_allclose(measured, expected, atol=4 * found.noise.max() * scene.frame.scale**2)
    np.testing.assert_allclose(measured, expected, rtol=0.02)


def test_lights_add_up_on_shared_paths_whatever_the_threads():
    scene = cornell()
    points = samples.area_uniform(scene, 300, np.random.default_rng(0))
    lamp = Lighting((Lamp("spot", (1, 0.5, 2), (0.0, 0.5, 0.2), (0.0, -1.0, 0.0)),))
    distant = Lighting((), np.random.default_rng(1).normal(size=(9, 3)).astype(np.float32))
    lights, done = [lamp, distant, together([lamp, distant])], []
    found = traced(scene, points, lights, samples=16, bounces=3, threads=1, progress=done.append)
    for each in (found.direct, found.indirect):
        np.testing.assert_allclose(each[2], each[0] + each[1], rtol=1e-4, atol=1e-5)
    again = traced(scene, points, lights, samples=16, bounces=3, threads=2)
    np.testing.assert_array_equal(found.indirect, again.indirect)
    assert done[-1] == 300


def test_noise_is_what_repeats_differ_by_and_transfer_makes_direct_light_exact():
    scene = cornell()
    points = samples.area_uniform(scene, 300, np.random.default_rng(0))
    lit = [Lighting((Lamp("point", (1, 1, 1), (0.1, 0.4, 0.2)),), np.float32([[1.5] * 3, [0.5] * 3, [0] * 3, [0] * 3]))]
    first, second = (traced(scene, points, lit, samples=64, seed=seed) for seed in (0, 1))
    spread = np.sqrt(np.mean((first.direct + first.indirect - second.direct - second.indirect) ** 2) / 2)
    assert np.sqrt(np.mean(first.noise**2)) == pytest.approx(spread, rel=0.15)
    seen = transfer.bake(
        Tracer(scene), points.positions, points.normals, geometric_normals=points.geometric_normals,
        bands=2, directions=2048, rng=np.random.default_rng(0),
    )  # fmt: skip
    exact = traced(scene, points, lit, samples=16, transfer_of=seen)
    difference = (first.direct - exact.direct)[0]
    assert 0 < np.sqrt(np.mean(difference**2)) < 2 * np.sqrt(np.mean(first.noise**2))
    assert np.abs(difference.mean()) < 4 * np.sqrt(np.mean(first.noise**2) / 300)
    # there is less noise where no direct light is sampled
    assert np.mean(exact.noise**2) < 6 * np.mean(first.noise**2)


def test_bad_counts_are_refused():
    scene = closed_box([0.5, 0.5, 0.5])
    points = samples.area_uniform(scene, 4, np.random.default_rng(0))
    for options in ({"samples": 0}, {"bounces": -1}):
        with pytest.raises(PrtnetError, match="path tracer: found"):
            traced(scene, points, [WHITE], **options)
    none = traced(scene, points, [WHITE], samples=8, bounces=0)
    assert not none.indirect.any()
    assert not none.direct.any()
