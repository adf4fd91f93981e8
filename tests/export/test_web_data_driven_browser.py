"""The page of data-driven transfer in Chromium: its numbers and pixels against those of NumPy, a lamp in hands."""

import time
from dataclasses import replace

import numpy as np
import pytest

from prtnet import data_driven, score
from prtnet.data import texture
from prtnet.data.bilinear import bilinear
from prtnet.data.lighting import direct
from prtnet.data.lighting.lamp import Lamp, Lighting
from prtnet.export import browser, lamps
from prtnet.export.browser import Browser
from prtnet.render.raster import Raster
from tests.export.driven_pages import ELEMENTS, LAMPS, POINTS, by_rays, made
from tests.export.test_web_browser import SIZE, STAGE, assert_alike, camera_of, drag, inside, pixels, place

pytestmark = pytest.mark.skipif(browser.find() is None, reason="needs Chromium: apt-get install chromium")

# what was there before each test
FRESH = """(async () => {
  const { viewer, controls } = prtnet;
  viewer.full = true;
  viewer.orbit.reset();
  controls.set({ light: 0, method: "learned", parts: "both", ev: 0, split: 0.5 });
  await new Promise((resume) => requestAnimationFrame(() => requestAnimationFrame(resume)));
})()"""


@pytest.fixture(scope="module")
def scene():
    return made()


@pytest.fixture(scope="module")
def opened(scene, tmp_path_factory):
    with Browser(size=(900, 600)) as found:
        start(found, scene.write(tmp_path_factory.mktemp("page") / "page.html"))
        yield found


@pytest.fixture
def page(opened):
    opened.evaluate(FRESH)
    return opened


@pytest.fixture(scope="module")
def raster(scene):
    return Raster(scene.atlas, SIZE)


def start(page, address):
    page.goto(address)
    page.evaluate("prtnet.ready")
    page.evaluate(STAGE)
    page.evaluate(FRESH)


def predicted(scene, raster, camera, lamp, *, parts=(1, 1), lightmap=None, radiance=False):
    """The picture by NumPy and rays, and where it is one: away from edges, those of shadows too."""
    gbuffer = raster.gbuffer(camera)
    received = direct.irradiance(
        Lighting((lamp,)), scene.tracer, gbuffer.positions.astype(np.float64), gbuffer.normals,
        gbuffer.geometric_normals,
    )  # fmt: skip
    spec = scene.spec
    if lightmap is None:
        lightmap = data_driven.indirect(spec, by_rays(scene.tracer, spec.measurements[0], lamp))
    image = texture.assemble(scene.texels, lightmap.astype(np.float32), dilation=2)
    between = np.maximum(bilinear(image, gbuffer.uv), 0)
    flat = np.zeros((SIZE * SIZE, 3))
    reflected = gbuffer.albedo / np.pi
    flat[gbuffer.pixel] = parts[0] * reflected * received + parts[1] * (1 if radiance else reflected) * between
    shadowed = np.zeros(SIZE * SIZE)
    shadowed[gbuffer.pixel] = received.max(axis=1) > 0
    edges = shadowed.reshape(SIZE, SIZE)
    same = inside(gbuffer)
    for axis in (0, 1):
        for step in (-1, 1):
            same &= np.roll(edges, step, axis) == edges
    return score.tone_map(flat.reshape(SIZE, SIZE, 3), 0.8), same


def words(lamp: Lamp) -> str:
    """As JavaScript."""
    fields = ("kind", "position", "aim", "colour", "inner", "outer")
    found = {name: getattr(lamp, name) for name in fields}
    return str({name: list(value) if isinstance(value, tuple) else value for name, value in found.items()})


def test_the_page_finds_what_numpy_and_rays_find(page):
    facts = page.evaluate("prtnet.certify()")
    assert (facts["lights"], facts["texels"]) == (3, 512)
    assert 0 < facts["errors"]["coefficients"] < 3e-6
    assert 0 < facts["errors"]["texels"] < 1e-3
    assert 0 < facts["errors"]["direct"] < 0.03
    assert 0 < facts["errors"]["shown"] < 0.03
    assert "SwiftShader" in facts["device"]


