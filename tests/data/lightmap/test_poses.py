"""Parts in other poses: texels and measurement points go where their faces go."""

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data import atlas, builtin, samples, texture
from prtnet.data.lightmap import poses
from prtnet.data.lightmap.poses import Pose
from prtnet.data.scene import assemble
from prtnet.data_driven import Measurement
from tests.data.lightmap.enclosures import quad

POSE = Pose("tall_box", (0.2, 0.1, -0.05), 30.0)


def measured(points, supersampling):
    def grouped(values):
        return values.reshape(-1, supersampling, 3).astype(np.float32)

    count = len(points.positions) // supersampling
    return Measurement(
        grouped(points.positions), grouped(points.normals), grouped(points.geometric_normals),
        np.full((count, supersampling, 3), 0.5, np.float32), np.ones((count, 4, 3), np.float32),
    )  # fmt: skip


@pytest.mark.parametrize("centred", [True, False])
def test_texels_go_where_their_faces_go(centred):
    scene = builtin.make("cornell", tessellation=0.25)
    scene = scene.centred() if centred else scene
    made = atlas.make(scene, size=64)
    (page,) = texture.gbuffers(made, 64)
    # weights on the faces as they were, put on the faces as they are
    corners = made.scene.vertices[made.scene.faces[page.face]]
    weights = np.stack(
        [np.linalg.lstsq(c.T, p, rcond=None)[0] for c, p in zip(corners + 3, page.positions + 3, strict=True)]
    )
    moved = poses.posed(made.scene, POSE)
    expected = samples.at_barycentric(moved, page.face, weights)
    for found in (poses.posed_points(made.scene, page, POSE), poses.posed_points(scene, texture.points([page]), POSE)):
        np.testing.assert_allclose(found.positions, expected.positions, atol=1e-9)
        np.testing.assert_allclose(found.normals, expected.normals, atol=1e-6)
        np.testing.assert_allclose(found.geometric_normals, expected.geometric_normals, atol=1e-6)
    share = np.mean(np.any(found.positions != page.positions, axis=1))
    assert 0.02 < share < 0.2
    assert moved.frame is made.scene.frame


def test_a_pose_is_a_turn_about_the_middle_and_a_move():
    """Against the closed form, and back again by the reverse."""
    scene = builtin.make("cornell", tessellation=0.25).centred()
    here = np.unique(scene.faces[poses.faces_of(scene, "tall_box")])
    before, after = scene.vertices, poses.posed(scene, POSE).vertices
    stay = np.setdiff1d(np.arange(len(before)), here)
    np.testing.assert_array_equal(after[stay], before[stay])
    low, high = before[here].min(axis=0), before[here].max(axis=0)
    x, y, z = (before[here] - (low + high) / 2).T
    expected = np.stack([x * np.cos(np.pi / 6) + z / 2, y, z * np.cos(np.pi / 6) - x / 2], axis=1)
    np.testing.assert_allclose(after[here] - (low + high) / 2 - POSE.move, expected, atol=1e-12)
    lifted = poses.posed(scene, Pose("tall_box", (0.0, 0.3, 0.0)))
    back = poses.posed(lifted, Pose("tall_box", (0.0, -0.3, 0.0)))
    np.testing.assert_allclose(back.vertices, scene.vertices, atol=1e-12)
    # a scene 20 long is moved by 10 times as much
    far = builtin.make("cornell", tessellation=0.25)
    np.testing.assert_allclose(far.frame.to_unit(poses.posed(far, POSE).vertices), after, atol=1e-12)


def test_relief_turns_with_its_part():
    """Normals bent by a normal map, at texels that are carried along and on the scene in its pose."""
    bend = np.float32([[[0.6, 0, 0.8]]])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    scene = assemble("relief", [quad("floor", [-1, 0, 1], [2, 0, 0], [0, 0, -2], uv=uv, normal_map=bend)])
    pose = Pose("floor", (0.0, 0.5, 0.0), 40.0)
    points = samples.area_uniform(scene, 20, np.random.default_rng(0))
    found = poses.posed_points(scene, points, pose)
    assert np.abs(points.normals @ [0, 1, 0] - 0.8).max() < 1e-6
    expected = samples.at_barycentric(poses.posed(scene, pose).split_sides(), points.face, points.weights)
    np.testing.assert_allclose(found.normals, expected.normals, atol=1e-6)


def test_measurement_points_on_the_part_go_along():
    """The floor below the box stays, although the box's underside lies on it."""
    scene = builtin.make("cornell", tessellation=0.25).centred()
    scene = poses.posed(scene, Pose("tall_box", (0.0, -0.002 * 2 / 2.1, 0.0)))
    points = samples.area_uniform(scene, 2000, np.random.default_rng(0))
    before = measured(points, 4)
    after = poses.posed_measurement(scene, before, POSE)
    expected = measured(poses.posed_points(scene, points, POSE), 4)
    np.testing.assert_allclose(after.positions, expected.positions, atol=1e-6)
    np.testing.assert_allclose(after.normals, expected.normals, atol=1e-6)
    np.testing.assert_allclose(after.geometric_normals, expected.geometric_normals, atol=1e-6)
    assert np.any(after.positions != before.positions)
    assert after.transfer.shape == (500, 0, 3)
    raised = measured(samples.Samples(points.positions + 0.01, *[points.normals] * 2, points.face), 4)
    np.testing.assert_array_equal(poses.posed_measurement(scene, raised, POSE).positions, raised.positions)


def test_words_of_a_pose():
    assert poses.parse({"part": "tall_box", "move": [0.2, 0.1, -0.05], "turn": 30}) == POSE
    assert poses.parse({"part": "tall_box"}) == Pose("tall_box")
    bad = [{"move": [0, 0, 0]}, {"part": "a", "move": [1, 2]}, {"part": "a", "turn": "x"}, {"part": "a", "spin": 3}]
    for words in [*bad, {"part": "a", "turn": float("nan")}]:
        with pytest.raises(PrtnetError, match=r"keyframe: found .* expected"):
            poses.parse(words)
    scene = builtin.make("cornell", tessellation=0.25)
    with pytest.raises(PrtnetError, match="no part 'teapot' in cornell, expected one of floor, ceiling"):
        poses.posed(scene, Pose("teapot"))
