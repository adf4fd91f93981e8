"""Data-driven transfer on screen: direct shading plus the operator's light, by look-ups in NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError, data_driven
from prtnet.data import atlas, atlas_set
from prtnet.data.lighting.lamp import Lamp, Lighting, arriving
from prtnet.data.texture import page_of
from prtnet.data_driven import DataDriven, Measurement
from prtnet.render.camera import Camera
from prtnet.render.data_driven import DataDrivenMethod, DataDrivenTexture, distant
from prtnet.render.gbuffer import GBuffer
from prtnet.render.lamps import LampMethod
from prtnet.render.material import Material
from prtnet.render.method import TextureMethod
from prtnet.render.raster import Raster
from prtnet.render.shadow_maps import ShadowMaps
from tests.operators import measurement, random_spec
from tests.render.meshes import bilinear, quad, scene

SIZE, POINTS = 48, 9
CAMERA = Camera((0.4, 0.6, 3.0), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
LAMP = Lighting((Lamp("point", (1.0, 2.0, 3.0), (0.3, -0.2, 0.8)),))
SUN = Lighting((Lamp("directional", (2.0, 1.0, 0.5), aim=(0.0, 0.0, -1.0)),))
LIGHT = np.random.default_rng(3).normal(size=(9, 3)).astype(np.float32)


@pytest.fixture(scope="module")
def board() -> Raster:
    """A board that faces +z: nothing is in the way anywhere."""
    made = scene(quad([-1, -1, 0], [2, 0, 0], [0, 2, 0], albedo=np.array([0.8, 0.5, 0.2])))
    return Raster(atlas.make(made, size=64), SIZE)


def smooth(channels: int, size: int = 32) -> np.ndarray:
    """Images without steps, so that the fractions that hardware rounds do not show."""
    v, u = np.meshgrid(*[(np.arange(size) + 0.5) / size] * 2, indexing="ij")
    return np.stack([np.cos((1 + i % 3) * u + (i // 3) * v + i) for i in range(channels)], axis=-1).astype(np.float32)


def made_spec(*, coefficients=0, **more) -> DataDriven:
    """Smooth basis textures, and measurement points on the board."""
    rng = np.random.default_rng(5)
    spec = random_spec(elements=6, points=POINTS, size=32, texels=np.arange(32 * 32), **more)
    rows = np.stack([np.linalg.qr(smooth(9).reshape(-1, 9)[:, [*range(1 + bank, 7 + bank)]])[0].T for bank in range(3)])
    up = np.tile(np.array([0, 0, 1], np.float32), (POINTS, 2, 1))
    where = rng.uniform(-0.9, 0.9, (POINTS, 2, 3)).astype(np.float32)
    where[..., 2] = 0
    albedo = np.broadcast_to(np.array([0.8, 0.5, 0.2], np.float32), where.shape).copy()
    points = Measurement(where, up, up, albedo, measurement(rng, POINTS, coefficients).transfer)
    count = len(spec.measurements)
    basis = rows[: len(spec.basis)].astype(np.float32)
    # rows have length 1: by the square root of their texels what they add up to is of order 1
    return replace(spec, basis=basis, matrices=32 * spec.matrices, measurements=(points,) * count)


def bounced(spec: DataDriven, found: GBuffer, direct: np.ndarray, keyframe: int = 0) -> np.ndarray:
    """The operator's light at the covered pixels, by bilinear look-ups in NumPy."""
    assert found.uv is not None
    u = data_driven.coefficients(spec, direct, keyframe)
    basis = np.broadcast_to(spec.basis, (3, *spec.basis.shape[1:]))
    looked = np.stack([bilinear(data_driven.image(spec, bank.T), found.uv) for bank in basis], axis=2)
    return data_driven.from_space(np.maximum(np.einsum("pnc,nc->pc", looked, u), 0), spec.gamma)


def direct_of(spec: DataDriven, lighting: Lighting) -> np.ndarray:
    """Closed form: nothing is in the way."""
    points, total = spec.measurements[0], 0.0
    for lamp in lighting.lamps:
        towards, _, strength = arriving(lamp, points.positions.reshape(-1, 3))
        total += np.maximum(towards[:, 2], 0)[:, None] * strength[:, None] * np.asarray(lamp.colour)
    return (points.albedo / np.pi * np.reshape(total, points.albedo.shape)).mean(axis=1)


@pytest.mark.parametrize("lighting", [LAMP, SUN])
@pytest.mark.parametrize("more", [{}, {"banks": 3}, {"gamma": 2.2, "banks": 3}, {"keyframes": 2}])
def test_direct_light_and_the_operators(board, more, lighting):
    spec, found = made_spec(**more), board.gbuffer(CAMERA)
    keyframe = len(spec.measurements) - 1
    method = DataDrivenMethod(board, spec, texels="float32")
    drawn = method.draw(CAMERA, lighting, keyframe).reshape(-1, 3)
    alone = LampMethod(board).draw(CAMERA, lighting).reshape(-1, 3)
    direct = direct_of(spec, lighting)
    u = data_driven.coefficients(spec, direct, keyframe)
    np.testing.assert_allclose(method.coefficients(), u, atol=1e-5 * np.abs(u).max())
    expected = found.albedo / np.pi * bounced(spec, found, direct, keyframe)
    assert expected.max() > 0.05
    error = np.abs((drawn - alone)[found.pixel] - expected)
    # filters have 8 bits of fraction
    assert error.max() < 0.01 * expected.max()
    assert np.delete(drawn, found.pixel, axis=0).max(initial=0.0) == 0


