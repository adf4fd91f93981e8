"""lightmap.glb as engines read it: places, coordinates, colours and light, and what its extras say."""

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from prtnet import PrtnetError, sh
from prtnet.data import atlas, atlas_set, builtin, texture
from prtnet.data.bilinear import bilinear
from prtnet.data.light import by_name
from prtnet.data.materials import to_linear
from prtnet.data.scene import Scene, frame_of
from prtnet.export import glb, lightmap
from prtnet.export.texture_file import read_exr
from prtnet.pipeline import run
from prtnet.pipeline.lightmap import of_page
from prtnet.render.camera import Camera
from tests.pipeline.test_pipeline import config

LIGHT = by_name("green").coefficients(3)
CAMERA = Camera((0.5, 0.25, 2.0), (0.0, 0.0, 0.0))
VIEW = lightmap.View(CAMERA.eye, CAMERA.basis(), CAMERA.fov_y, CAMERA.near, CAMERA.far)


@pytest.fixture(scope="module")
def far() -> Scene:
    """A scene in the file's coordinates, far from the origin: one part with a texture, some faces with two sides."""
    made = builtin.make("cornell", tessellation=0.25)
    moved = made.vertices * 10 + [5e5, 0, -3e5]
    image = np.random.default_rng(0).random((8, 16, 3)).astype(np.float32)
    materials = (replace(made.materials[0], texture=image), *made.materials[1:])
    uv = np.random.default_rng(1).random((len(moved), 2)).astype(np.float32)
    sides = np.arange(len(made.faces)) % 5 == 0
    return replace(made, vertices=moved, frame=frame_of(moved), materials=materials, uv=uv, two_sided=sides)


def exported(scene: Scene, folder: Path, make: Callable = atlas.make, size: int = 128) -> atlas.Atlas:
    """The files of a scene that nothing occludes."""
    made = make(scene.centred(), size=size, single_chart=False, unwrap_mode="auto", padding=1)
    pages = [
        of_page(texture.page(each, sh.cosine_lobe(each.normals, 3)), LIGHT, 1) for each in texture.gbuffers(made, size)
    ]
    about = {"light": {"name": "green", "coefficients": LIGHT.tolist()}}
    lightmap.write(folder, made, pages, scene.frame, fronts=len(scene.faces), about=about, view=VIEW)
    return made


@pytest.fixture(scope="module")
def folder(far, tmp_path_factory):
    found = tmp_path_factory.mktemp("lightmap")
    return found, exported(far, found)


def parts_of(path: Path) -> tuple[dict, dict[str, dict]]:
    """(header, by the names of nodes: their attributes and faces)."""
    header, binary = glb.opened(path)
    found = {}
    for node in header["nodes"]:
        if "mesh" in node:
            (primitive,) = header["meshes"][node["mesh"]]["primitives"]
            read = {name: glb.values(header, binary, index) for name, index in primitive["attributes"].items()}
            read["faces"] = glb.values(header, binary, primitive["indices"]).reshape(-1, 3)
            read["material"] = header["materials"][primitive["material"]]
            found[node["name"]] = read
    return header, found


def picture(path: Path, header: dict, index: int) -> np.ndarray:
    """A texture inside the file, values 0 to 1."""
    _, binary = glb.opened(path)
    view = header["bufferViews"][header["images"][header["textures"][index]["source"]]["bufferView"]]
    content = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    return np.asarray(Image.open(io.BytesIO(content)), np.float64) / 255


def test_another_reader_finds_the_scene(far, folder):
    """trimesh: a geometry for each part with its name, places in the file's coordinates, colours and textures."""
    path, made = folder[0] / lightmap.GLB, folder[1]
    loaded = trimesh.load(path, process=False, maintain_order=True)
    assert isinstance(loaded, trimesh.Scene)
    assert set(loaded.geometry) == {material.name for material in far.materials}
    for index, material in enumerate(far.materials):
        part = loaded.geometry[material.name]
        matrix, _ = loaded.graph.get(material.name)
        corners = far.frame.from_unit(made.scene.vertices[made.scene.faces[made.scene.part == index]])
        np.testing.assert_allclose(part.vertices[part.faces] + matrix[:3, 3], corners, rtol=0, atol=1e-6)
        normals = made.scene.normals[made.scene.faces[made.scene.part == index]]
        np.testing.assert_allclose(part.vertex_normals[part.faces], normals, atol=1e-6)
        factor = np.asarray(part.visual.material.baseColorFactor)[:3] / 255
        np.testing.assert_allclose(factor, material.albedo, atol=1 / 255)
        assert not part.visual.material.doubleSided
        backs = np.count_nonzero(far.two_sided & (far.part == index))
        assert part.metadata["prtnet"] == {"backs": backs}
        fronts = far.frame.from_unit(far.centred().vertices[far.faces[far.part == index]])
        np.testing.assert_allclose(corners[: len(corners) - backs], fronts)
    floor = loaded.geometry[far.materials[0].name]
    image = np.asarray(floor.visual.material.baseColorTexture.convert("RGB")) / 255
    np.testing.assert_allclose(to_linear(image), far.materials[0].texture, atol=6e-3)
    uv = made.scene.uv[made.scene.faces[made.scene.part == 0]]
    np.testing.assert_allclose(floor.visual.uv[floor.faces], uv, atol=1e-6)


