"""One page for each part: equal memory, the scene face by face, and the limits."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data import atlas, atlas_set, builtin, texture
from prtnet.data.scene import Scene
from tests.render.meshes import atlas_uv, quad, scene, sphere

SIZE = 256
OPTIONS = {"single_chart": False, "unwrap_mode": "auto", "padding": 1}


@pytest.fixture(scope="module")
def plants() -> Scene:
    return builtin.make("plants", tessellation=0.3).centred()


@pytest.fixture(scope="module")
def made(plants) -> atlas.Atlas:
    return atlas_set.make(plants, size=SIZE, **OPTIONS)


def test_the_set_has_as_many_texels_as_one_texture_at_the_most(made, plants):
    assert made.sides is not None
    assert len(made.sides) == len(plants.materials)
    assert all(side % 4 == 0 and side >= 16 for side in made.sides)
    total = sum(side * side for side in made.sides)
    assert 0.95 * SIZE * SIZE < total <= SIZE * SIZE


def test_faces_keep_their_order_with_both_sides(made, plants):
    split = plants.split_sides()
    np.testing.assert_array_equal(made.scene.vertices[made.scene.faces], split.vertices[split.faces])
    np.testing.assert_array_equal(made.scene.normals[made.scene.faces], split.normals[split.faces])
    np.testing.assert_array_equal(made.scene.part, split.part)
    np.testing.assert_array_equal(made.scene.face_origin, split.face_origin)
    np.testing.assert_array_equal(made.page_of_face, split.part)


def test_no_page_overlaps_and_texels_lie_on_their_part(made):
    pages = texture.gbuffers(made, SIZE)
    for part, (texels, side) in enumerate(zip(pages, made.sides or (), strict=True)):
        assert texels.size == side
        assert (made.scene.part[texels.face] == part).all()
        corners = made.uv[made.scene.faces[made.scene.part == part]]
        assert atlas.coverage(corners, side).max() <= 1
        uv = atlas_uv(made, texels.face, texels.positions)
        row, column = np.divmod(texels.index, side)
        assert np.abs(uv[:, 0] * side - column - 0.5).max() < 0.72 + 0.25
        assert np.abs((1 - uv[:, 1]) * side - row - 0.5).max() < 0.72 + 0.25


def test_pages_go_by_area_and_a_files_own_coordinates_serve_each_part():
    """Two quads share the same coordinates: one atlas needs xatlas, a page for each does not."""
    two = scene(
        quad([-1, 0, 1], [2, 0, 0], [0, 0, -2], name="floor"), quad([0, 0.5, 0], [0.5, 0, 0], [0, 0.5, 0], name="card")
    )
    found = atlas_set.make(two, size=SIZE, **OPTIONS | {"unwrap_mode": "never"})
    assert found.source == "file"
    assert found.sides is not None
    # 4 and 1/4 of area: sides of 4 to 1
    assert found.sides[1] == 60
    assert found.sides[0] == 248
    with pytest.raises(PrtnetError, match=r"atlas\.unwrap: found never, but 100.00 % of the file's coord"):
        atlas.make(two, size=SIZE, unwrap_mode="never")


@pytest.mark.parametrize("fault", ["absent", "two-sided", "outside"])
def test_unwrapping_is_refused_with_the_reason(fault):
    one = scene(quad([-1, 0, 1], [2, 0, 0], [0, 0, -2], two_sided=fault == "two-sided"))
    if fault != "two-sided":
        one = replace(one, uv=None if fault == "absent" else one.uv + np.float32(0.5))
    reason = {
        "absent": "the scene has no texture coordinates",
        "two-sided": "two-sided faces need a chart for each side",
        "outside": r"the file's coordinates leave \[0, 1\]",
    }[fault]
    with pytest.raises(PrtnetError, match=rf"test: atlas\.unwrap: found never, but {reason}"):
        atlas.make(one, size=64, unwrap_mode="never")
    assert atlas.make(scene(sphere()), size=64, unwrap_mode="never").source == "file"


def test_too_few_texels_for_all_parts(plants):
    with pytest.raises(PrtnetError, match=r"part .* atlas\.size=32 leaves it"):
        atlas_set.make(plants, size=32, **OPTIONS)


def test_the_drivers_limits_are_named():
    atlas_set.check_limits(1024, 25, 4, 8.0)
    with pytest.raises(PrtnetError, match=r"atlas\.size: found 1000000, expected at most \d+ \(GL_MAX_TEXTURE_SIZE"):
        atlas_set.check_limits(1_000_000, 25, 4, 1e9)
    with pytest.raises(PrtnetError, match=r"transfer\.bands: found 999, .* at most \d+ bands in a shader, \d+ layers"):
        atlas_set.check_limits(64, 999**2, 4, 1e9)
    with pytest.raises(PrtnetError, match=r"which takes 1\.8 GiB for 25 coefficients of 4 bytes; .* 1\.5 GiB"):
        atlas_set.check_limits(4096, 25, 4, 1.5)


def test_unknown_choices():
    with pytest.raises(PrtnetError, match=r"atlas\.sets: found 'all', expected one of one, parts"):
        atlas_set.check("all")
    with pytest.raises(PrtnetError, match=r"atlas\.unwrap: found 'no', expected one of auto, never"):
        atlas.check("no", 1)
    with pytest.raises(PrtnetError, match=r"atlas\.padding: found 0, expected 1 to 64"):
        atlas.check("auto", 0)
