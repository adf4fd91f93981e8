"""Mesh files: formats, transforms, materials, and a clear word for everything that is wrong with them."""

import json
import logging
import re
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from prtnet import PrtnetError
from prtnet.data import scene, shapes
from prtnet.data.materials import to_linear
from tests.assets import asset

PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n"
)
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def gltf(folder: Path, **changes: object) -> Path:
    """One triangle in the z = 0 plane, in two nodes, with everything in one buffer."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    normals = np.tile(np.array([0, 0, 1], np.float32), (3, 1))
    data = points.tobytes() + normals.tobytes() + np.array([0, 1, 2, 0], np.uint16).tobytes()
    (folder / "data.bin").write_bytes(data)
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "translation": [10, 0, 0]}, {"mesh": 0, "scale": [-2, 2, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"name": "paint", "pbrMetallicRoughness": {"baseColorFactor": [0.123, 0.5, 0.25, 1]}}],
        "buffers": [{"uri": "data.bin", "byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 36},
            {"buffer": 0, "byteOffset": 72, "byteLength": 6},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
    }
    return write(folder, "scene.gltf", json.dumps(header | changes))


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "glb"])
def test_every_format_gives_the_same_ball(tmp_path: Path, suffix: str) -> None:
    ball = shapes.ellipsoid([1, 1.2, 1.4], 36)
    path = tmp_path / f"ball.{suffix}"
    trimesh.Trimesh(ball.vertices, ball.faces, process=False).export(path)
    found = scene.load(path)
    assert len(found.faces) == len(ball.faces)
    assert found.face_areas.sum() == pytest.approx(scene.assemble("b", [_part(ball)]).face_areas.sum(), rel=1e-5)
    assert not found.two_sided.any()
    outward = np.einsum("vi,vi->v", found.normals, found.vertices)
    assert (outward > 0).all()
    assert len(found.vertices) == len(ball.vertices)


def _part(surface: shapes.Surface) -> scene.Part:
    return scene.Part("p", surface.vertices, surface.faces)


def test_gltf_nodes_instances_and_mirrors(tmp_path: Path) -> None:
    found = scene.load(gltf(tmp_path))
    assert len(found.faces) == 2
    assert [material.name for material in found.materials] == ["paint"]
    np.testing.assert_allclose(found.materials[0].albedo, [0.123, 0.5, 0.25], atol=1e-6)
    order = np.argsort(found.face_areas)
    near, far = found.vertices[found.faces[order[0]]], found.vertices[found.faces[order[1]]]
    np.testing.assert_allclose(near.min(axis=0), [10, 0, 0])
    np.testing.assert_allclose(far.min(axis=0), [-2, 0, 0])
    assert found.face_areas.sum() == pytest.approx(2.5)
    # a mirror turns the winding, so that both still face +z
    np.testing.assert_allclose(found.face_normals, [[0, 0, 1]] * 2, atol=1e-12)
    np.testing.assert_allclose(found.normals, [[0, 0, 1]] * 6, atol=1e-6)
    assert not found.two_sided.any()


def test_gltf_says_its_sides(tmp_path: Path) -> None:
    path = gltf(tmp_path, materials=[{"name": "leaf", "doubleSided": True}])
    assert scene.load(path).two_sided.all()
    assert not scene.load(path, two_sided="none").two_sided.any()
    assert scene.load(gltf(tmp_path), two_sided="all").two_sided.all()


def test_loading_twice_gives_the_same_digest(tmp_path: Path) -> None:
    path = gltf(tmp_path)
    assert scene.load(path).digest() == scene.load(path).digest()


def test_gltf_missing_texture_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rough = {"baseColorFactor": [0.5, 0.5, 0.5, 1], "baseColorTexture": {"index": 0}}
    extra = {"textures": [{"source": 0}], "images": [{"uri": "bark.png"}]}
    path = gltf(tmp_path, materials=[{"name": "bark", "pbrMetallicRoughness": rough}], **extra)
    with caplog.at_level(logging.WARNING):
        found = scene.load(path)
    assert "bark.png is missing" in caplog.text
    assert found.materials[0].texture is None
    Image.fromarray(np.full((2, 3, 3), 128, np.uint8)).save(tmp_path / "bark.png")
    texture = scene.load(path).materials[0].texture
    assert texture is not None
    assert texture.shape == (2, 3, 3)
    np.testing.assert_allclose(texture, float(to_linear(128 / 255)), atol=1e-6)


def test_undecoded_compression_is_told(tmp_path: Path) -> None:
    accessors = [{"componentType": 5126, "count": 3, "type": "VEC3"}] * 2
    accessors += [{"componentType": 5123, "count": 3, "type": "SCALAR"}]
    path = gltf(tmp_path, accessors=accessors, extensionsUsed=["KHR_draco_mesh_compression"])
    with pytest.raises(PrtnetError, match=r"scene\.gltf.*KHR_draco_mesh_compression.*without compression"):
        scene.load(path)


def test_obj_colours_are_srgb_and_textures_found(tmp_path: Path) -> None:
    Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]]], np.uint8)).save(tmp_path / "a b.png")
    write(tmp_path, "m.mtl", "newmtl plain\nKd 0.5 0.25 1\nnewmtl image\nKd 0 0 0\nmap_Kd a b.png\n")
    text = f"mtllib m.mtl\n{TRIANGLE}vt 0 0\nvt 1 0\nvt 0 1\nv 5 5 5\n"
    text += "usemtl plain\nf 1/1 2/2 3/3\nusemtl image\nf 1/1 2/2 4/3\n"
    found = scene.load(write(tmp_path, "m.obj", text))
    materials = {material.name: material for material in found.materials}
    np.testing.assert_allclose(materials["plain"].albedo, to_linear([0.5, 0.25, 1]), atol=1e-6)
    np.testing.assert_allclose(materials["image"].albedo, 1)
    assert materials["image"].texture is not None
    np.testing.assert_allclose(materials["image"].texture, [[[1, 0, 0], [0, 1, 0]]])
    assert found.uv is not None
    assert found.uv.max() == 1


def test_obj_missing_library_and_texture_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = write(tmp_path, "m.obj", f"mtllib gone.mtl\n{TRIANGLE}f 1 2 3\n")
    with caplog.at_level(logging.WARNING):
        found = scene.load(path)
    assert "gone.mtl is missing" in caplog.text
    np.testing.assert_allclose(found.materials[0].albedo, 0.8, atol=1e-6)
    write(tmp_path, "gone.mtl", "newmtl a\nKd 1 1 1\nmap_Kd gone.png\n")
    with caplog.at_level(logging.WARNING):
        scene.load(path)
    assert "gone.png is missing" in caplog.text


def test_obj_relative_indices_between_the_vertices(tmp_path: Path) -> None:
    text = f"{TRIANGLE}f -3 -2 -1\nv 0 0 5\nv 1 0 5\nv 0 1 5\nf -3 -2 -1\n"
    plain = f"{TRIANGLE}v 0 0 5\nv 1 0 5\nv 0 1 5\nf 1 2 3\nf 4 5 6\n"
    relative, absolute = (scene.load(write(tmp_path, f"{i}.obj", t)) for i, t in enumerate((text, plain)))
    np.testing.assert_array_equal(relative.vertices[relative.faces], absolute.vertices[absolute.faces])


def test_folder_is_sorted_parts(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    write(tmp_path, "b.obj", TRIANGLE + "f 1 2 3\n")
    write(tmp_path / "sub", "a.obj", TRIANGLE.replace("0\n", "3\n") + "f 1 2 3\n")
    write(tmp_path, "notes.txt", "not a mesh")
    assert [material.name for material in scene.load(tmp_path).materials] == ["b", "a"]


def test_dropped_triangles_are_counted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    text = f"{TRIANGLE}v 2 0 0\nv 0 0 9\nf 1 2 3\nf 1 2 4\nf 2 2 3\nf 2 3 1\nf 1 2 5\n"
    with caplog.at_level(logging.WARNING):
        found = scene.load(write(tmp_path, "m.obj", text))
    assert "2 degenerate triangles of 5 dropped" in caplog.text
    assert "1 duplicate triangles of 3 dropped" in caplog.text
    assert len(found.faces) == 2


def test_back_to_back_triangles_become_one_of_two_sides(tmp_path: Path) -> None:
    text = f"{TRIANGLE}v 0 0 9\nf 1 2 3\nf 3 2 1\nf 1 2 4\n"
    parts = scene.read(write(tmp_path, "m.obj", text))
    (part,) = scene.repair([scene.replace(parts[0], two_sided=False)], two_sided="auto", source="m")
    assert sorted(np.asarray(part.two_sided).tolist()) == [False, True]


def test_open_parts_are_two_sided_and_closed_ones_not(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    box.export(tmp_path / "closed.obj")
    box.update_faces(np.arange(12) > 0)
    box.export(tmp_path / "open.obj")
    assert not scene.load(tmp_path / "closed.obj").two_sided.any()
    assert scene.load(tmp_path / "open.obj").two_sided.all()


def test_unusable_normals_are_computed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    text = f"{TRIANGLE}vn 0 0 0\nvn 0 0 2\nf 1//1 2//2 3//2\n"
    with caplog.at_level(logging.WARNING):
        found = scene.load(write(tmp_path, "m.obj", text))
    assert "1 of 3 normals" in caplog.text
    np.testing.assert_allclose(found.normals, [[0, 0, 1]] * 3)


def test_winding_follows_the_normals(tmp_path: Path) -> None:
    found = scene.load(write(tmp_path, "m.obj", f"{TRIANGLE}vn 0 0 -1\nf 1//1 2//1 3//1\n"))
    np.testing.assert_allclose(found.face_normals, [[0, 0, -1]])


BROKEN = {
    "empty.obj": ("", "no triangles|cannot be read"),
    "points.obj": (TRIANGLE, "no triangles"),
    "nan.obj": ("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "1 of 3 vertices are not finite"),
    "infinite.obj": ("v 0 0 0\nv inf 0 0\nv 0 1 0\nf 1 2 3\n", "1 of 3 vertices are not finite"),
    "range.obj": (TRIANGLE + "f 1 2 7\n", "out of bounds"),
    "zero.obj": ("v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "all vertices are zero"),
    "point.obj": ("v 1 2 3\nv 1 2 3\nv 1 2 3\nf 1 2 3\n", "in one point"),
    "line.obj": ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "all 1 triangles are degenerate"),
    "range.off": ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n", "face index outside"),
    "range.ply": (PLY + "3 0 1 9\n", "vertex 9, expected 0 to 2"),
    "garbage.ply": ("ply\nnonsense\n", "cannot be read as PLY"),
    "garbage.glb": ("glTFxx", "no glTF header"),
    "garbage.gltf": ("{", "no glTF header"),
    "list.gltf": ("[]", "found list, expected an object"),
    "mesh.fbx": ("", r"end in \.fbx are not read"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_errors_name_the_file_and_the_fault(tmp_path: Path, name: str) -> None:
    text, message = BROKEN[name]
    with pytest.raises(PrtnetError, match=message) as caught:
        scene.load(write(tmp_path, name, text))
    assert re.search(name, str(caught.value))


def test_missing_file_and_empty_folder(tmp_path: Path) -> None:
    with pytest.raises(PrtnetError, match=r"nowhere\.obj: no such file"):
        scene.load(tmp_path / "nowhere.obj")
    with pytest.raises(PrtnetError, match="no mesh in this folder"):
        scene.load(tmp_path)
    path = write(tmp_path, "m.obj", TRIANGLE + "f 1 2 3\n")
    with pytest.raises(PrtnetError, match=r"'both'.*auto"):
        scene.load(path, two_sided="both")


def test_gltf_without_its_buffer(tmp_path: Path) -> None:
    path = gltf(tmp_path)
    (tmp_path / "data.bin").unlink()
    with pytest.raises(PrtnetError, match=r"scene\.gltf: cannot be read as GLTF.*data\.bin"):
        scene.load(path)


def test_truncated_glb(tmp_path: Path) -> None:
    path = tmp_path / "m.glb"
    trimesh.creation.box().export(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(PrtnetError, match=r"m\.glb"):
        scene.load(path)
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12))
    with pytest.raises(PrtnetError, match=r"m\.glb.*header"):
        scene.load(path)


ASSETS = {
    "meshes/palmtree/PalmTree.gltf": (10124, 4),
    "meshes/spot/spot_triangulated.obj": (5856, 1),
    "meshes/buildings/quaternius_mill.glb": (8088, 10),
    "meshes/teapot.obj": (6320, 1),
    "meshes/suzanne.obj": (967, 1),
    "meshes/cycloidal.ply": (43368, 1),
    "meshes/barramundi_fish/BarramundiFish.gltf": (3864, 1),
    "meshes/lantern/Lantern.gltf": (5392, 1),
    "meshes/cars/kaykit/obj/car_sedan.obj": (646, 1),
    "meshes/cars/kaykit/gltf/building_H.gltf": (1885, 1),
    "meshes/foliage/kenney_grass.glb": (66, 1),
    "meshes/foliage/kenney_tree_default_fall.glb": (114, 2),
    "meshes/modern-hall": (28479, 19),
}


@pytest.mark.parametrize("name", ASSETS)
def test_files_of_others(name: str) -> None:
    found = scene.load(asset(name))
    assert (len(found.faces), len(found.materials)) == ASSETS[name]
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1, atol=1e-5)
    assert (found.face_areas > 0).all()
    facing = np.einsum("fki,fi->fk", found.normals[found.faces], found.face_normals)
    assert not (facing < 0).all(axis=1).any()