def test_the_second_coordinates_lead_to_the_light(folder):
    """Irradiance of a point that nothing occludes is known: sum A_l L_i Y_i(n)."""
    path, made = folder[0] / lightmap.GLB, folder[1]
    header, parts = parts_of(path)
    exr = read_exr(folder[0] / lightmap.EXR, ["R", "G", "B"])[0]
    brightest = 0.0
    for name, part in parts.items():
        where = part["material"]["extras"]["prtnet"]["lightmap"]
        assert where["texCoord"] == 1
        png = picture(path, header, where["index"])
        middles = part["TEXCOORD_1"][part["faces"]].mean(axis=1).astype(np.float64)
        middles[:, 1] = 1 - middles[:, 1]  # glTF: v points down; prtnet's look-up has it up
        expected = np.maximum(sh.cosine_lobe(part["NORMAL"][part["faces"]].mean(axis=1), 3) @ LIGHT, 0)
        found = where["range"] * bilinear(to_linear(png), middles)
        np.testing.assert_allclose(found, expected, atol=0.006 * where["range"], err_msg=name)
        np.testing.assert_allclose(bilinear(exr.astype(np.float64), middles), expected, atol=2e-5, err_msg=name)
        openness = picture(path, header, part["material"]["occlusionTexture"]["index"])
        assert part["material"]["occlusionTexture"]["texCoord"] == 1
        np.testing.assert_allclose(bilinear(openness[..., None], middles), 1, atol=1e-9)
        brightest = max(brightest, float(found.max()))
    about = header["asset"]["extras"]["prtnet"]["lightmap"]
    assert about["range"] == pytest.approx(exr.max())
    assert brightest > 0.9 * about["range"]
    beside = np.asarray(Image.open(folder[0] / about["png"][0]), np.float64) / 255
    np.testing.assert_array_equal(beside, picture(path, header, where["index"]))
    assert made.sides is None


def test_what_the_function_takes(far, folder):
    """Centre and scale lead from the file's coordinates to those of prt_transfer; so does POSITION * scale."""
    header, parts = parts_of(folder[0] / lightmap.GLB)
    about = header["asset"]["extras"]["prtnet"]
    assert about["format"] == lightmap.FORMAT
    assert header["nodes"][0]["translation"] == about["centre"] == far.frame.centre.tolist()
    assert about["scale"] == far.frame.scale
    unit = np.concatenate([part["POSITION"].astype(np.float64) * about["scale"] for part in parts.values()])
    np.testing.assert_allclose([unit.min(), unit.max()], [-1, 1], atol=1e-6)
    np.testing.assert_array_equal(np.float32(about["light"]["coefficients"]), LIGHT)
    # the camera: glTF's matrices are column by column, its eyes look down -z
    node = next(node for node in header["nodes"] if "camera" in node)
    to_unit = np.array(node["matrix"]).reshape(4, 4).T
    np.testing.assert_allclose(to_unit[:3, 3] * about["scale"], CAMERA.eye, atol=1e-9)
    towards = np.subtract(CAMERA.target, CAMERA.eye)
    np.testing.assert_allclose(-to_unit[:3, 2], towards / np.linalg.norm(towards), atol=1e-9)
    np.testing.assert_allclose(np.degrees(header["cameras"][0]["perspective"]["yfov"]), CAMERA.fov_y)


def test_the_page_names_what_is_in_the_file(folder):
    text = (Path(__file__).resolve().parents[2] / "docs" / "deploying.md").read_text(encoding="utf-8")
    header, _ = parts_of(folder[0] / lightmap.GLB)
    about, material = header["asset"]["extras"]["prtnet"], header["materials"][0]["extras"]["prtnet"]
    names = {*about, *about["light"], *material, *material["lightmap"], *header["meshes"][0]["extras"]["prtnet"]}
    for name in names - {"format"}:
        assert f"`{name}`" in text or f".{name}`" in text, name
    for file in folder[0].iterdir():
        assert f"`{file.name}`" in text


