"""Procedural scenes: sound geometry, honest budgets, the same triangles for the same seed."""

import numpy as np
import pytest
import trimesh

from prtnet import PrtnetError
from prtnet.data import builtin
from prtnet.data.normals import weld
from prtnet.data.repair import is_closed, repair
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer

# sheets that are meant to be seen from above only
OPEN = {"floor", "ground", "soil", "tea", "milk", "water", "paving", "paving_dark", "paving_border", "stylobate"}
BUDGET = {
    "colonnade": (60_000, 130_000),
    "cornell": (100, 200),
    "dining_table": (30_000, 45_000),
    "hair": (60_000, 80_000),
    "living_room": (35_000, 55_000),
    "plants": (20_000, 40_000),
    "room": (18_000, 22_000),
    "tea_set": (30_000, 45_000),
}


def pieces(scene: Scene, part: int) -> list[np.ndarray]:
    """Corner positions "f 3 3" of each connected piece of a part."""
    faces = scene.faces[scene.part == part]
    keep, position = weld(scene.vertices)
    welded = position[faces]
    label = trimesh.graph.connected_component_labels(welded[:, [0, 1, 1, 2]].reshape(-1, 2), node_count=len(keep))
    return [scene.vertices[faces[label[welded[:, 0]] == piece]] for piece in np.unique(label[welded[:, 0]])]


@pytest.mark.parametrize("tessellation", [0.25, 1.0])
@pytest.mark.parametrize("name", builtin.NAMES)
def test_closed_parts_are_closed_and_face_outward(name: str, tessellation: float) -> None:
    scene = builtin.make(name, tessellation=tessellation)
    for index, material in enumerate(scene.materials):
        if scene.two_sided[scene.part == index].all() or material.name in OPEN:
            continue
        for corners in pieces(scene, index):
            local = corners - corners.reshape(-1, 3).mean(axis=0)
            volume = np.einsum("fi,fi->", local[:, 0], np.cross(local[:, 1], local[:, 2])) / 6
            assert volume > 0, (material.name, volume)
            assert is_closed(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3)), material.name


@pytest.mark.parametrize("name", builtin.NAMES)
def test_arrays_are_sound(name: str) -> None:
    scene = builtin.make(name)
    low, high = BUDGET[name]
    assert low <= len(scene.faces) <= high
    assert np.isfinite(scene.vertices).all()
    np.testing.assert_allclose(np.linalg.norm(scene.normals, axis=1), 1, atol=1e-5)
    assert (scene.face_areas * scene.frame.scale**2 > 1e-9).all()
    assert scene.faces.max() == len(scene.vertices) - 1
    names = [material.name for material in scene.materials]
    assert len(set(names)) == len(names)
    assert all(0 < albedo < 0.9 for material in scene.materials for albedo in material.albedo)
    assert set(np.unique(scene.part)) == set(range(len(names)))


@pytest.mark.parametrize("name", builtin.NAMES)
def test_normals_follow_the_winding(name: str) -> None:
    scene = builtin.make(name)
    facing = np.einsum("fki,fi->fk", scene.normals[scene.faces], scene.face_normals)
    assert (facing > 0).mean() > 0.9999


@pytest.mark.parametrize("name", builtin.NAMES)
def test_no_triangle_twice(name: str) -> None:
    scene = builtin.make(name, tessellation=0.5)
    _, position = weld(scene.vertices)
    corners = np.sort(position[scene.faces], axis=1)
    assert len(np.unique(corners, axis=0)) == len(corners)


@pytest.mark.parametrize("name", builtin.NAMES)
def test_seed_decides(name: str) -> None:
    first, again, other = (builtin.make(name, tessellation=0.3, seed=seed).digest() for seed in (1, 1, 2))
    assert first == again
    assert first != other


@pytest.mark.parametrize("name", sorted(set(builtin.NAMES) - {"cornell"}))
def test_tessellation_scales_triangles(name: str) -> None:
    coarse, fine = (len(builtin.make(name, tessellation=t).faces) for t in (0.5, 1.5))
    assert fine > 2.5 * coarse


def test_only_sheets_are_two_sided() -> None:
    plants = builtin.make("plants")
    names = np.array([material.name for material in plants.materials])[plants.part]
    assert set(names[plants.two_sided]) == {name for name in set(names) if name.startswith("leaves")}
    assert np.count_nonzero(names == "ground") == 2
    assert not builtin.make("tea_set").two_sided.any()
    court = builtin.make("colonnade", tessellation=0.3)
    names = np.array([material.name for material in court.materials])[court.part]
    assert set(names[court.two_sided]) == {"cloth_red", "cloth_blue", "cloth_gold", "sails"}


def test_views() -> None:
    assert builtin.make("colonnade", tessellation=0.3).camera == "inside"
    assert builtin.make("room", tessellation=0.3).camera == "inside"
    assert builtin.make("plants", tessellation=0.3).camera == "orbit"


def test_a_colonnade_is_open_to_the_sky_and_its_walks_are_not() -> None:
    tracer = Tracer(builtin.make("colonnade", tessellation=0.3))
    # in the court, in the lower walk, in the upper walk
    eyes = np.array([[2.5, 0.5, 1.5], [2.5, 0.5, 5.5], [2.5, 5.0, 5.5]])
    assert list(tracer.occluded(eyes, np.tile([0.0, 1, 0], (3, 1)))) == [False, True, True]
    # the upper walk has a floor, and looks through an arch over the roof of the other side
    assert tracer.occluded(eyes[2:], np.array([[0.0, -1, 0]])).all()
    assert not tracer.occluded(np.array([[2.0, 6.0, 5.5]]), np.array([[0.0, 0.42, -1.0]])).any()


def test_repair_finds_nothing_to_do() -> None:
    parts = builtin.MAKERS["plants"][0](0.5, np.random.default_rng(0))
    repaired = repair(parts, two_sided="auto", source="plants")
    assert [len(part.faces) for part in repaired] == [len(part.faces) for part in parts]


def test_errors_say_what_is_expected() -> None:
    with pytest.raises(PrtnetError, match=r"'plant'.*plants"):
        builtin.make("plant")
    with pytest.raises(PrtnetError, match=r"tessellation.*0\.05"):
        builtin.make("plants", tessellation=0)
