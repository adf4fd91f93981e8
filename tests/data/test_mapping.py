"""Where texels look and how much of the sphere they are: published formulas, dense sums, and OpenGL's own look-up."""

import moderngl
import numpy as np
import pytest

from prtnet import gl
from prtnet.data import mapping

SIZES = {"lat_long": (16, 32), "angular": (33, 33), "cube": (8, 8)}
AXES = np.concatenate([np.eye(3), -np.eye(3)])


def unit(count, seed=0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.parametrize("kind", mapping.MAPPINGS)
@pytest.mark.parametrize("size", [4, 7, 64])
def test_solid_angles_fill_the_sphere(kind, size):
    angles = mapping.solid_angles(kind, size, 2 * size if kind == "lat_long" else size)
    assert angles.sum() == pytest.approx(4 * np.pi, rel=1e-11)
    assert angles.min() >= 0


@pytest.mark.parametrize("kind", mapping.MAPPINGS)
def test_solid_angles_are_the_areas_of_small_steps(kind):
    """A fine grid's texels, summed, against a coarse grid's: and the fine ones are centre densities."""
    factor, size = 32, 8
    coarse = mapping.solid_angles(kind, size, size)
    fine = (np.arange(size * factor) + 0.5) / (size * factor) * 2 - 1
    right, down = np.meshgrid(fine, fine)
    if kind == "lat_long":
        density = np.pi / 2 * np.cos(down * np.pi / 2) * np.pi
    elif kind == "angular":
        radius = np.hypot(right, down)
        density = np.where(radius < 1, np.pi * np.sin(np.pi * radius) / radius, 0)
    else:
        density = (1 + right**2 + down**2) ** -1.5
    expected = density.reshape(size, factor, size, factor).sum((1, 3)) * (2 / (size * factor)) ** 2
    for panel in coarse:
        np.testing.assert_allclose(panel, expected, atol=2e-4)


def test_outside_the_disc_there_is_nothing():
    angles = mapping.solid_angles("angular", 64, 64)[0]
    rows, columns = np.indices((65, 65)) / 32 - 1
    outside = np.hypot(rows, columns) >= 1
    corners = outside[1:, 1:] & outside[1:, :-1] & outside[:-1, 1:] & outside[:-1, :-1]
    assert (angles[corners] == 0).all()
    assert (angles[~corners] > 0).all()
    assert corners.sum() > 100


@pytest.mark.parametrize("kind", mapping.MAPPINGS)
def test_locate_is_the_inverse_of_directions(kind):
    height, width = SIZES[kind]
    towards = mapping.directions(kind, height, width)
    np.testing.assert_allclose(np.linalg.norm(towards, axis=-1), 1, atol=1e-12)
    panel, row, column = mapping.locate(kind, towards, height, width)
    inside = np.ones(panel.shape, bool)
    if kind == "angular":
        rows, columns = (np.indices((height, width)) + 0.5) / height * 2 - 1
        inside[0] = np.hypot(rows, columns) < 1
    expected = np.indices(panel.shape)
    for found, wanted in zip((panel, row, column), expected, strict=True):
        np.testing.assert_allclose(found[inside], wanted[inside], atol=1e-9)


def test_the_angular_map_follows_its_formula():
    """r = acos(-z) / (pi sqrt(x^2 + y^2)), image = (x r, y r): centre -z, half-way up +y, rim +z."""
    axes = [[0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]]
    _, row, column = mapping.locate("angular", np.array(axes, float), 100, 100)
    found = np.stack([(column + 0.5) / 50 - 1, 1 - (row + 0.5) / 50], axis=1)
    np.testing.assert_allclose(found, [[0, 0], [0.5, 0], [-0.5, 0], [0, 0.5], [0, -0.5], [1, 0]], atol=1e-9)
    towards = unit(100)
    factor = np.arccos(-towards[:, 2]) / (np.pi * np.hypot(towards[:, 0], towards[:, 1]))
    _, row, column = mapping.locate("angular", towards, 100, 100)
    np.testing.assert_allclose((column + 0.5) / 50 - 1, towards[:, 0] * factor, atol=1e-9)
    np.testing.assert_allclose(1 - (row + 0.5) / 50, towards[:, 1] * factor, atol=1e-9)


LOOK_UP = """#version 330
uniform samplerCube sky;
uniform sampler2D towards;
out vec4 found;
void main() { found = texture(sky, texelFetch(towards, ivec2(gl_FragCoord.xy), 0).xyz); }
"""
WHOLE = "#version 330\nin vec2 at; void main() { gl_Position = vec4(at, 0, 1); }"


def opengl_cube(faces, towards):
    """`texture(samplerCube, w)` of the nearest texel for each direction."""
    context, count = gl.context(), len(towards)
    program = context.program(vertex_shader=WHOLE, fragment_shader=LOOK_UP)
    cube = context.texture_cube(faces.shape[1:3], 4, faces.astype("f4").tobytes(), dtype="f4")
    cube.filter = (moderngl.NEAREST, moderngl.NEAREST)
    asked = context.texture((count, 1), 3, towards.astype("f4").tobytes(), dtype="f4")
    target = context.framebuffer([context.texture((count, 1), 4, dtype="f4")])
    target.use()
    program["sky"], program["towards"] = 0, 1
    cube.use(0)
    asked.use(1)
    corners = context.buffer(np.array([-1, -1, 3, -1, -1, 3], "f4").tobytes())
    context.vertex_array(program, [(corners, "2f", "at")]).render(moderngl.TRIANGLES)
    return np.frombuffer(target.read(components=4, dtype="f4"), "f4").reshape(count, 4)


def test_cube_faces_are_those_of_opengl():
    size, rng = 6, np.random.default_rng(0)
    faces = rng.random((6, size, size, 4), dtype=np.float32)
    towards = mapping.directions("cube", size, size).reshape(-1, 3)
    np.testing.assert_array_equal(opengl_cube(faces, towards), faces.reshape(-1, 4))
    anywhere = unit(500, 3)
    panel, row, column = mapping.locate("cube", anywhere, size, size)
    # a texel's border is anybody's
    clear = (np.abs(row % 1 - 0.5) > 1e-3) & (np.abs(column % 1 - 0.5) > 1e-3)
    expected = faces[panel, np.round(row).astype(int), np.round(column).astype(int)]
    np.testing.assert_array_equal(opengl_cube(faces, anywhere)[clear], expected[clear])


@pytest.mark.parametrize("kind", mapping.MAPPINGS)
def test_look_up_and_lat_long_show_what_was_drawn(kind):
    height = 64
    towards = mapping.directions(kind, height, 2 * height if kind == "lat_long" else height)
    drawn = 1 + towards * [0.5, 0.3, 0.4] + towards[..., [1, 2, 0]] * towards * 0.2
    asked = np.concatenate([unit(300), AXES])
    expected = 1 + asked * [0.5, 0.3, 0.4] + asked[:, [1, 2, 0]] * asked * 0.2
    if kind == "angular":
        rows, columns = (np.indices((height, height)) + 0.5) / height * 2 - 1
        drawn[0][np.hypot(rows, columns) > 1] = -100  # filler is never looked at
    # the last texels before the rim are 8 degrees from +z, and the slope is up to 0.5
    np.testing.assert_allclose(mapping.sample(kind, drawn, asked), expected, atol=0.075 if kind == "angular" else 0.03)
    image = mapping.to_lat_long(kind, drawn)
    there = mapping.lat_long_directions(*image.shape[:2])
    wanted = 1 + there * [0.5, 0.3, 0.4] + there[..., [1, 2, 0]] * there * 0.2
    assert image.shape[1] == 2 * image.shape[0]
    assert np.sqrt(np.mean((image - wanted) ** 2)) < 0.006
