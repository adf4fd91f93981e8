"""Tangents in closed form, n' of points, files, what scenes without maps keep, and maps that cannot be."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from PIL import Image

from prtnet import PrtnetError
from prtnet.data import atlas, atlas_set, builtin, normal_map, samples, tangent, texture, transfer, vertex
from prtnet.data.bilinear import bilinear
from prtnet.data.normals import unit
from prtnet.data.scene import assemble, load
from prtnet.data.tracer import Tracer
from tests.render.meshes import quad, scene, sphere

TILTED = np.array([0.6, 0.0, 0.8], np.float32)


def constant(vector=TILTED) -> np.ndarray:
    return np.tile(np.asarray(vector, np.float32), (2, 2, 1))


def floor(**more):
    return quad([-1, 0, 1], [2, 0, 0], [0, 0, -2], normal_map=constant(), **more)


def test_tangents_of_a_quad_follow_u():
    part = floor()
    _, faces, found = tangent.vertex_tangents(part.vertices, part.faces, np.tile([0, 1.0, 0], (4, 1)), part.uv)
    assert len(found) == 4
    np.testing.assert_array_equal(faces, part.faces)
    np.testing.assert_allclose(found, np.tile([1, 0, 0, 1], (4, 1)), atol=1e-7)


@pytest.mark.parametrize("turn", [0, 37, 200])
@pytest.mark.parametrize("mirror", [False, True])
def test_tangents_turn_and_mirror_with_the_coordinates(turn, mirror):
    angle = np.radians(turn)
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    part = floor()
    uv = part.uv * ([-1, 1] if mirror else [1, 1]) @ matrix.T
    _, _, found = tangent.vertex_tangents(part.vertices, part.faces, np.tile([0, 1.0, 0], (4, 1)), uv)
    # u as a function of (x, -z), the plane seen from above
    along = np.linalg.solve(np.stack([[1.0, 0], [0, 1.0]]), matrix[0] * ([-1, 1] if mirror else [1, 1]))
    np.testing.assert_allclose(found[0, :3], [along[0], 0, -along[1]], atol=1e-6)
    assert (found[:, 3] == (-1 if mirror else 1)).all()


def test_a_sphere_has_tangents_along_its_parallels():
    part = sphere(24)
    at, _, found = tangent.vertex_tangents(part.vertices, part.faces, part.normals, part.uv)
    normal = part.normals[at]
    inner = np.abs(normal[:, 1]) < 0.95
    expected = unit(np.cross([0.0, 1.0, 0.0], normal[inner]))
    assert np.sum(found[inner, :3] * expected, axis=1).min() > 0.995
    np.testing.assert_allclose(np.sum(found[:, :3] * normal, axis=1), 0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found[:, :3], axis=1), 1, atol=1e-5)


def test_a_mirrored_half_gets_vertices_of_its_own():
    """u = |x|: the line x = 0 belongs to both halves, with opposite tangents."""
    x, z = np.meshgrid([-1.0, 0, 1], [0.0, 1])
    points = np.stack([x, 0 * x, z], -1).reshape(-1, 3)
    faces = np.array([[0, 3, 1], [1, 3, 4], [1, 4, 2], [2, 4, 5]])
    uv = np.stack([np.abs(points[:, 0]), -points[:, 2]], 1)
    at, _, found = tangent.vertex_tangents(points, faces, np.tile([0, 1.0, 0], (6, 1)), uv)
    assert sorted(at) == [0, 1, 1, 2, 3, 4, 4, 5]
    np.testing.assert_allclose(found[:, 0], np.where(found[:, 3] > 0, 1, -1))
    assert (np.sign(points[at, 0]) * found[:, 3] >= 0).all()


def test_the_order_of_faces_and_shared_vertices_do_not_matter():
    part = sphere(8)
    whole = assemble("whole", [replace(part, normal_map=constant())])
    loose = part.faces.ravel()
    apart = replace(
        part, vertices=part.vertices[loose], normals=part.normals[loose], uv=part.uv[loose],
        faces=np.arange(len(loose)).reshape(-1, 3)[::-1], normal_map=constant(),
    )  # fmt: skip
    split = assemble("apart", [apart])
    np.testing.assert_allclose(split.tangents[split.faces][::-1], whole.tangents[whole.faces], atol=1e-6)


def test_points_have_the_maps_normal_and_the_triangles_geometric_one():
    made = scene(floor())
    points = samples.area_uniform(made, 100, np.random.default_rng(0))
    np.testing.assert_allclose(points.normals, np.tile([0.6, 0.8, 0], (100, 1)), atol=1e-6)
    np.testing.assert_array_equal(points.geometric_normals, np.tile(np.float32([0, 1, 0]), (100, 1)))


def test_the_back_is_the_same_relief_from_behind():
    made = scene(floor(two_sided=True))
    points = samples.area_uniform(made, 200, np.random.default_rng(0))
    sign = points.geometric_normals[:, 1:2]
    assert set(sign.ravel()) == {-1.0, 1.0}
    np.testing.assert_allclose(points.normals, sign * [0.6, 0.8, 0], atol=1e-6)


def test_green_is_up_the_image():
    """A map that leans along v bends the floor's normal to -z, where v grows."""
    made = scene(replace(floor(), normal_map=constant([0, 0.6, 0.8])))
    points = samples.area_uniform(made, 10, np.random.default_rng(0))
    np.testing.assert_allclose(points.normals, np.tile([0, 0.8, -0.6], (10, 1)), atol=1e-6)


