"""The three.js example in a real browser: its pictures against prtnet's own, its harmonics, what it says of errors."""

import json
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from prtnet import netspec, score, sh
from prtnet.data import atlas, builtin, texture
from prtnet.data.light import about_y, by_name
from prtnet.data.scene import IDENTITY, Scene
from prtnet.export import browser, bundle, glsl, lightmap
from prtnet.export.browser import Browser
from prtnet.export.form import Form
from prtnet.netspec import NetSpec
from prtnet.pipeline.lightmap import of_page
from prtnet.render.camera import Camera
from prtnet.render.method import NetMethod, TextureMethod
from prtnet.render.raster import Raster
from tests.examples.browser import picture, served, wait
from tests.nets import random_grid, random_hash, random_net, random_texels

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "three"
VERSION = json.loads((EXAMPLE / "package.json").read_text())["dependencies"]["three"]
SIZE, BANDS = 96, 3
LIGHT = by_name("green").coefficients(BANDS)
CAMERA = Camera((0.7, 0.5, 3.2), (0.0, 0.0, 0.0), far=6.0)

needs_chromium = pytest.mark.skipif(browser.find() is None, reason="no chromium: apt-get install chromium")
needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="no node: apt-get install nodejs")


@dataclass(frozen=True)
class Site:
    """What a web server serves: the example in `three`, a run in `run`; and the same scene for prtnet."""

    folder: Path
    made: atlas.Atlas
    page: texture.Page
    net: NetSpec


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(EXAMPLE, folder / "three", ignore=shutil.ignore_patterns("node_modules"))
    _install(folder / "three")
    scene = _textured(builtin.make("cornell", tessellation=0.25))
    made = atlas.make(scene.centred(), size=128)
    texels = texture.gbuffer(made, 128)
    page = texture.page(texels, sh.cosine_lobe(texels.normals, BANDS))
    # half and full floats, dense, hashed and over the atlas; coarse, since rasterisers place pixels to a 16th only
    grids = (random_grid(5, 4, 3), random_grid(2, 3, 2, channels=4, kind="float32"))
    hashes = (random_hash(4, channels=8), random_hash(6, kind="float32"))
    texels = (random_texels(3, 2, channels=8), random_texels(2, 3, kind="float32"))
    net = random_net(
        bands=BANDS, depth=1, position_frequencies=0, normal_frequencies=1, grids=grids, hashes=hashes, texels=texels,
        output="linear", output_scale=0.1, residual=True,
    )  # fmt: skip
    run = folder / "run"
    about = {"bands": BANDS, "groups": 1, "light": {"name": "green", "coefficients": LIGHT.tolist()}}
    view = lightmap.View(CAMERA.eye, CAMERA.basis(), CAMERA.fov_y, CAMERA.near, CAMERA.far)
    pages = [of_page(page, LIGHT, 1)]
    for storage, place in (("literal", run), ("texture", folder / "weights"), ("ubo", folder / "blocks")):
        place.mkdir()
        for name, data in bundle.bundle(net, Form(storage=storage)).files.items():
            (place / name).write_bytes(data)
        netspec.save(net, place / "net.safetensors")
        lightmap.write(place, made, pages, scene.frame, fronts=len(scene.faces), about=about, view=view)
    assert scene.frame is not IDENTITY
    return Site(folder, made, page, net)


def _textured(scene: Scene) -> Scene:
    """With a texture without edges over the floor, whose coordinates are none of an atlas."""
    across = np.linspace(0.4, 1, 64, dtype=np.float32)
    image = np.stack([*np.meshgrid(across, across), np.full((64, 64), 0.7, np.float32)], axis=-1)
    unit = scene.centred().vertices
    uv = (0.25 + 0.2 * unit[:, [0, 2]]).astype(np.float32)
    return replace(scene, uv=uv, materials=(replace(scene.materials[0], texture=image), *scene.materials[1:]))


