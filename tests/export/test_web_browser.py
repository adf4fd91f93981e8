"""The page in Chromium: its pixels against NumPy's, and what hands and accidents do to it."""

import base64
import time

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from prtnet import netspec, score, sh
from prtnet.data import quantise
from prtnet.data.light import about_y
from prtnet.export import browser
from prtnet.export.browser import Browser
from prtnet.render.camera import Camera
from prtnet.render.gbuffer import shade
from prtnet.render.material import DIFFUSE, Material
from prtnet.render.method import TextureMethod
from prtnet.render.raster import Raster
from tests.export.pages import BANDS, LOOK, SIDE, over_atlas, small
from tests.export.test_web import HOSTILE
from tests.nets import random_points, random_uv

pytestmark = pytest.mark.skipif(browser.find() is None, reason="needs Chromium: apt-get install chromium")

SIZE = 96
STAGE = f"Object.assign(document.getElementById('stage').style, {{width: '{SIZE}px', height: '{SIZE}px'}})"
# what was there before each test
FRESH = """(async () => {
  const { viewer, controls } = prtnet;
  viewer.full = true;
  viewer.orbit.reset();
  const material = { diffuse: 1, specular: 0, exponent: 20, own: true };
  controls.set({ method: "net", light: 0, turn: 0, ev: 0, split: 0.5, ...material });
  await new Promise((resume) => requestAnimationFrame(() => requestAnimationFrame(resume)));
})()"""
PIXELS = """(() => {
  const { width, height, data } = prtnet.viewer.pixels();
  return [width, height, btoa(Array.from(data, (byte) => String.fromCharCode(byte)).join(""))];
})()"""


@pytest.fixture(scope="module")
def scene():
    return small()


@pytest.fixture(scope="module")
def opened(scene, tmp_path_factory):
    with Browser(size=(900, 600)) as found:
        found.goto(scene.write(tmp_path_factory.mktemp("page") / "page.html"))
        found.evaluate("prtnet.ready")
        found.evaluate(STAGE)
        yield found


@pytest.fixture
def page(opened):
    opened.evaluate(FRESH)
    return opened


@pytest.fixture(scope="module")
def raster(scene):
    return Raster(scene.atlas, SIZE)


def start(page, address):
    """Open another page, as it is before each test."""
    page.goto(address)
    page.evaluate("prtnet.ready")
    page.evaluate(STAGE)
    page.evaluate(FRESH)


def pixels(page):
    width, height, data = page.evaluate(PIXELS)
    image = np.frombuffer(base64.b64decode(data), np.uint8).reshape(height, width, 4)
    return image[::-1, :, :3] / 255


def camera_of(page):
    eye = page.evaluate("prtnet.viewer.orbit.eye()")
    return Camera(tuple(eye), LOOK.target, fov_y=LOOK.fov)


def predicted(scene, raster, camera, *, light=0, turned=0.0, material=DIFFUSE):
    """The net's picture by NumPy, and where it is one: inside, away from edges, which the page smooths."""
    gbuffer = raster.gbuffer(camera)
    transfer = netspec.evaluate_unit(scene.net, gbuffer.positions.astype(np.float64), gbuffer.normals)
    chosen = scene.lights[light]
    coefficients = sh.rotate(chosen.coefficients, about_y(turned))
    image = shade(gbuffer, transfer, coefficients, material)
    return score.tone_map(image, chosen.exposure), inside(gbuffer)


def inside(gbuffer):
    faces = np.full(gbuffer.size**2, -1)
    faces[gbuffer.pixel] = gbuffer.part
    faces = faces.reshape(gbuffer.size, -1)
    same = faces >= 0
    for axis in (0, 1):
        for step in (-1, 1):
            same &= np.roll(faces, step, axis) == faces
    same[[0, -1]] = same[:, [0, -1]] = False
    return same


def assert_alike(found, expected, where):
    assert where.mean() > 0.3
    error = np.abs(found - expected)[where]
    assert np.percentile(error, 95) < 2.5 / 255
    assert np.median(error) < 0.8 / 255


def test_the_net_gives_what_numpy_gives(page, scene):
    positions, normals = random_points(50, seed=3)
    call = "prtnet.evaluate(new Float32Array({}), new Float32Array({}))"
    found = page.evaluate(f"Array.from({call.format(positions.ravel().tolist(), normals.ravel().tolist())})")
    expected = netspec.evaluate_unit(scene.net, positions.astype(np.float64), normals)
    np.testing.assert_allclose(np.reshape(found, (50, -1))[:, : BANDS**2], expected, atol=1e-5)
    facts = page.evaluate("prtnet.certify()")
    assert facts["points"] == 1024
    assert 0 < facts["error_mean"] < facts["error_max"] < 1e-5
    assert "SwiftShader" in facts["device"]