def test_planted_errors_are_found(page):
    planted = (("coefficients", "coefficients", 0.1), ("indirect", "texels", 0.1), ("direct", "direct", 0.3))
    for name, found, at_least in planted:
        plant = f"prtnet.renderer.model.checks.cases[1].{name}[4]"
        page.evaluate(f"window.before = {plant}; {plant} += 10")
        assert page.evaluate(f"prtnet.certify().errors.{found}") > at_least
        page.evaluate(f"{plant} = window.before")
    page.evaluate("prtnet.renderer.model.checks.cases[0].indirect[7] = NaN")
    assert page.evaluate("prtnet.certify().errors.texels") is None
    page.evaluate("prtnet.renderer.model.checks.cases[0].indirect[7] = 0")


@pytest.mark.parametrize(
    "lamp",
    [
        *LAMPS,
        Lamp("point", (1, 1, 1), position=(1.7, -1.2, 1.9)),
        Lamp("spot", (1, 1, 1), position=(0.1, 0.8, 0.0), aim=(0, -1, 0), inner=30, outer=70),
        Lamp("spot", (1, 1, 1), position=(0.1, 0.8, 0.0), aim=(0, -1, 0), inner=30, outer=40),
        Lamp("directional", (1, 1, 1), aim=(0.0, -1.0, 0.0)),
    ],
)
def test_shadow_matrices_are_those_of_numpy(page, scene, lamp):
    found = np.array(page.evaluate(f"prtnet.shadowMatrices({words(lamp)})")).reshape(-1, 4, 4)
    corners = scene.atlas.scene.vertices
    box = np.stack([corners.min(axis=0), corners.max(axis=0)])
    expected = lamps.shadow_matrices(lamp, box)
    assert len(found) == len(expected)
    # column by column
    np.testing.assert_allclose(np.swapaxes(found, 1, 2), expected, rtol=1e-5, atol=1e-5)
    uniforms = lamps.uniforms(Lighting((lamp,)), [expected], 1)
    for name, values in page.evaluate(f"prtnet.lampUniforms({words(lamp)})").items():
        np.testing.assert_allclose(values, uniforms[name][0], atol=1e-6)


@pytest.mark.parametrize("light", [0, 1, 2])
def test_pixels_under_each_kind_of_lamp(page, scene, raster, light):
    page.evaluate(f"prtnet.controls.set({{ light: {light} }})")
    assert_alike(pixels(page), *predicted(scene, raster, camera_of(page), LAMPS[light]))


def test_direct_and_indirect_light_alone(page, scene, raster):
    shown = {}
    for name, parts in (("direct", (1, 0)), ("indirect", (0, 1))):
        page.evaluate(f"prtnet.controls.set({{ parts: '{name}' }})")
        expected, where = predicted(scene, raster, camera_of(page), LAMPS[0], parts=parts)
        shown[name] = pixels(page)
        assert_alike(shown[name], expected, where)
    assert np.abs(shown["direct"] - shown["indirect"])[where].mean() > 0.05


def test_a_light_of_the_database_has_its_lightmap(page, scene, raster):
    page.evaluate("prtnet.controls.set({ light: 1, method: 'reference' })")
    expected, where = predicted(scene, raster, camera_of(page), LAMPS[1], lightmap=scene.lights[1].lightmap)
    reference = pixels(page)
    assert_alike(reference, expected, where)
    page.evaluate("prtnet.controls.set({ method: 'learned' })")
    learned = pixels(page)
    assert np.abs(learned - reference)[where].mean() > 0.03
    page.evaluate("prtnet.controls.set({ method: 'split', split: 0.25 })")
    split, column = pixels(page), SIZE // 4
    np.testing.assert_allclose(split[:, :column], learned[:, :column], atol=1.01 / 255)
    np.testing.assert_allclose(split[:, column:], reference[:, column:], atol=1.01 / 255)