def _install(example: Path) -> None:
    """three.js where the page looks for it: the checkout's, or npm's."""
    there = EXAMPLE / "node_modules"
    package = there / "three" / "package.json"
    if package.exists() and json.loads(package.read_text())["version"] == VERSION:
        (example / "node_modules").symlink_to(there)
        return
    how = f"`npm install` in {EXAMPLE.relative_to(EXAMPLE.parents[1])} where a registry can be reached"
    if shutil.which("npm") is None:
        pytest.skip(f"no npm: apt-get install npm, then {how}")
    words = ["npm", "install", "--no-audit", "--no-fund", "--fetch-retries=0", "--fetch-timeout=20000"]
    try:
        done = subprocess.run(words, cwd=example, capture_output=True, text=True, timeout=60, check=False)
    except subprocess.TimeoutExpired:
        pytest.skip(f"npm brought no three.js within a minute: {how}")
    if done.returncode:
        pytest.skip(f"npm could not bring three.js: {how}")


@pytest.fixture(scope="module")
def tab(site: Site) -> Iterator[tuple[Browser, str]]:
    with served(site.folder) as address, Browser(size=(2 * SIZE, SIZE)) as page:
        yield page, address


def drawn(page: Browser, **inputs: float) -> np.ndarray:
    """The page's picture in [0, 1] after inputs that differ from what they were."""
    frames = page.evaluate("document.body.dataset.frames")
    for name, value in inputs.items():
        event = "dispatchEvent(new Event('input', { bubbles: true }))"
        page.evaluate(f"(() => {{ const e = document.getElementById('{name}'); e.value = {value}; e.{event}; }})()")
    wait(page, f"document.body.dataset.frames > {frames if inputs else 0}")
    return picture(page) / 255


def inner(raster: Raster) -> np.ndarray:
    """Pixels whose neighbours show the same chart from the same side: the browser smooths the others."""
    face = raster.faces(CAMERA)[..., 0].astype(int) - 1
    normals = np.where(face[..., None] < 0, 0, raster.scene.face_normals[face])
    kind = np.concatenate([np.where(face < 0, -1, raster.scene.part[face])[..., None], normals], axis=-1)
    gbuffer, uv = raster.gbuffer(CAMERA), np.zeros((face.size, 2))
    uv[gbuffer.pixel] = gbuffer.uv
    uv = uv.reshape(*face.shape, 2)
    same = np.ones(face.shape, bool)
    for step in np.ndindex(3, 3):
        near = [np.roll(image, np.subtract(step, 1), (0, 1)) - image for image in (kind, uv)]
        same &= np.all(np.abs(near[0]) < 1e-6, axis=-1) & np.all(np.abs(near[1]) < 0.03, axis=-1)
    return same & (face >= 0)


@needs_chromium
def test_the_page_shows_what_prtnet_draws(site, tab):
    page, address = tab
    page.goto(f"{address}/three/?run=/run")
    page.evaluate("document.querySelectorAll('.side, #controls').forEach((e) => { e.style.visibility = 'hidden'; })")
    wait(page, "document.body.dataset.frames")
    raster = Raster(site.made, SIZE)
    net = NetMethod(raster, glsl.emit(site.net), grids=site.net.grids, hashes=site.net.hashes, texels=site.net.texels)
    baked = TextureMethod(raster, [site.page]).draw(CAMERA, LIGHT)
    exposure = np.pi / of_page(site.page, LIGHT, 1).irradiance.max()
    kept = inner(raster)
    assert kept.mean() > 0.4
    pictures = [drawn(page), drawn(page, turn=75)]
    for degrees, shown in zip((0.0, 75.0), pictures, strict=True):
        light = sh.rotate(LIGHT, about_y(degrees))
        expected = [score.srgb_encode(np.clip(exposure * image, 0, 1)) for image in (net.draw(CAMERA, light), baked)]
        # 8 bits of the screen; and of the lightmap, whose steps are as wide
        for side, tolerance in ((0, 1.01), (1, 2.01)):
            found = shown[:, side * SIZE : (side + 1) * SIZE]
            assert expected[side][kept].std() > 0.1
            error = 255 * np.abs(found[kept] - expected[side][kept])
            assert np.mean(error < tolerance) > 0.995, np.percentile(error, [50, 90, 99])
    left, right = (np.abs(pictures[1] - pictures[0])[:, side : side + SIZE].max() for side in (0, SIZE))
    assert right == 0
    assert left > 0.1
    bright = drawn(page, exposure=2)
    assert bright.mean() > pictures[1].mean() + 0.02
    assert page.complaints() == []
    assert all(url.startswith((address, f"blob:{address}")) for url in page.requests())