def test_radiance_is_shown_as_it_is(board):
    """Light that leaves by itself: no albedo, and no direct light beside it."""
    spec, found = made_spec(quantity="radiance"), board.gbuffer(CAMERA)
    drawn = DataDrivenMethod(board, spec, texels="float32").draw(CAMERA, LAMP).reshape(-1, 3)[found.pixel]
    expected = bounced(spec, found, direct_of(spec, LAMP))
    assert np.abs(drawn - expected).max() < 0.01 * expected.max()


def test_held_anywhere_it_is_the_same(board):
    spec = made_spec()
    frames = [DataDrivenMethod(board, spec, held=held).draw(CAMERA, LAMP) for held in ("uniform", "block", "texture")]
    np.testing.assert_array_equal(frames[0], frames[1])
    np.testing.assert_array_equal(frames[0], frames[2])


def test_a_shadow_reaches_the_points(board):
    """A screen between lamp and board: the points see nothing of the lamp, and nothing bounces."""
    screen = quad([-1, -1, 0.3], [2, 0, 0], [0, 2, 0], two_sided=True, name="screen")
    behind = scene(quad([-1, -1, 0], [2, 0, 0], [0, 2, 0]), screen)
    spec = made_spec()
    method = DataDrivenMethod(board, spec, shadows=ShadowMaps(behind))
    method.draw(CAMERA, LAMP)
    assert not method.coefficients().any()
    lit = DataDrivenMethod(board, spec)
    lit.draw(CAMERA, LAMP)
    assert np.abs(lit.coefficients()).max() > 0.1


def test_lamps_add_up(board):
    """The operator is linear: u of two lamps is that of each, and twice the light is twice u."""
    method = DataDrivenMethod(board, made_spec())
    found = []
    for lamps in (LAMP.lamps, SUN.lamps, LAMP.lamps + SUN.lamps):
        method.set_lighting(Lighting(lamps))
        found.append(method.coefficients())
    np.testing.assert_allclose(found[0] + found[1], found[2], atol=1e-5 * np.abs(found[2]).max())


def test_environment(board):
    """Light from far away: direct by transfer textures, at the points by their own transfer."""
    spec, found = made_spec(coefficients=9), board.gbuffer(CAMERA)
    page = page_of(smooth(9))
    lighting = Lighting((), LIGHT)
    drawn = DataDrivenMethod(board, spec, pages=[page], texels="float32").draw(CAMERA, lighting).reshape(-1, 3)
    by_texture = DataDrivenTexture(board, [page], spec, texels="float32", basis_texels="float32")
    np.testing.assert_allclose(by_texture.draw(CAMERA, LIGHT).reshape(-1, 3), drawn, atol=1e-5 * np.abs(drawn).max())
    alone = TextureMethod(board, [page]).draw(CAMERA, LIGHT).reshape(-1, 3)
    expected = found.albedo / np.pi * bounced(spec, found, distant(spec.measurements[0], LIGHT))
    assert expected.max() > 0.05
    assert np.abs((drawn - alone)[found.pixel] - expected).max() < 0.01 * expected.max()
    assert by_texture.bytes == 32 * 32 * 4 * (12 + 8) + 8 * 3 * 16


@pytest.mark.parametrize("product", ["fixed_light", "full"])
def test_gloss_takes_the_direct_light(board, product):
    """What bounces is diffuse: it adds the same to a glossy material as to a diffuse one."""
    spec, page = made_spec(coefficients=9), page_of(smooth(9))
    material = Material(diffuse=0.5, specular=(0.3, 0.3, 0.3), product=product)
    drawn = DataDrivenTexture(board, [page], spec, material=material, texels="float32").draw(CAMERA, LIGHT)
    alone = TextureMethod(board, [page], material=material).draw(CAMERA, LIGHT)
    both = DataDrivenTexture(board, [page], spec, texels="float32").draw(CAMERA, LIGHT)
    expected = 0.5 * (both - TextureMethod(board, [page]).draw(CAMERA, LIGHT))
    np.testing.assert_allclose(drawn - alone, expected, atol=1e-4 * np.abs(expected).max() + 1e-5)


def test_what_cannot_be(board):
    spec = made_spec()
    with pytest.raises(PrtnetError, match=r"found keyframe 1, expected 0 to 0"):
        DataDrivenMethod(board, spec).draw(CAMERA, LAMP, 1)
    with pytest.raises(PrtnetError, match=r"found 0 coefficients of transfer at measurement points for a light of 9"):
        DataDrivenTexture(board, [page_of(smooth(9))], spec).draw(CAMERA, LIGHT)
    with pytest.raises(PrtnetError, match=r"found a basis of radiance, expected one of irradiance"):
        DataDrivenTexture(board, [page_of(smooth(9))], replace(spec, quantity="radiance"))
    parts = scene(quad([-1, -1, 0], [1, 0, 0], [0, 1, 0]), quad([0, 0, 0], [1, 0, 0], [0, 1, 0], name="other"))
    made = atlas_set.make(parts, size=64, single_chart=False, unwrap_mode="never", padding=1)
    with pytest.raises(PrtnetError, match=r"atlas\.sets: found parts, expected one"):
        DataDrivenMethod(Raster(made, SIZE), spec)


def test_bytes_of_all(board):
    """Textures and matrices are padded to whole texels of four; points count as in `data_driven.byte_count`."""
    spec = made_spec()
    method = DataDrivenMethod(board, spec)
    padding = 4 * (8 * 12 - 6 * POINTS)
    assert method.bytes == data_driven.byte_count(spec, 2) + padding