def test_a_lamp_that_is_dragged(page, scene, raster):
    """It goes where the pointer goes, all light follows, and there is nothing to compare it with any more."""
    before, bars = pixels(page), page.evaluate("document.getElementById('bars').toDataURL()")
    width, height = (
        right - left for left, right in zip(place(page, "view", (0, 0)), place(page, "view", (1, 1)), strict=True)
    )
    x, y = place(page, "lamp", (0.5, 0.5))
    drag(page, "lamp", (0.5, 0.5), (0.5 - 0.3 * width / 26, 0.5 + 0.2 * height / 26))
    after = place(page, "lamp", (0.5, 0.5))
    np.testing.assert_allclose(after, (x - 0.3 * width, y + 0.2 * height), atol=1.5)
    state = page.evaluate("prtnet.viewer.state")
    assert (state["light"], state["method"]) == (-1, "learned")
    assert page.evaluate("document.querySelector('[name=method][value=split]').disabled")
    lamp = replace(LAMPS[0], position=tuple(state["position"]))
    assert np.linalg.norm(np.subtract(lamp.position, LAMPS[0].position)) > 0.3
    assert_alike(pixels(page), *predicted(scene, raster, camera_of(page), lamp))
    assert np.abs(pixels(page) - before).mean() > 5 / 255
    assert page.evaluate("document.getElementById('bars').toDataURL()") != bars


def test_a_lamp_beyond_the_picture_has_its_handle_at_the_edge(page):
    page.evaluate("prtnet.controls.move({ position: [-2, 0, 0] })")
    left, top, right, bottom = (*place(page, "lamp", (0, 0)), *place(page, "lamp", (1, 1)))
    edges = (*place(page, "stage", (0, 0)), *place(page, "stage", (1, 1)))
    assert (left, right) == pytest.approx((edges[0] + 2, edges[0] + 28), abs=1)
    assert edges[1] < top < bottom < edges[3]


def test_sliders_set_the_lamp(page, scene, raster):
    page.evaluate("prtnet.controls.set({ light: 1 })")
    for name, value in (("x", 0.2), ("to_y", -0.6), ("outer", 40)):
        event = "new Event('input', { bubbles: true })"
        page.evaluate(f"(({{ {name} }}) => {{ {name}.value = {value}; {name}.dispatchEvent({event}) }})(window)")
    state = page.evaluate("prtnet.viewer.state")
    aim = np.subtract(state["target"], state["position"])
    assert (state["position"][0], state["target"][1], state["outer"]) == (0.2, -0.6, 40)
    lamp = replace(
        LAMPS[1], position=tuple(state["position"]), aim=tuple(aim / np.linalg.norm(aim)), outer=40, inner=15 / 28 * 40
    )
    assert_alike(pixels(page), *predicted(scene, raster, camera_of(page), lamp))


def test_another_kind_of_lamp_is_as_bright(page):
    before = page.evaluate("prtnet.viewer.level()")
    for kind in ("directional", "point"):
        page.evaluate(f"prtnet.controls.set({{ kind: '{kind}' }})")
        assert page.evaluate("prtnet.viewer.level()") == pytest.approx(before, rel=1e-3)
    page.evaluate("prtnet.controls.act('e')")
    assert page.evaluate("prtnet.viewer.exposure * prtnet.viewer.level()") == pytest.approx(0.6, rel=1e-3)


def test_what_stands_still_is_not_drawn(page):
    time.sleep(0.3)
    before = page.evaluate("prtnet.viewer.frames")
    time.sleep(0.5)
    assert page.evaluate("prtnet.viewer.frames") == before
    page.evaluate("prtnet.controls.set({ position: [0, 0.5, 0.5] })")
    time.sleep(0.3)
    assert page.evaluate("prtnet.viewer.frames") == before + 1