def test_look_up_is_bilinear_and_repeats():
    image = np.random.default_rng(0).normal(size=(4, 8, 3)).astype(np.float32)
    centres = np.array([[0.5 / 8, 1 - 0.5 / 4], [3.5 / 8, 1 - 2.5 / 4]])
    np.testing.assert_allclose(bilinear(image, centres), image[[0, 2], [0, 3]], atol=1e-6)
    np.testing.assert_allclose(bilinear(image, centres + [3, -2]), image[[0, 2], [0, 3]], atol=1e-5)
    between = bilinear(image, np.array([[1 / 8, 1 - 0.5 / 4], [0.0, 0.5 / 4]]))
    np.testing.assert_allclose(between, [image[0, :2].mean(axis=0), image[3, [0, 7]].mean(axis=0)], atol=1e-6)


@pytest.mark.parametrize("sets", ["one", "parts"])
def test_texels_and_atlases_carry_the_relief(sets):
    parts = [floor(name="floor", two_sided=True), quad([-1, 0, -1], [2, 0, 0], [0, 1, 0], name="wall")]
    made = scene(*parts)
    options = {"single_chart": False, "unwrap_mode": "auto", "padding": 1}
    found = atlas.make(made, size=64) if sets == "one" else atlas_set.make(made, size=64, **options)
    texels = texture.points(texture.gbuffers(found, 64))
    level = np.abs(texels.geometric_normals[:, 1]) > 0.5
    sign = texels.geometric_normals[level, 1:2]
    np.testing.assert_allclose(texels.normals[level], sign * [0.6, 0.8, 0], atol=1e-6)
    np.testing.assert_array_equal(texels.normals[~level], texels.geometric_normals[~level])


def test_transfer_is_that_of_the_shading_normal_above_the_triangle():
    """A floor bent towards +x: white light over the half-space above it, cosine of n', in closed form."""
    made = scene(floor())
    rng = np.random.default_rng(0)
    points = samples.area_uniform(made, 20, rng)
    baked = transfer.bake(
        Tracer(made), points.positions, points.normals, bands=1, directions=4096, rng=rng,
        geometric_normals=points.geometric_normals,
    )  # fmt: skip
    # a hemisphere about n' cut by a plane at the angle a: pi (1 + cos a) / 2
    expected = np.pi * (1 + 0.8) / 2 * np.sqrt(1 / (4 * np.pi))
    np.testing.assert_allclose(baked[:, 0], expected, rtol=2e-3)


def test_scenes_without_maps_have_their_old_digest():
    """As version 0.1.0 gave it: everything cached stays valid."""
    made = builtin.make("cornell", tessellation=0.25)
    assert made.tangents is None
    assert made.digest() == OLD_DIGEST
    mapped = scene(floor())
    plain = scene(replace(floor(), normal_map=None))
    bumped = scene(replace(floor(), normal_map=constant([0.8, 0, 0.6])))
    assert len({mapped.digest(), plain.digest(), bumped.digest()}) == 3


OLD_DIGEST = "55385aeaabfc88d4ea7b3514c7870d45dfe17754cb6d4679d2192c2f2ffaef4f"


def test_vertices_keep_their_own_normals():
    drawn = vertex.mesh(scene(floor()), ["quad"], 2)
    assert drawn.tangents is None
    np.testing.assert_array_equal(drawn.normals, np.tile(np.float32([0, 1, 0]), (len(drawn.normals), 1)))


