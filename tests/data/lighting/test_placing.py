"""Where lamps may stand: in rooms of all kinds, not in solids."""

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data import builtin
from prtnet.data.lighting import placing
from prtnet.data.lighting.lamp import Lamp, Lighting
from prtnet.data.part import Part
from prtnet.data.samples import area_uniform
from prtnet.data.scene import assemble
from prtnet.data.shapes import box
from prtnet.data.tracer import Tracer


def scene_of(*parts):
    """Boxes (low, high, kind): solid, faces inwards ("room"), or sheets that are seen from both sides."""
    made = []
    for number, (low, high, kind) in enumerate(parts):
        shape = box(low, high)
        faces = shape.faces[:, ::-1] if kind == "room" else shape.faces
        made.append(Part(f"{kind} {number}", shape.vertices, faces, two_sided=kind == "sheets"))
    return assemble("boxes", made).centred()


WALLS = ([-1, -1, -1], [1, 1, 1])
TABLE = ([-0.5, -0.5, -0.5], [0.5, 0.0, 0.5])
MIDDLE, LOW = (0.0, 0.4, 0.0), (0.1, -0.3, 0.05)


def complaint(scene, *positions):
    lamps = [Lamp("directional", (1.0, 1.0, 1.0)), *(Lamp("point", (1.0, 1.0, 1.0), each) for each in positions)]
    try:
        placing.check(Lighting(tuple(lamps)), scene, Tracer(scene))
    except PrtnetError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("walls", ["room", "sheets"])
def test_a_lamp_in_a_room_is_fine_and_one_in_its_table_is_not(walls):
    scene = scene_of((*WALLS, walls), (*TABLE, "solid"))
    assert complaint(scene, MIDDLE) == ""
    assert "point lamp 2 at (0.1, -0.3, 0.05) inside geometry" in complaint(scene, MIDDLE, LOW)


def test_solids_that_reach_into_each_other():
    scene = scene_of((*TABLE, "solid"), ([-0.05, -0.45, -0.1], [0.05, 1.0, 0.1], "solid"), (*WALLS, "sheets"))
    # within the table alone, seeing the post from outside; and within both
    assert "inside geometry" in complaint(scene, (0.06, -0.25, 0.0))
    assert "inside geometry" in complaint(scene, (0.0, -0.25, 0.0))
    assert complaint(scene, (0.2, 0.25, 0.0)) == ""


def test_a_solid_is_one_whatever_is_within():
    """All that is seen from the lamp are fronts: those of slabs around it, buried in a block."""
    slabs = []
    for axis in range(3):
        for side in (-0.06, 0.04):
            low, high = [-0.1] * 3, [0.1] * 3
            low[axis], high[axis] = side, side + 0.02
            slabs.append((low, high, "solid"))
    assert complaint(scene_of((*WALLS, "sheets"), *slabs), (0.0, 0.0, 0.0)) == ""
    buried = scene_of((*WALLS, "sheets"), *slabs, ([-0.5] * 3, [0.5] * 3, "solid"))
    assert "inside geometry" in complaint(buried, (0.0, 0.0, 0.0))


def test_a_shade_of_sheets_holds_a_lamp():
    scene = scene_of((*WALLS, "room"), (*TABLE, "sheets"))
    assert complaint(scene, LOW) == ""


def test_cornell_is_open_and_its_boxes_are_solid():
    scene = builtin.make("cornell").centred()
    assert complaint(scene, (0.0, 0.0, 0.0), (0.0, 0.8, 2.0)) == ""
    assert "inside geometry" in complaint(scene, (-0.36, -0.5, -0.3))


def test_a_lamp_on_a_surface():
    scene = scene_of((*WALLS, "sheets"))
    assert "from a surface" in complaint(scene, (0.3, -1 + 1e-6, 0.2))
    assert complaint(scene, (0.3, -0.99, 0.2)) == ""


def test_distances_are_those_to_the_walls():
    scene = scene_of((*WALLS, "room"))
    places = np.random.default_rng(0).uniform(-0.99, 0.99, (200, 3))
    found = placing.Places(scene, Tracer(scene)).distance(places)
    np.testing.assert_allclose(found, 1 - np.abs(places).max(axis=1), atol=1e-12)


def test_rooms_are_told_from_things():
    rooms = {}
    for name in ("cornell", "plants", "room"):
        scene = builtin.make(name, tessellation=0.3).centred()
        rooms[name] = placing.Places(scene, Tracer(scene)).room > 0
    assert rooms == {"cornell": True, "plants": False, "room": True}


def test_surfaces_worth_lighting_are_those_inside_a_room():
    scene = builtin.make("cornell").centred()
    points = area_uniform(scene, 4000, np.random.default_rng(0))
    worth, sees_out = placing.Places(scene, Tracer(scene)).worth(points)
    x, y, z = points.positions.T
    outside = (np.abs(x) > 0.96) | (y < -0.99) | (y > 0.98) | (z < -0.98)
    assert outside.mean() > 0.3
    # but for slots where two walls meet
    assert worth[outside].mean() < 0.02
    wall = (np.abs(x) > 0.9) & ~outside & (np.abs(points.geometric_normals[:, 0]) > 0.9)
    wall &= (np.abs(y) < 0.9) & (np.abs(z) < 0.8)
    assert wall.sum() > 100
    assert worth[wall].all()
    assert sees_out[wall].any()
    # the box stands on the floor, a crack apart; at its edges one sees out of it
    crack = (y < -0.97) & (points.geometric_normals[:, 1] < -0.9) & ~outside
    assert crack.sum() > 5
    assert worth[crack].mean() < 0.4