def test_maps_are_drawn_for_a_lamp_that_moved_alone(page):
    count = """(() => {
      const { shadows } = prtnet.renderer, own = shadows.draw;
      let drawn = 0;
      shadows.draw = (lamp) => { drawn += 1; own.call(shadows, lamp); };
      %s;
      prtnet.viewer.draw();
      delete shadows.draw;
      return drawn;
    })()"""
    assert page.evaluate(count % "prtnet.viewer.orbit.turn(0.3, 0)") == 0
    assert page.evaluate(count % "prtnet.viewer.set({ position: [0, 0.1, 0.2] })") == 1


def test_keys(page):
    def press(key):
        page.evaluate(f"document.dispatchEvent(new KeyboardEvent('keydown', {{ key: {key!r} }}))")

    press("d")
    assert page.evaluate("document.querySelector('[name=parts]:checked').value") == "direct"
    press("l")
    assert page.evaluate("document.querySelector('[name=light]').value") == "1"
    press("3")
    assert page.evaluate("prtnet.viewer.state.method") == "split"
    press("l")
    # the third has no lightmap
    assert page.evaluate("[prtnet.viewer.state.light, prtnet.viewer.state.method]") == [2, "learned"]
    press("k")
    assert page.evaluate("[prtnet.viewer.state.light, prtnet.viewer.state.kind]") == [-1, "point"]
    press("t")
    assert float(page.evaluate("document.getElementById('lamp-ms').textContent")) > 0


def test_a_lost_context_comes_back(page):
    before = pixels(page)
    page.evaluate("window.taken = prtnet.renderer.gl.getExtension('WEBGL_lose_context'); taken.loseContext()")
    time.sleep(0.2)
    page.evaluate("taken.restoreContext()")
    time.sleep(0.5)
    assert page.evaluate("document.getElementById('message').hidden")
    np.testing.assert_array_equal(pixels(page), before)


@pytest.mark.parametrize(("banks", "gamma"), [(1, 1.0), (3, 1.0), (1, 2.2), (3, 2.2)])
def test_operator_and_blend_of_any_light(scene, opened, tmp_path, banks, gamma):
    """Direct vectors that no lamp makes, at every texel's centre."""
    other = made(banks=banks, gamma=gamma)
    opened.goto(other.write(tmp_path / "page.html"))
    opened.evaluate("prtnet.ready")
    spec, vector = other.spec, np.random.default_rng(banks).random((POINTS, 3)).astype(np.float32)
    row, column = np.divmod(spec.texels[::5], spec.size)
    uv = np.stack([column + 0.5, spec.size - row - 0.5], axis=1) / spec.size
    given = f"{{ direct: new Float32Array({vector.ravel().tolist()}), uv: new Float32Array({uv.ravel().tolist()}) }}"
    call = f"(({{ coefficients, indirect }}) => [[...coefficients], [...indirect]])(prtnet.evaluate({given}))"
    coefficients, indirect = (np.reshape(each, (-1, 3)) for each in opened.evaluate(call))
    expected = data_driven.coefficients(spec, vector)
    assert coefficients.shape == (ELEMENTS, 3)
    np.testing.assert_allclose(coefficients, expected, atol=1e-5 * np.abs(expected).max())
    light = np.maximum(data_driven.indirect(spec, vector)[::5], 0)
    np.testing.assert_allclose(indirect, light, atol=1e-3 * light.max())
    assert (light > 0.02 * light.max()).mean() > 0.5


def test_radiance_is_shown_as_it_is(opened, raster, tmp_path):
    other = made(quantity="radiance")
    start(opened, other.write(tmp_path / "page.html"))
    assert opened.evaluate("document.getElementById('parts').hidden")
    expected = predicted(other, raster, camera_of(opened), LAMPS[0], parts=(0, 1), radiance=True)
    assert_alike(pixels(opened), *expected)


def test_the_console_is_clean_and_nothing_leaves(opened):
    # last: all that the page did before; the driver's remark is on coefficients that are read for the bars
    remarks = ("context", "gpu stall due to readpixels")
    assert [text for text in opened.complaints() if not any(each in text.lower() for each in remarks)] == []
    assert {address.split(":")[0] for address in opened.requests()} <= {"file", "data", "blob"}
