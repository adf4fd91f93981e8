"""transfer_vertices.safetensors: a round trip, its errors, and the reader of its page."""

import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from safetensors.numpy import save_file

from prtnet import PrtnetError, sh, store
from prtnet.data import builtin, vertex
from prtnet.data.scene import Scene, frame_of
from prtnet.export import vertices

PAGE = Path(__file__).resolve().parents[2] / "docs" / "vertex-transfer.md"


@pytest.fixture
def far() -> Scene:
    """A scene in the file's coordinates, far from the origin."""
    made = builtin.make("plants", tessellation=0.2)
    moved = made.vertices * 10 + [5e5, 0, -3e5]
    return replace(made, vertices=moved, frame=frame_of(moved))


def file_of(scene: Scene) -> vertices.VertexFile:
    mesh = vertex.mesh(scene.centred(), ["ground"], 2)
    return vertices.of_mesh(mesh, scene.frame, sh.cosine_lobe(mesh.normals, 4), "unshadowed")


def test_round_trip(far, tmp_path):
    wanted, path = file_of(far), tmp_path / "transfer_vertices.safetensors"
    vertices.write(path, wanted)
    found = vertices.read(path)
    for field in fields(vertices.VertexFile):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(wanted, field.name))
        assert type(getattr(found, field.name)) is type(getattr(wanted, field.name))
    assert found.bands == 4


def test_positions_lead_back_to_the_file(far, tmp_path):
    """A micrometre in a scene of 40 m that stands 600 km from the origin, where float32 has steps of 3 cm."""
    found, mesh = file_of(far), vertex.mesh(far, ["ground"], 2)
    np.testing.assert_allclose(found.positions.astype(np.float64) + found.centre, mesh.vertices, atol=2e-6)
    np.testing.assert_array_equal(found.faces, mesh.faces)
    assert [found.parts[part] for part in found.part[:1]] == ["ground"]


def test_the_pages_reader(far, tmp_path, monkeypatch):
    vertices.write(tmp_path / "transfer_vertices.safetensors", file_of(far))
    code = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    assert len([line for line in code.group(1).splitlines() if line.strip()]) <= 20
    monkeypatch.chdir(tmp_path)
    exec(compile(code.group(1), str(PAGE), "exec"), {})
    mesh = vertex.mesh(far, ["ground"], 2)
    loaded = trimesh.load(tmp_path / "vertices.obj", process=False, maintain_order=True)
    np.testing.assert_array_equal(loaded.faces, mesh.faces)
    np.testing.assert_allclose(loaded.vertices, mesh.vertices, atol=2e-6)
    # nothing occluded under a white sky: white
    assert np.abs(loaded.visual.vertex_colors[:, :3].astype(int) - 255).max() <= 1


def test_the_page_names_what_is_in_the_file():
    text = PAGE.read_text(encoding="utf-8")
    for name in (*vertices.TENSORS, "format", "bands", "centre", "parts", "kind", "name"):
        assert f"| `{name}` |" in text, name
    assert vertices.METADATA_KEY in text


def test_errors(far, tmp_path):
    path = tmp_path / "bad.safetensors"
    with pytest.raises(PrtnetError, match=r"bad.safetensors: no such file"):
        vertices.read(path)
    path.write_bytes(b"not at all")
    with pytest.raises(PrtnetError, match=r"bad.safetensors: not a whole safetensors file"):
        vertices.read(path)
    save_file({"transfer": np.zeros((3, 4), np.float32)}, path)
    with pytest.raises(PrtnetError, match=r"bad.safetensors: found prtnet_vertices of format None, expected 1"):
        vertices.read(path)
    about = '{"format": 1, "bands": 2, "centre": [0, 0, 0], "parts": [], "kind": "shadowed"}'
    store.save_arrays(path, {"transfer": np.zeros((3, 4), np.float32)}, {vertices.METADATA_KEY: about})
    with pytest.raises(PrtnetError, match=r"found no positions, normals, faces, part, name"):
        vertices.read(path)