def test_a_texture_for_each_part(far, tmp_path):
    """Every material names the page of its own part, in one range."""

    def make(scene: Scene, **options: object) -> atlas.Atlas:
        return atlas_set.make(scene, **options)

    made = make(far.centred(), size=160, single_chart=False, unwrap_mode="auto", padding=1)
    pages = []
    for page, texels in enumerate(texture.gbuffers(made, 160)):
        grey = np.full((texels.size, texels.size, 3), page + 1, np.float32)
        pages.append(lightmap.Lightmap(grey, grey[..., 0] / 10))
    lightmap.write(tmp_path, made, pages, far.frame, fronts=len(far.faces), about={}, view=VIEW)
    header, parts = parts_of(tmp_path / lightmap.GLB)
    for page, material in enumerate(far.materials):
        entry = parts[material.name]["material"]
        shown = picture(tmp_path / lightmap.GLB, header, entry["extras"]["prtnet"]["lightmap"]["index"])
        np.testing.assert_allclose(to_linear(shown) * len(pages), page + 1, atol=0.005 * len(pages))
        openness = picture(tmp_path / lightmap.GLB, header, entry["occlusionTexture"]["index"])
        np.testing.assert_allclose(openness, (page + 1) / 10, atol=1 / 255)
    assert sorted(path.name for path in tmp_path.glob("*.png")) == lightmap.names(len(pages))
    stored = read_exr(tmp_path / lightmap.EXR, ["R", "G", "B"])
    assert [image.max() for image in stored] == [page + 1 for page in range(len(pages))]


def test_wide_indices_only_where_they_are_needed(tmp_path):
    """A strip of 65 536 vertices: 65 535 would be the one too many of 16 bits."""
    for count, kind in ((65_535, np.uint16), (65_536, np.uint32)):
        corner = np.arange(count - 2, dtype=np.int32)
        made = builtin.make("cornell", tessellation=0.25)
        strip = replace(
            made,
            vertices=np.random.default_rng(0).uniform(-1, 1, (count, 3)),
            faces=np.stack([corner, corner + 1, corner + 2], axis=1),
            normals=np.tile(np.float32([0, 1, 0]), (count, 1)),
            part=np.zeros(count - 2, np.int32),
            two_sided=np.zeros(count - 2, bool),
            materials=made.materials[:1],
        )
        flat = atlas.Atlas(strip, np.zeros((count, 2), np.float32), "file", 0.0)
        page = lightmap.Lightmap(np.zeros((16, 16, 3), np.float32), np.zeros((16, 16), np.float32))
        lightmap.write(tmp_path, flat, [page], strip.frame, fronts=count - 2, about={}, view=VIEW)
        _, parts = parts_of(tmp_path / lightmap.GLB)
        (part,) = parts.values()
        assert part["faces"].dtype == kind
        assert part["faces"].max() == count - 1
        assert part["material"]["extras"]["prtnet"]["lightmap"]["range"] == 1
    loaded = trimesh.load(tmp_path / lightmap.GLB, process=False, maintain_order=True)
    np.testing.assert_array_equal(next(iter(loaded.geometry.values())).faces, strip.faces)


def test_the_light_of_each_colour_and_none_below_zero():
    """With bounces each colour has a transfer of its own, and the first group, for gloss, is left out."""
    transfer = np.zeros((2, 2, 16), np.float32)
    transfer[..., [0, 4, 8, 12]] = 9.0, 1.0, 2.0, -3.0
    light = np.float32([[1, 10, 100], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    found = of_page(texture.page_of(transfer), light, 4)
    np.testing.assert_allclose(found.irradiance, np.broadcast_to([1, 20, 0], (2, 2, 3)))
    np.testing.assert_allclose(found.openness, 1)
    np.testing.assert_allclose(of_page(texture.page_of(transfer[..., :4] / 18), light, 1).openness, 1 / np.sqrt(np.pi))


def test_a_run_writes_it_again_only_for_another_light(tmp_path):
    few = {"methods": ["texture"], "stages": ["bake", "export"], "transfer__transport": "unshadowed"}
    run(config(tmp_path, **few))
    assert not (tmp_path / lightmap.GLB).exists()
    run(config(tmp_path, **few, export__lightmap=True))
    written = (tmp_path / lightmap.GLB).stat().st_mtime_ns
    run(config(tmp_path, **few, export__lightmap=True))
    assert (tmp_path / lightmap.GLB).stat().st_mtime_ns == written
    before, _ = glb.opened(tmp_path / lightmap.GLB)
    run(config(tmp_path, **few, export__lightmap=True, light__name="green"))
    after, _ = glb.opened(tmp_path / lightmap.GLB)
    names = [header["asset"]["extras"]["prtnet"]["light"]["name"] for header in (before, after)]
    assert names == ["sky", "green"]
    (tmp_path / "lightmap.png").unlink()
    run(config(tmp_path, **few, export__lightmap=True, light__name="green"))
    assert (tmp_path / "lightmap.png").exists()


def test_a_folder_that_is_none(far, tmp_path):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(PrtnetError, match=r"taken.*could not be written"):
        exported(far, tmp_path / "taken")
