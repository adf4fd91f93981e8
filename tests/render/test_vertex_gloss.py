"""Gloss at vertices: GLSL against NumPy, against shading at pixels on a fine mesh, and the highlight's place."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import sh
from prtnet.data import builtin, light, vertex
from prtnet.data.scene import Scene
from prtnet.render import material as materials
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import shade
from prtnet.render.material import Material, OfPart
from prtnet.render.vertex import VertexMethod, shade_vertices
from tests.render.meshes import quad, scene, sphere

SIZE = 96
EYE = Camera((0.4, 0.9, 2.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
SIDE = Camera((-2.0, 0.7, 1.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
PRODUCTS = [Material(0.5, (0.5, 0.25, 1.0), 20.0, product) for product in materials.PRODUCTS]
PARTS = {"ground": OfPart(0.2, (0.1, 0.6, 0.1), 4.0), "pot_cream": OfPart(exponent=60.0)}


def random_light(bands: int, seed: int = 3) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(bands**2, 3)).astype(np.float32)


@pytest.fixture(scope="module")
def plants() -> Scene:
    return vertex.mesh(builtin.make("plants", tessellation=0.4).centred(), ["ground"], 2)


def varied(mesh: Scene, bands: int) -> np.ndarray:
    """A transfer of its own for each vertex."""
    shade_of = np.random.default_rng(0).uniform(0.5, 1, len(mesh.vertices)).astype(np.float32)
    return sh.cosine_lobe(mesh.normals, bands) * shade_of[:, None]


def assert_agree(drawn: np.ndarray, expected: np.ndarray) -> None:
    """Everywhere but where graphics extrapolate: a face's snapped edge covers a centre that lies outside of it."""
    assert (expected != 0).any(axis=-1).mean() > 0.2
    error = np.abs(drawn - expected)
    assert np.percentile(error, 99.5) < 5e-5 * np.abs(expected).max()
    assert error.max() < 0.1 * np.abs(expected).max()


@pytest.mark.parametrize("shiny", PRODUCTS, ids=lambda m: m.product)
@pytest.mark.parametrize("bands", [1, 3, 5])
def test_glsl_agrees_with_numpy_from_every_eye(plants, shiny, bands):
    transfer = varied(plants, bands)
    method = VertexMethod(plants, transfer, SIZE, material=shiny)
    for seed, eye in ((3, EYE), (4, SIDE)):
        sun = random_light(bands, seed)
        assert_agree(method.draw(eye, sun), shade_vertices(method.raster, eye, transfer, sun, shiny))


@pytest.mark.parametrize("shiny", PRODUCTS, ids=lambda m: m.product)
@pytest.mark.parametrize(
    "changes",
    [
        {"parts": PARTS},
        {"light_bands": 5, "radiance_bands": 6},
        {"light_bands": 2, "radiance_bands": 4, "parts": PARTS},
        {"roughness": "file", "parts": {"pot_cream": OfPart(exponent=60.0)}},
    ],
    ids=["parts", "more bands", "fewer bands of light", "roughness"],
)
def test_what_varies_agrees_with_numpy(plants, shiny, changes):
    mesh, varying = plants, replace(shiny, **changes)
    if varying.roughness == "file":
        image = np.random.default_rng(1).uniform(0.4, 1, (4, 6)).astype(np.float32)
        rough = [replace(m, roughness=0.9, roughness_map=image if m.name == "ground" else None) for m in mesh.materials]
        mesh = replace(mesh, materials=tuple(rough), uv=mesh.vertices[:, [0, 2]].astype(np.float32))
    transfer = varied(mesh, 3)
    sun = random_light(varying.orders(3)[0])
    method = VertexMethod(mesh, transfer, SIZE, material=varying)
    drawn = method.draw(EYE, sun)
    assert_agree(drawn, shade_vertices(method.raster, EYE, transfer, sun, varying))
    if not varying.light_bands:
        plain = VertexMethod(mesh, transfer, SIZE, material=shiny).draw(EYE, sun)
        assert np.abs(plain - drawn).max() > 0.05 * np.abs(plain).max()


def test_on_a_fine_mesh_gloss_at_vertices_is_gloss_at_pixels():
    """A ball over a ground, nothing in the way: the error falls with the square of the edges."""
    shiny, sun = Material(0.3, (0.7, 0.7, 0.7), 30.0), light.by_name("sky").coefficients(5)
    errors = []
    for rows, level in ((12, 2), (24, 3), (48, 4)):
        floor = quad([-1, -0.5, 1], [2, 0, 0], [0, 0, -2], name="ground")
        mesh = vertex.mesh(scene(sphere(rows, radius=0.45), floor), ["ground"], level)
        method = VertexMethod(mesh, sh.cosine_lobe(mesh.normals, 5), SIZE, material=shiny)
        seen = method.raster.gbuffer(EYE)
        wanted = shade(seen, sh.cosine_lobe(seen.normals, 5), sun, shiny)
        errors.append(np.sqrt(np.mean((method.draw(EYE, sun) - wanted) ** 2)) / np.sqrt(np.mean(wanted**2)))
    assert errors[0] > 2.5 * errors[1] > 6 * errors[2]
    assert errors[2] < 8e-3


@pytest.mark.parametrize("shiny", PRODUCTS, ids=lambda m: m.product)
def test_the_highlight_follows_the_eye(shiny):
    """A ball under one lamp: from each eye the brightest pixel's normal halves the angle between lamp and eye."""
    mesh = vertex.mesh(scene(sphere(64)))
    row, column = 5, 11
    lamp, image = light.directions(16, 32)[row, column], np.zeros((16, 32, 3), np.float32)
    image[row, column] = 100.0
    mirror = replace(shiny, diffuse=0.0, specular=(1.0, 1.0, 1.0), exponent=50.0)
    method = VertexMethod(mesh, sh.cosine_lobe(mesh.normals, 5), SIZE, material=mirror)
    away = np.array([-lamp[2], 0.0, lamp[0]]) / np.hypot(lamp[0], lamp[2])
    for side in (away, -away):
        eye = 3.0 * (0.5 * lamp + np.sqrt(0.75) * side)
        camera = Camera((eye[0], eye[1], eye[2]), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
        drawn = method.draw(camera, light.project(image, 5))
        seen = method.raster.gbuffer(camera)
        brightest = np.argmax(drawn.reshape(-1, 3)[seen.pixel, 0])
        towards = (eye - seen.positions[brightest]) / np.linalg.norm(eye - seen.positions[brightest])
        half = (towards + lamp) / np.linalg.norm(towards + lamp)
        assert np.degrees(np.arccos(half @ seen.normals[brightest])) < 4
