"""transfer_vertices.glb: a round trip, another reader's view of it, its errors, and the reader of its page."""

import json
import re
import struct
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from prtnet import PrtnetError, sh
from prtnet.data import builtin, vertex
from prtnet.data.materials import to_linear
from prtnet.data.scene import Scene, frame_of
from prtnet.export import glb, gltf, vertices

PAGE = Path(__file__).resolve().parents[2] / "docs" / "gltf-transfer.md"


@pytest.fixture(scope="module")
def far() -> Scene:
    """A scene in the file's coordinates, far from the origin, its floor with a texture."""
    made = builtin.make("cornell", tessellation=0.25)
    moved = made.vertices * 10 + [5e5, 0, -3e5]
    texture = np.random.default_rng(0).random((8, 16, 3)).astype(np.float32)
    materials = (replace(made.materials[0], texture=texture), *made.materials[1:])
    uv = np.random.default_rng(1).random((len(moved), 2)).astype(np.float32)
    sides = np.arange(len(made.faces)) % 5 == 0
    return replace(made, vertices=moved, frame=frame_of(moved), materials=materials, uv=uv, two_sided=sides)


def written(scene: Scene, path: Path, bands: int = 3) -> tuple[vertices.VertexFile, Scene]:
    mesh = vertex.mesh(scene.centred())
    file = vertices.of_mesh(mesh, scene.frame, sh.cosine_lobe(mesh.normals, bands), "unshadowed")
    gltf.write(path, file, mesh)
    return file, mesh


@pytest.mark.parametrize("bands", [1, 3, 4])
def test_round_trip(far, tmp_path, bands):
    wanted, _ = written(far, tmp_path / "transfer_vertices.glb", bands)
    found = gltf.read(tmp_path / "transfer_vertices.glb")
    order = np.argsort(wanted.part, kind="stable")
    wanted = replace(wanted, faces=wanted.faces[order], part=wanted.part[order])
    for field in fields(vertices.VertexFile):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(wanted, field.name))
        assert type(getattr(found, field.name)) is type(getattr(wanted, field.name))
    assert len(set(np.diff(order))) > 1