def test_a_planted_error_is_found(page):
    page.evaluate("prtnet.renderer.model.checks.expected[100] += 0.5")
    assert page.evaluate("prtnet.certify().error_max") == pytest.approx(0.5, abs=1e-3)
    page.evaluate("prtnet.renderer.model.checks.expected[100] -= 0.5")
    page.evaluate("window.was = prtnet.renderer.model.checks.expected[100]")
    page.evaluate("prtnet.renderer.model.checks.expected[100] = NaN")
    assert page.evaluate("prtnet.certify().error_max") is None
    page.evaluate("prtnet.renderer.model.checks.expected[100] = window.was")


@pytest.mark.parametrize("degrees", [0, 37, 270])
def test_lights_turn_as_numpy_turns_them(page, scene, degrees):
    light = scene.lights[1].coefficients
    found = page.evaluate(f"prtnet.turned(prtnet.about.lights[1].coefficients, {degrees})")
    np.testing.assert_allclose(found, sh.rotate(light, about_y(degrees)), atol=1e-5)


def test_pixels_of_the_net(page, scene, raster):
    assert_alike(pixels(page), *predicted(scene, raster, camera_of(page)))


def test_pixels_of_the_texture(page, scene, raster):
    page.evaluate("prtnet.controls.set({ method: 'texture' })")
    method = TextureMethod(raster, scene.pages, texels="uint8")
    drawn = method.draw(camera_of(page), scene.lights[0].coefficients)
    _, where = predicted(scene, raster, camera_of(page))
    assert_alike(pixels(page), score.tone_map(drawn, scene.lights[0].exposure), where)


def test_texels_and_their_borders(page, scene):
    """As Python dilates them, but that the page blends bytes: one step at most."""
    image = "prtnet.renderer.model.pages[0].images[{}]"
    found = [np.array(page.evaluate(f"Array.from({image.format(layer)})")) for layer in range(3)]
    # rows come from the bottom up
    found = np.concatenate([each.reshape(SIDE, SIDE, 4)[::-1] for each in found], axis=2)[..., : BANDS**2]
    expected = quantise.encode(scene.pages[0].levels, scene.pages[0].used, "uint8").levels[0].astype(int)
    near = binary_dilation(scene.pages[0].used, np.ones((3, 3), bool))
    assert np.array_equal(found[scene.pages[0].used], expected[scene.pages[0].used])
    assert np.abs(found - expected)[near].max() <= 1
    assert near.sum() > scene.pages[0].used.sum()


def test_gloss(page, scene, raster):
    page.evaluate("prtnet.controls.set({ specular: 0.6, diffuse: 0.3, exponent: 12 })")
    material = Material(0.3, (0.6, 0.6, 0.6), 12.0)
    assert_alike(pixels(page), *predicted(scene, raster, camera_of(page), material=material))


def test_the_slider_turns_the_light_as_numpy_says(page, scene, raster):
    before = pixels(page)
    slide = "const s = document.getElementById('turn'); s.value = 120; "
    page.evaluate(slide + "s.dispatchEvent(new Event('input', { bubbles: true }))")
    expected, where = predicted(scene, raster, camera_of(page), turned=120.0)
    after = pixels(page)
    assert_alike(after, expected, where)
    page.evaluate("prtnet.controls.act('l')")
    assert_alike(pixels(page), *predicted(scene, raster, camera_of(page), light=1, turned=120.0))
    assert np.abs(after - before)[where].mean() > 2 / 255


def test_a_drag_goes_round(page, scene, raster):
    before, eye = pixels(page), np.array(page.evaluate("prtnet.viewer.orbit.eye()"))
    drag(page, "view", (0.5, 0.5), (0.75, 0.5))
    found = np.array(page.evaluate("prtnet.viewer.orbit.eye()"))
    np.testing.assert_allclose(found, about_y(-45) @ eye, atol=0.02)
    assert_alike(pixels(page), *predicted(scene, raster, camera_of(page)))
    assert np.abs(pixels(page) - before).mean() > 5 / 255