@needs_chromium
def test_weights_in_a_texture_give_the_same_picture(tab):
    page, address = tab
    pictures = []
    for run in ("run", "weights"):
        page.goto(f"{address}/three/?run=/{run}")
        pictures.append(drawn(page))
    assert np.abs(pictures[1] - pictures[0]).max() < 1.01 / 255
    assert pictures[0].std() > 0.1


@needs_chromium
def test_the_page_orbits(tab):
    page, address = tab
    page.goto(f"{address}/three/?run=/run")
    page.evaluate("document.querySelectorAll('.side, #controls').forEach((e) => { e.style.visibility = 'hidden'; })")
    wait(page, "document.body.dataset.frames")
    before, frames = picture(page), page.evaluate("document.body.dataset.frames")
    for kind, x in (("mousePressed", 40), ("mouseMoved", 60), ("mouseReleased", 60)):
        page.send("Input.dispatchMouseEvent", type=kind, x=x, y=40, button="left", buttons=1, clickCount=1)
    wait(page, f"document.body.dataset.frames > {frames}")
    assert np.mean(np.any(picture(page) != before, axis=-1)) > 0.1


@needs_chromium
def test_a_run_that_is_not_there_is_said(site, tab):
    page, address = tab
    page.goto(f"{address}/three/?run=/nowhere")
    wait(page, "document.getElementById('message').textContent != 'loading'")
    assert "/nowhere/" in page.evaluate("document.getElementById('message').textContent")
    assert "404" in page.evaluate("document.getElementById('message').textContent")
    page.goto(f"{address}/three/?run=/blocks")
    wait(page, "document.getElementById('message').textContent.includes('export.storage=auto')")


@needs_node
def test_harmonics_and_turns_in_javascript(tmp_path):
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    light = rng.normal(size=(36, 3))
    (tmp_path / "given.json").write_text(json.dumps({"directions": directions.tolist(), "light": light.tolist()}))
    code = f"""
import {{ readFileSync }} from "node:fs";
import {{ evaluate, turnedAboutY }} from "{(EXAMPLE / "sh.js").as_uri()}";
const {{ directions, light }} = JSON.parse(readFileSync("given.json", "utf8"));
const turned = [1, 9, 25, 36].map((count) => turnedAboutY(light.slice(0, count), 50));
console.log(JSON.stringify({{ basis: directions.map((w) => evaluate(w, 6)), turned }}));
"""
    words = ["node", "--input-type=module", "-e", code]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    np.testing.assert_allclose(found["basis"], sh.evaluate(directions, 6), atol=1e-12)
    for count, turned in zip((1, 9, 25, 36), found["turned"], strict=True):
        np.testing.assert_allclose(turned, sh.rotate(light[:count], about_y(50)), atol=1e-12)


def test_the_example_stays_readable():
    assert len((EXAMPLE / "main.js").read_text().splitlines()) <= 150
    for file in EXAMPLE.glob("*.js"):
        assert max(map(len, file.read_text().splitlines())) <= 120, file
    assert all(part.isdigit() for part in VERSION.split(".")), "the version is pinned"
