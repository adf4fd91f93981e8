"""Scenes: frames, sides, digests, and their place in space."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from prtnet import PrtnetError
from prtnet.data import builtin, scene, shapes
from prtnet.data.part import Part


def two_parts() -> scene.Scene:
    box = shapes.box([0, 0, 0], [1, 2, 4])
    leaf = shapes.quad([0, 5, 0], [1, 0, 0], [0, 0, -1])
    return scene.assemble(
        "two", [Part("box", box.vertices, box.faces), Part("leaf", leaf.vertices, leaf.faces, two_sided=True)]
    )


@given(
    arrays(np.float64, (5, 3), elements=st.floats(-1, 1)),
    st.sampled_from([1e-3, 1.0, 1e6]),
    st.sampled_from([0.0, 1e7]),
)
def test_frame_round_trip(points: np.ndarray, scale: float, shift: float) -> None:
    points = np.concatenate([points, [[-1, -1, -1], [1, 1, 1]]]) * scale + shift
    frame = scene.frame_of(points)
    unit = frame.to_unit(points)
    assert np.abs(unit).max() <= 1 + 1e-6
    np.testing.assert_allclose(frame.from_unit(unit), points, rtol=1e-12, atol=1e-9 * scale)


def test_centred_fills_the_cube() -> None:
    unit = two_parts().centred()
    assert unit.frame is scene.IDENTITY
    assert unit.centred() is unit
    assert np.ptp(unit.vertices, axis=0).max() == pytest.approx(2)
    np.testing.assert_allclose(unit.vertices.max(axis=0) + unit.vertices.min(axis=0), 0, atol=1e-12)


def test_split_sides() -> None:
    whole = two_parts()
    split = whole.split_sides()
    assert len(split.faces) == len(whole.faces) + 2
    assert not split.two_sided.any()
    np.testing.assert_array_equal(split.faces[: len(whole.faces)], whole.faces)
    assert split.face_origin is not None
    np.testing.assert_array_equal(split.face_origin, [*range(14), 12, 13])
    np.testing.assert_allclose(split.face_normals[14:], -whole.face_normals[12:])
    np.testing.assert_allclose(
        split.normals[split.faces[14:]].reshape(-1, 3), np.tile([[0, -1.0, 0]], (6, 1)), atol=1e-6
    )
    assert set(split.faces[14:].ravel()).isdisjoint(split.faces[:14].ravel())
    np.testing.assert_array_equal(split.part[14:], whole.part[12:])
    assert split.split_sides() is split


def test_areas_and_normals() -> None:
    whole = two_parts()
    assert whole.face_areas.sum() == pytest.approx(2 * (2 + 4 + 8) + 1)
    np.testing.assert_allclose(np.linalg.norm(whole.face_normals, axis=1), 1)


def test_digest_sees_everything_but_the_name() -> None:
    whole = two_parts()
    digest = whole.digest()
    assert two_parts().digest() == digest
    assert replace(whole, name="other").digest() == digest
    material = replace(whole.materials[0], albedo=np.array([0.1, 0.2, 0.3], np.float32))
    textured = replace(whole.materials[0], texture=np.zeros((2, 2, 3), np.float32))
    changed = [
        replace(whole, vertices=whole.vertices + 1e-9),
        replace(whole, faces=whole.faces[:, ::-1].copy()),
        replace(whole, two_sided=~whole.two_sided),
        replace(whole, materials=(material, whole.materials[1])),
        replace(whole, materials=(textured, whole.materials[1])),
        replace(whole, camera="inside"),
        whole.centred(),
    ]
    assert len({digest, *(other.digest() for other in changed)}) == len(changed) + 1


def test_missing_uv_of_one_part_is_zero() -> None:
    leaf = shapes.quad([0, 5, 0], [1, 0, 0], [0, 0, -1])
    parts = [Part("a", leaf.vertices, leaf.faces, uv=np.ones((4, 2))), Part("b", leaf.vertices + 1, leaf.faces)]
    whole = scene.assemble("uv", parts)
    assert whole.uv is not None
    np.testing.assert_array_equal(whole.uv, np.repeat([[1.0, 1], [0, 0]], 4, axis=0))
    assert two_parts().uv is None


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
@pytest.mark.parametrize("shift", [0.0, 12345.0, -3e6])
def test_the_same_anywhere_at_any_size(tmp_path: Path, scale: float, shift: float) -> None:
    """Extents of 1e-3 to 1e6 and centres far away load as the same unit scene."""
    box = shapes.ellipsoid([0.5, 0.3, 0.4], 12)
    moved = box.vertices * scale + shift * scale
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in moved.tolist()] + [f"f {a} {b} {c}" for a, b, c in box.faces + 1]
    path = tmp_path / "ball.obj"
    path.write_text("\n".join(rows))
    found = scene.load(path).centred()
    plain = scene.assemble("ball", [Part("ball", box.vertices, box.faces)]).centred()
    assert len(found.faces) == len(plain.faces)
    assert not found.two_sided.any()
    corners = (np.sort(s.vertices[s.faces].reshape(-1, 9), axis=0) for s in (found, plain))
    np.testing.assert_allclose(*corners, atol=1e-8)
    np.testing.assert_allclose(np.sort(found.normals, axis=0), np.sort(plain.normals, axis=0), atol=1e-5)


def test_a_part_of_most_of_the_area_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "island.obj"
    path.write_text(
        "mtllib island.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv -90 -90 0\nv 90 -90 0\nv 0 90 0\n"
        "usemtl palm\nf 1 2 3\nusemtl sea\nf 4 5 6\n"
    )
    (tmp_path / "island.mtl").write_text("newmtl palm\nKd 0.5 0.5 0.5\nnewmtl sea\nKd 0 0 1\n")
    with caplog.at_level(logging.WARNING):
        assert len(scene.load(path).materials) == 2
    assert "part sea holds" in caplog.text
    alone = scene.load(path, without=["sea"])
    assert [material.name for material in alone.materials] == ["palm"]
    with pytest.raises(PrtnetError, match=r"island\.obj.*see.*palm"):
        scene.load(path, without=["see"])
    with pytest.raises(PrtnetError, match=r"island\.obj.*at least one"):
        scene.load(path, without=["sea", "palm"])


def test_assemble_refuses_nothing() -> None:
    with pytest.raises(PrtnetError, match="no triangles"):
        scene.assemble("void", [])
    box = shapes.box([0, 0, 0], [1, 1, 1])
    with pytest.raises(PrtnetError, match="camera"):
        scene.assemble("box", [Part("box", box.vertices, box.faces)], camera="above")


def test_float32_parts_work() -> None:
    box = shapes.box([0, 0, 0], [1, 1, 1])
    single = scene.assemble("box", [Part("box", box.vertices.astype(np.float32), box.faces)])
    assert single.vertices.dtype == np.float64
    assert builtin.make("cornell").vertices.dtype == np.float64
