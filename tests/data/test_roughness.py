"""Roughness out of files, its way through what is done to meshes, and its part in the content key."""

import json
import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from prtnet import PrtnetError
from prtnet.data import atlas, roughness, scene, vertex
from prtnet.data.part import Part
from tests.data.test_meshfile import gltf

PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "property float roughness\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0 0.25\n1 0 0 0.5\n0 1 0 {last}\n3 0 1 2\n"
)


def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(2)


def by_height(positions: np.ndarray) -> np.ndarray:
    return 0.5 + 0.3 * positions[:, 1]


def expect_by_height(found: scene.Scene) -> None:
    assert found.roughness is not None
    np.testing.assert_allclose(found.roughness, by_height(found.vertices), atol=1e-6)


def test_vertices_of_text_ply(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text(PLY.format(last=7))
    found = scene.load(path)
    assert found.roughness is not None
    # what is above 1 is 1
    np.testing.assert_allclose(found.roughness[found.faces[0]], [0.25, 0.5, 1.0])
    assert found.materials[0].roughness is None
    assert roughness.known(found)


@pytest.mark.parametrize(("name", "attribute"), [("ball.ply", "roughness"), ("ball.glb", "_ROUGHNESS")])
def test_vertices_stay_with_their_places(tmp_path: Path, name: str, attribute: str) -> None:
    """Loading, two sides, a cut and an atlas reorder and add vertices: each keeps the roughness of its own place."""
    mesh = ball()
    mesh.vertex_attributes[attribute] = by_height(mesh.vertices).astype(np.float32)
    mesh.export(tmp_path / name)
    found = scene.load(tmp_path / name, two_sided="all")
    expect_by_height(found)
    expect_by_height(found.split_sides())
    expect_by_height(atlas.make(found, size=64).scene)
    cut = vertex.mesh(found, [found.materials[0].name], 2)
    assert len(cut.vertices) > len(found.vertices)
    expect_by_height(cut)


def rough_gltf(folder: Path, words: dict, image: np.ndarray | None = None, **changes: object) -> Path:
    if image is not None:
        Image.fromarray(image).save(folder / "rough.png")
    colour = {"baseColorFactor": [0.123, 0.5, 0.25, 1]}
    # trimesh reads textures only where there are texture coordinates
    attributes = {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 3}
    path = gltf(
        folder,
        images=[{"uri": "rough.png"}],
        textures=[{"source": 0}],
        materials=[{"name": "paint", "pbrMetallicRoughness": colour | words}],
        meshes=[{"primitives": [{"attributes": attributes, "indices": 2, "material": 0}]}],
    )
    header = json.loads(path.read_text())
    header["accessors"].append({"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC2"})
    path.write_text(json.dumps(header | changes))
    return path


def test_factor_and_green_channel_of_gltf(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (4, 6, 3), np.uint8)
    words = {"roughnessFactor": 0.4, "metallicRoughnessTexture": {"index": 0}}
    (material,) = scene.load(rough_gltf(tmp_path, words, image)).materials
    assert material.roughness == pytest.approx(0.4)
    assert material.roughness_map is not None
    np.testing.assert_allclose(material.roughness_map, image[..., 1] / 255, atol=1e-6)


def test_a_texture_alone_has_the_factor_1(tmp_path: Path) -> None:
    image = np.full((2, 2, 3), 128, np.uint8)
    (material,) = scene.load(rough_gltf(tmp_path, {"metallicRoughnessTexture": {"index": 0}}, image)).materials
    assert material.roughness == 1.0


def test_a_missing_texture_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        path = rough_gltf(tmp_path, {"roughnessFactor": 0.3, "metallicRoughnessTexture": {"index": 0}})
        (material,) = scene.load(path).materials
    assert (material.roughness, material.roughness_map) == (pytest.approx(0.3), None)
    assert "texture rough.png is missing: the roughness factor alone is used" in caplog.text


def test_a_file_without_a_word_of_it_says_nothing(tmp_path: Path) -> None:
    found = scene.load(gltf(tmp_path))
    assert not roughness.known(found)
    assert (roughness.at_vertices(found) == roughness.UNKNOWN).all()


@pytest.mark.parametrize("bad", ["nan", "inf"])
def test_roughness_that_is_no_number_is_refused(tmp_path: Path, bad: str) -> None:
    path = tmp_path / "a.ply"
    path.write_text(PLY.format(last=bad))
    with pytest.raises(PrtnetError, match=r"a\.ply: roughness of vertices: found 3 values, 1 of them not finite"):
        scene.load(path)


def triangle(**more) -> scene.Scene:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    uv = np.array([[0.125, 0.75], [0.5, 0.5], [1.25, -0.25]])
    return scene.assemble("one", [Part("p", points, np.array([[0, 1, 2]]), uv=uv, two_sided=False, **more)])


def test_factor_vertices_and_map_multiply() -> None:
    own, image = np.array([0.5, 0.8, 1.0]), np.array([[0.2, 0.4], [0.6, 1.0]])
    made = triangle(roughness=own, roughness_factor=0.5, roughness_map=image)
    np.testing.assert_allclose(roughness.at_vertices(made), 0.5 * own, atol=1e-6)
    # a quarter of a texel beyond the first column's centre, towards the repeated last one; the middle; (0.25, 0.75)
    looked_up = [0.75 * 0.2 + 0.25 * 0.4, image.mean(), 0.2]
    assert made.uv is not None
    np.testing.assert_allclose(roughness.sampled(made), 0.5 * own * looked_up, atol=1e-6)
    alone = triangle(roughness_map=image)
    np.testing.assert_allclose(roughness.at_vertices(alone), 1.0)


def test_the_content_key_has_it_where_there_is_some() -> None:
    plain, image = triangle(), np.ones((2, 2))
    some = [
        plain,
        triangle(roughness_factor=0.5),
        triangle(roughness_factor=0.6),
        triangle(roughness_map=image),
        triangle(roughness=np.array([0.1, 0.2, 0.3])),
        triangle(roughness=np.array([0.1, 0.2, 0.4])),
    ]
    assert len({made.digest() for made in some}) == len(some)
    bare = replace(some[-1], roughness=None)
    assert bare.digest() == plain.digest()