def test_wheel_and_fingers_zoom(page):
    far = page.evaluate("prtnet.viewer.orbit.distance")
    x, y = place(page, "view", (0.5, 0.5))
    page.send("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-100)
    near = page.evaluate("prtnet.viewer.orbit.distance")
    assert near == pytest.approx(far * np.exp(-0.15), rel=1e-3)
    for kind, apart in (("touchStart", 10), ("touchMove", 20), ("touchEnd", None)):
        points = [] if apart is None else [{"x": x - apart, "y": y, "id": 0}, {"x": x + apart, "y": y, "id": 1}]
        page.send("Input.dispatchTouchEvent", type=kind, touchPoints=points)
    assert page.evaluate("prtnet.viewer.orbit.distance") == pytest.approx(near / 2, rel=0.05)


def test_the_bar_parts_the_two(page):
    net = pixels(page)
    page.evaluate("prtnet.controls.set({ method: 'texture' })")
    texture = pixels(page)
    page.evaluate("prtnet.controls.set({ method: 'split' })")
    drag(page, "bar", (0.5, 0.3), (0.5 - 0.25 * SIZE / 32, 0.3))
    share = page.evaluate("prtnet.viewer.state.split")
    assert share == pytest.approx(0.25, abs=0.03)
    split, column = pixels(page), round(share * SIZE)
    np.testing.assert_allclose(split[:, :column], net[:, :column], atol=1.01 / 255)
    np.testing.assert_allclose(split[:, column:], texture[:, column:], atol=1.01 / 255)
    assert np.abs(net - texture).max() > 0.1


def test_the_error_is_eight_times_the_difference(page, scene, raster):
    pictures = []
    for method in ("net", "texture", "error"):
        page.evaluate(f"prtnet.controls.set({{ method: '{method}' }})")
        pictures.append(pixels(page))
    net, texture, error = pictures
    _, where = predicted(scene, raster, camera_of(page))
    expected = np.clip(8 * np.abs(net - texture), 0, 1)
    # each of the two was rounded to 1/255
    assert np.percentile(np.abs(error - expected)[where], 95) < 8.6 / 255
    assert expected[where].mean() > 0.05


def test_what_stands_still_is_not_drawn(page):
    time.sleep(0.3)
    before = page.evaluate("prtnet.viewer.frames")
    time.sleep(0.6)
    assert page.evaluate("prtnet.viewer.frames") == before
    page.evaluate("prtnet.controls.set({ ev: 1 })")
    time.sleep(0.3)
    assert page.evaluate("prtnet.viewer.frames") == before + 1


def test_keys(page):
    def press(key):
        page.evaluate(f"document.dispatchEvent(new KeyboardEvent('keydown', {{ key: {key!r} }}))")

    press("2")
    assert page.evaluate("prtnet.viewer.state.method") == "texture"
    assert page.evaluate("document.querySelector('[name=method]:checked').value") == "texture"
    press("]")
    press("]")
    assert page.evaluate("prtnet.viewer.state.turn") == 20
    press("?")
    assert page.evaluate("document.getElementById('help').open")
    page.evaluate("document.getElementById('help').close()")
    press("g")
    assert page.evaluate("document.getElementById('specular').value") == "0.5"
    assert page.evaluate("document.querySelector('output[for=specular]').textContent") == "0.50"


def test_dense_screens_get_all_their_pixels(page):
    page.resize((900, 600), 2)
    assert pixels(page).shape == (2 * SIZE, 2 * SIZE, 3)
    page.resize((900, 600), 1)
    assert pixels(page).shape == (SIZE, SIZE, 3)


@pytest.mark.parametrize("size", [(400, 800), (1280, 720), (320, 480)])
def test_controls_leave_the_picture_free(page, size):
    page.evaluate("document.getElementById('stage').removeAttribute('style')")
    page.resize(size, 1)
    boxes = [(*place(page, name, (0, 0)), *place(page, name, (1, 1))) for name in ("view", "controls")]
    page.resize((900, 600), 1)
    page.evaluate(STAGE)
    (left, top, right, bottom), (first, above, _, _) = boxes
    assert above >= bottom or first >= right
    assert left >= 0
    assert right <= size[0]
    assert right - left > 0.6 * size[0]
    assert 0 <= top < bottom <= size[1]
    assert (bottom - top) * (right - left) > 0.35 * size[0] * size[1]


def test_a_lost_context_comes_back(page):
    before = pixels(page)
    page.evaluate("window.taken = prtnet.renderer.gl.getExtension('WEBGL_lose_context'); taken.loseContext()")
    time.sleep(0.2)
    assert page.evaluate("document.getElementById('message').hidden") is False
    page.evaluate("taken.restoreContext()")
    time.sleep(0.5)
    assert page.evaluate("document.getElementById('message').hidden")
    np.testing.assert_array_equal(pixels(page), before)


def test_hostile_names_do_nothing(scene, tmp_path, opened):
    address = scene.write(tmp_path / "hostile.html", title=HOSTILE)
    opened.goto(address)
    opened.evaluate("prtnet.ready")
    assert opened.evaluate("window.hacked === undefined && Boolean(prtnet.certify)")
    title = opened.evaluate("document.querySelector('h1').textContent")
    assert title.replace("\r", "\n") == HOSTILE.replace("\r", "\n")


def test_the_console_is_clean_and_nothing_leaves(opened):
    # last: all that the page did before
    assert [text for text in opened.complaints() if "context" not in text.lower()] == []
    assert {address.split(":")[0] for address in opened.requests()} <= {"file", "data", "blob"}
    assert len(opened.requests()) <= 4


def test_light_between_surfaces(tmp_path, opened, raster):
    lit = small(groups=4)
    start(opened, lit.write(tmp_path / "groups.html"))
    gbuffer = raster.gbuffer(camera_of(opened))
    transfer = netspec.evaluate_unit(lit.net, gbuffer.positions.astype(np.float64), gbuffer.normals)
    image = shade(gbuffer, transfer, lit.lights[0].coefficients, groups=4)
    assert_alike(pixels(opened), score.tone_map(image, lit.lights[0].exposure), inside(gbuffer))
    assert opened.evaluate("prtnet.certify().error_max") < 1e-5


def test_a_net_with_features_over_an_atlas_of_its_own(tmp_path, opened):
    made = over_atlas()
    start(opened, made.write(tmp_path / "texels.html"))
    drawing = Raster(made.net_atlas, SIZE)
    gbuffer = drawing.gbuffer(camera_of(opened))
    transfer = netspec.evaluate_unit(made.net, gbuffer.positions.astype(np.float64), gbuffer.normals, uv=gbuffer.uv)
    image = shade(gbuffer, transfer, made.lights[0].coefficients)
    assert_alike(pixels(opened), score.tone_map(image, made.lights[0].exposure), inside(gbuffer))
    positions, normals, uv = *random_points(50, seed=3), random_uv(50)
    values = ", ".join(f"new Float32Array({each.ravel().tolist()})" for each in (positions, normals, uv))
    found = opened.evaluate(f"Array.from(prtnet.evaluate({values}))")
    expected = netspec.evaluate_unit(made.net, positions.astype(np.float64), normals, uv=uv)
    np.testing.assert_allclose(np.reshape(found, (50, -1))[:, : BANDS**2], expected, atol=1e-5)
    assert opened.evaluate("prtnet.certify().error_max") < 1e-5


def test_weights_in_a_texture(scene, tmp_path, opened):
    start(opened, scene.write(tmp_path / "weights.html", storage="texture"))
    assert "prt_weights" in [each["name"] for each in opened.evaluate("prtnet.about.images")]
    assert opened.evaluate("prtnet.certify().error_max") < 1e-5
    where = inside(Raster(scene.atlas, SIZE).gbuffer(camera_of(opened)))
    assert pixels(opened)[where].std() > 0.05


def test_a_texture_for_each_part(tmp_path, opened):
    parts = small(sets=True)
    assert len(parts.pages) > 2
    start(opened, parts.write(tmp_path / "parts.html"))
    opened.evaluate("prtnet.controls.set({ method: 'texture' })")
    drawing = Raster(parts.atlas, SIZE)
    drawn = TextureMethod(drawing, parts.pages, texels="uint8").draw(camera_of(opened), parts.lights[0].coefficients)
    where = inside(drawing.gbuffer(camera_of(opened)))
    assert_alike(pixels(opened), score.tone_map(drawn, parts.lights[0].exposure), where)


def test_without_webgl_the_page_says_so(scene, tmp_path):
    with Browser("--disable-3d-apis", size=(400, 800)) as found:
        found.goto(scene.write(tmp_path / "page.html"))
        found.evaluate("prtnet.ready")
        assert "WebGL 2" in found.evaluate("document.getElementById('message').innerText")
        assert found.evaluate("document.querySelector('[name=turn]').disabled")


def place(page, name, share):
    """A point of an element, in CSS pixels of the window."""
    box = page.evaluate(
        f"(({{left, top, width, height}}) => [left, top, width, height])"
        f"(document.getElementById('{name}').getBoundingClientRect())"
    )
    return box[0] + share[0] * box[2], box[1] + share[1] * box[3]


def drag(page, name, start, end):
    begun, ended = place(page, name, start), place(page, name, end)
    for kind, (x, y), held in (("mousePressed", begun, 1), ("mouseMoved", ended, 1), ("mouseReleased", ended, 0)):
        page.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=held, clickCount=1)