def write_map(path, vector=TILTED, size=4):
    coded = np.rint((np.asarray(vector) + 1) / 2 * 255).astype(np.uint8)
    Image.fromarray(np.tile(coded, (size, size, 1))).save(path)


def write_obj(folder, *, uv=True, mtl="norm bumps.png"):
    (folder / "floor.mtl").write_text(f"newmtl floor\nKd 0.5 0.5 0.5\n{mtl}\n")
    lines = ["mtllib floor.mtl", "v -1 0 1", "v 1 0 1", "v 1 0 -1", "v -1 0 -1", "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    face = "f 1/1 2/2 3/3 4/4" if uv else "f 1 2 3 4"
    (folder / "floor.obj").write_text("\n".join([*lines, "usemtl floor", face]) + "\n")
    return folder / "floor.obj"


def normals_of(made):
    return samples.area_uniform(made, 8, np.random.default_rng(0)).normals


@pytest.mark.parametrize(
    ("mtl", "expected"),
    [
        ("norm bumps.png", [0.6, 0.8, 0]),
        ("map_Bump bumps.png", [0.6, 0.8, 0]),
        ("bump -bm 2 bumps.png", [1.2 / 1.4422, 0.8 / 1.4422, 0]),
        ("map_Bump grey.png", [0, 1, 0]),
        ("norm absent.png", [0, 1, 0]),
    ],
)
def test_obj(tmp_path, mtl, expected, caplog):
    write_map(tmp_path / "bumps.png")
    Image.fromarray(np.full((4, 4), 90, np.uint8)).save(tmp_path / "grey.png")
    made = load(write_obj(tmp_path, mtl=mtl), two_sided="none")
    assert np.abs(normals_of(made) - expected).max() < 0.01
    if "grey" in mtl or "absent" in mtl:
        assert "height map" in caplog.text or "normal map absent.png is missing" in caplog.text


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_gltf_with_its_scale(tmp_path, scale):
    write_map(tmp_path / "bumps.png")
    image = Image.open(tmp_path / "bumps.png")
    part = quad([-1, 0, 1], [2, 0, 0], [0, 0, -2])
    material = trimesh.visual.material.PBRMaterial(name="floor", normalTexture=image, doubleSided=False)
    visual = trimesh.visual.TextureVisuals(uv=part.uv, material=material)
    trimesh.Trimesh(part.vertices, part.faces, visual=visual, process=False).export(tmp_path / "floor.glb")
    _set_scale(tmp_path / "floor.glb", scale)
    bent = np.array([0.6 * scale, 0.8, 0])
    assert np.abs(normals_of(load(tmp_path / "floor.glb")) - bent / np.linalg.norm(bent)).max() < 0.01


def _set_scale(path, scale):
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    header = json.loads(content[20 : 20 + length])
    header["materials"][0]["normalTexture"]["scale"] = scale
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    path.write_bytes(struct.pack("<III", 0x46546C67, 2, 20 + len(text) + len(rest)))
    with path.open("ab") as file:
        file.write(struct.pack("<II", len(text), 0x4E4F534A) + text + rest)


def test_maps_given_by_the_caller(tmp_path):
    write_map(tmp_path / "bumps.png")
    path = write_obj(tmp_path, mtl="")
    given = {"floor": normal_map.read(tmp_path / "bumps.png")}
    assert np.abs(normals_of(load(path, two_sided="none", normal_maps=given)) - [0.6, 0.8, 0]).max() < 0.01
    with pytest.raises(PrtnetError, match=r"floor\.obj: scene\.normal_maps: found \['roof'\], expected some of"):
        load(path, normal_maps={"roof": given["floor"]})
    with pytest.raises(PrtnetError, match=r"scene\.normal_maps: .*none\.png: no such file"):
        normal_map.read(tmp_path / "none.png")
    (tmp_path / "text.png").write_text("no image")
    with pytest.raises(PrtnetError, match=r"text\.png cannot be read as an image"):
        normal_map.read(tmp_path / "text.png")


def test_maps_without_tangents_are_refused(tmp_path):
    write_map(tmp_path / "bumps.png")
    path = write_obj(tmp_path, uv=False)
    with pytest.raises(PrtnetError, match=r"floor\.obj: part floor has a normal map but no texture coordinates"):
        load(path)
    path = write_obj(tmp_path)
    path.write_text(path.read_text().replace("1/1 2/2 3/3 4/4", "1/1 2/2 3/1 4/2"))
    with pytest.raises(PrtnetError, match=r"floor\.obj: part floor has a normal map but no tangents"):
        load(path)
