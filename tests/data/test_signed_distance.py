import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data.part import Part
from prtnet.data.scene import assemble
from prtnet.data.shapes import Surface, box, ellipsoid, ground, merge
from prtnet.data.signed_distance import Distance, nearest_of_all

RNG = np.random.default_rng(4)
POINTS = RNG.uniform(-1.3, 1.3, (1500, 3))


def distance_to(surface, without=0):
    return Distance(assemble("test", [Part("test", surface.vertices, surface.faces[without:])]))


@pytest.fixture(scope="module")
def ball():
    return distance_to(ellipsoid([1, 1, 1], 96))


def box_distance(points, half):
    outside = np.abs(points) - half
    return np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(axis=1), 0)


def test_the_nearest_triangle_is_that_of_all():
    corners = RNG.uniform(-1, 1, (70, 1, 3)) + RNG.normal(size=(70, 3, 3)) * RNG.uniform(0.01, 0.5, (70, 1, 1))
    soup = distance_to(Surface(corners.reshape(-1, 3), np.arange(210).reshape(-1, 3)))
    points = np.concatenate([POINTS[:300], soup.scene.vertices[:20]])
    found = soup.nearest(points)
    corners = soup.scene.vertices[soup.scene.faces]
    np.testing.assert_allclose(found.distance, nearest_of_all(points, corners), atol=1e-14)
    own = [nearest_of_all(point[None], corners[face, None])[0] for point, face in zip(points, found.face, strict=True)]
    np.testing.assert_allclose(found.distance, own, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(points - found.where, axis=1), found.distance)


def test_a_box_has_its_closed_form():
    found, _ = distance_to(box([-1, -0.5, -0.25], [1, 0.5, 0.25])).signed(POINTS, RNG)
    np.testing.assert_allclose(found, box_distance(POINTS, np.array([1, 0.5, 0.25])), atol=1e-14)


def test_a_ball_has_its_closed_form(ball):
    found, _ = ball.signed(POINTS, RNG)
    # the facets of 96 segments lie up to 1 - cos(pi / 96)^2 inside the ball
    np.testing.assert_allclose(found, np.linalg.norm(POINTS, axis=1) - 1, atol=1.1e-3)


def test_points_of_the_file_come_in_unit_coordinates():
    # a box about (5, 0, 0) of size 4: the centre is 1 deep in unit lengths
    found, _ = distance_to(box([3, -2, -2], [7, 2, 2])).signed(np.zeros((1, 3)), RNG)
    np.testing.assert_allclose(found, [-1])


def test_a_small_hole_turns_no_sign(ball):
    # 1 % of the triangles about a pole
    open_ball = distance_to(ellipsoid([1, 1, 1], 96), without=90)
    points = POINTS[np.abs(ball.nearest(POINTS).distance) > 0.1]
    whole, cut = ball.signed(points, RNG)[0], open_ball.signed(points, RNG)[0]
    assert (open_ball.inside(points, RNG) % 1 > 0).any(), "no ray found the hole"
    assert (np.sign(whole) == np.sign(cut)).all()


def inverted(surface):
    return Surface(surface.vertices, surface.faces[:, ::-1])


@pytest.mark.parametrize(
    "surface",
    [
        ground(1, 1),
        merge([box([-1, -1, -1], [1, 1, 1]), ground(3, 3, -1.001)]),
        inverted(ellipsoid([1, 1, 1], 24)),
        Surface(ellipsoid([1, 1, 1], 24).vertices, ellipsoid([1, 1, 1], 24).faces[::2]),
    ],
    ids=["sheet", "box on a sheet", "inside out", "every other triangle"],
)
def test_what_has_no_inside_is_refused_with_advice(surface):
    with pytest.raises(PrtnetError, match=r"test: found no clear inside.*rays disagree, expected.*close the holes"):
        distance_to(surface).signed(POINTS, RNG)


def test_points_on_the_surface_do_not_judge_a_mesh(ball):
    on = ball.scene.vertices
    found, _ = ball.signed(on, RNG)
    np.testing.assert_allclose(found, 0, atol=1e-15)


def test_walls_within_the_solid_are_hidden():
    pair = distance_to(merge([box([-1, -0.5, -0.5], [0.2, 0.5, 0.5]), box([-0.2, -0.3, -0.3], [1, 0.3, 0.3])]))
    points = np.array([[0.2, 0.1, 0], [-0.2, 0.2, 0.2], [1, 0.1, 0], [0.5, 0.1, 0.3], [0.2, 0.4, 0.1]])
    assert pair.hidden(pair.nearest(points), RNG).tolist() == [True, True, False, False, False]
    # and the solid is whole
    assert pair.signed(np.array([[0.0, 0.1, 0.1], [0.1, 0.4, 0.2]]), RNG)[0].max() < 0