@pytest.mark.parametrize("bands", [1, 3, 4, 5])
@pytest.mark.parametrize("letters", [("",), ("", "R_", "G_", "B_")])
def test_transfer_as_attributes_and_back(bands, letters):
    count = bands * bands
    transfer = np.random.default_rng(0).normal(size=(5, len(letters) * count)).astype(np.float32)
    found = gltf.attributes(transfer, len(letters))
    assert set(found) == {f"_PRT_{letter}{i}" for letter in letters for i in range(-(-count // 4))}
    assert {values.shape for values in found.values()} == {(5, 4)}
    np.testing.assert_array_equal(gltf.transfer_of(found, bands, len(letters)), transfer)
    np.testing.assert_array_equal(found[f"_PRT_{letters[-1]}0"][:, 0], transfer[:, -count])
    padding = found[f"_PRT_{letters[-1]}{count // 4}"][:, count % 4 :] if count % 4 else np.zeros(3)
    assert not padding.any()


def test_another_reader_finds_the_same(far, tmp_path):
    """trimesh: positions in the file's coordinates, faces by part, attributes, base colours and textures."""
    wanted, mesh = written(far, tmp_path / "transfer_vertices.glb")
    loaded = trimesh.load(tmp_path / "transfer_vertices.glb", process=False, maintain_order=True)
    assert isinstance(loaded, trimesh.Scene)
    by_name = {part.visual.material.name: part for part in loaded.geometry.values()}
    assert set(by_name) == set(wanted.parts)
    for index, material in enumerate(mesh.materials):
        part = by_name[material.name]
        faces = wanted.faces[wanted.part == index]
        place = loaded.graph.get(loaded.graph.nodes_geometry[0])[0][:3, 3]
        corners = part.vertices[part.faces].astype(np.float64) + place
        np.testing.assert_allclose(corners, wanted.positions[faces] + wanted.centre, rtol=0, atol=1e-6)
        for name, values in gltf.attributes(wanted.transfer).items():
            np.testing.assert_array_equal(part.vertex_attributes[name][part.faces], values[faces])
        factor = np.asarray(part.visual.material.baseColorFactor)[:3] / 255
        np.testing.assert_allclose(factor, material.albedo, atol=1 / 255)
    floor, texture = by_name[mesh.materials[0].name], mesh.materials[0].texture
    image = np.asarray(floor.visual.material.baseColorTexture.convert("RGB")) / 255
    np.testing.assert_allclose(to_linear(image), texture, atol=6e-3)
    faces = wanted.faces[wanted.part == 0]
    np.testing.assert_allclose(floor.visual.uv[floor.faces], far_uv(mesh)[faces], atol=1e-6)


def far_uv(mesh: Scene) -> np.ndarray:
    assert mesh.uv is not None
    return mesh.uv


def test_the_container_is_whole_and_aligned(far, tmp_path):
    """Lengths and alignment as the standard has them (glTF 2.0, 3.6.2.4 and 4.4)."""
    path = tmp_path / "transfer_vertices.glb"
    wanted, mesh = written(far, path)
    content = path.read_bytes()
    magic, version, total, length, kind = struct.unpack_from("<4sIII4s", content)
    assert (magic, version, total, kind) == (b"glTF", 2, len(content), b"JSON")
    binary_length, kind = struct.unpack_from("<I4s", content, 20 + length)
    assert kind == b"BIN\0"
    assert length % 4 == binary_length % 4 == 0
    assert 28 + length + binary_length == total
    header = json.loads(content[20 : 20 + length])
    assert header["buffers"] == [{"byteLength": binary_length}]
    assert all(view["byteOffset"] % 4 == 0 for view in header["bufferViews"])
    first = header["accessors"][header["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]
    assert first["min"] == wanted.positions.min(axis=0).tolist()
    assert first["max"] == wanted.positions.max(axis=0).tolist()
    factors = [material["pbrMetallicRoughness"]["baseColorFactor"] for material in header["materials"]]
    np.testing.assert_array_equal(np.float32(factors)[:, :3], [material.albedo for material in mesh.materials])


def test_views_of_any_length_start_at_multiples_of_four():
    binary = glb.Binary()
    for length in (1, 2, 3, 4, 5):
        binary.view(bytes([length]) * length)
    assert [view["byteOffset"] for view in binary.views] == [0, 4, 8, 12, 16]
    assert [view["byteLength"] for view in binary.views] == [1, 2, 3, 4, 5]
    assert binary.data[8:12] == b"\3\3\3\0"
    assert len(binary.data) == 24


def test_the_pages_reader(far, tmp_path, monkeypatch):
    written(far, tmp_path / "transfer_vertices.glb")
    code = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    assert len([line for line in code.group(1).splitlines() if line.strip()]) <= 20
    monkeypatch.chdir(tmp_path)
    exec(compile(code.group(1), str(PAGE), "exec"), {})
    mesh = vertex.mesh(far)
    loaded = trimesh.load(tmp_path / "vertices.obj", process=False, maintain_order=True)
    np.testing.assert_array_equal(loaded.faces, mesh.faces[np.argsort(mesh.part, kind="stable")])
    np.testing.assert_allclose(loaded.vertices, mesh.vertices, rtol=0, atol=2e-6)
    # nothing occluded under a white sky: white
    assert np.abs(loaded.visual.vertex_colors[:, :3].astype(int) - 255).max() <= 1


def test_the_page_names_what_is_in_the_file(far, tmp_path):
    text, path = PAGE.read_text(encoding="utf-8"), tmp_path / "transfer_vertices.glb"
    written(far, path)
    header, _ = glb.opened(path)
    mesh = header["meshes"][0]
    for name in (*mesh["extras"]["prtnet"], "POSITION", "NORMAL", "TEXCOORD_0"):
        assert f"| `{name}` |" in text, name
    assert "`_PRT_0`, `_PRT_1`, ..." in text
    assert "`_PRT_R_0`, ..., `_PRT_G_0`, ..., `_PRT_B_0`, ..." in text


def test_errors(far, tmp_path):
    path = tmp_path / "bad.glb"
    with pytest.raises(PrtnetError, match=r"bad.glb: no such file"):
        gltf.read(path)
    for content in (b"", b"not at all, and long enough for a header"):
        path.write_bytes(content)
        with pytest.raises(PrtnetError, match=r"bad.glb: not a whole GLB file"):
            gltf.read(path)
    written(far, path)
    whole = path.read_bytes()
    path.write_bytes(whole[:-8])
    with pytest.raises(PrtnetError, match=r"bad.glb: not a whole GLB file"):
        gltf.read(path)
    path.write_bytes(whole.replace(b'"format":1', b'"format":7'))
    with pytest.raises(PrtnetError, match=r"bad.glb: found prtnet of format 7, expected 1"):
        gltf.read(path)
    path.write_bytes(whole.replace(b'"_PRT_1"', b'"_BRT_1"'))
    with pytest.raises(PrtnetError, match=r"bad.glb: found no '_PRT_1', expected it in a vertex transfer"):
        gltf.read(path)
