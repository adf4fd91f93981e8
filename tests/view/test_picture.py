"""Pictures of states, without a window."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import gl, score, sh
from prtnet.pipeline import run
from prtnet.pipeline.bake import bake
from prtnet.pipeline.drawn_by import DEFERRED
from prtnet.pipeline.export import export
from prtnet.pipeline.job import open_job
from prtnet.pipeline.methods import make_all
from prtnet.pipeline.train import train
from prtnet.pipeline.view import lights_of, show_of, state_of
from prtnet.render.camera import path
from prtnet.render.raster import Raster
from prtnet.view import picture
from prtnet.view.picture import Picture
from prtnet.view.text import help_image
from tests.pipeline.test_pipeline import config

WIDTH, HEIGHT = 72, 48


class Made:
    """A job with what its window would show."""

    def __init__(self, out, **changes):
        self.job = open_job(config(out, **changes), "", None)
        self.baked = bake(self.job)
        self.trained = train(self.job, self.baked.points) if self.baked.points else None
        self.exported = export(self.job, self.baked, self.trained)
        options = self.job.config
        self.cameras = path(self.job.scene, self.job.tracer, options.render.views, kind=options.scene.camera)
        self.lights = lights_of(self.job)
        self.target = gl.target(WIDTH, HEIGHT)

    def state(self):
        return state_of(self.job, self.cameras[0], self.lights)

    def picture(self) -> Picture:
        parts = (self.job, self.baked, self.trained, self.exported, self.cameras, self.lights)
        return Picture(show_of(*parts))

    def drawn(self, state, by: Picture | None = None) -> np.ndarray:
        (by or self.picture()).draw(state, self.target)
        return self.target.read()[..., :3]


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Made:
    return Made(tmp_path_factory.mktemp("run"), light__name="gradient")


def test_it_is_what_the_run_draws(made):
    """The middle of the wide frame is the square one that is scored, under the score's own tone map."""
    drawing = Raster(made.baked.texture.atlas, HEIGHT)
    methods = make_all(made.job, made.baked, made.trained, made.exported, drawing)
    by, state, light = made.picture(), made.state(), made.job.light.coefficients(3)
    textures = []
    for camera in made.cameras:
        textures.append((methods["texture"].shaded.draw(camera, light), drawing.faces(camera)[..., 0] > 0))
    for number, name in enumerate(("texture", "vertex", "net"), 1):
        state.key(str(number))
        method = methods[name].shaded
        if name == "vertex":
            method.raster.resize(HEIGHT, HEIGHT)
        wanted = method.draw(made.cameras[0], light)
        shown = made.drawn(state, by)[:, (WIDTH - HEIGHT) // 2 : (WIDTH + HEIGHT) // 2]
        exposure = score.exposure(*map(list, zip(*textures, strict=True)))
        off = np.abs(shown - score.tone_map(wanted, exposure))
        # outlines are cut anew in another frame
        assert np.percentile(off, 99) < 0.01, name
        assert off.mean() < 2e-3, name


def test_gloss_and_its_exponent_are_the_plain_ones(made):
    """By a program that is compiled once for all exponents."""
    by, state = made.picture(), made.state()
    for name in ("1", "G", "]", "]"):
        state.key(name)
    before = made.drawn(state, by)
    program = by._methods["texture", True].program
    sharp = replace(state, sharpness=6)
    assert np.abs(made.drawn(sharp, by) - before).mean() > 1e-3
    assert by._methods["texture", True].program is program
    np.testing.assert_allclose(made.drawn(sharp), made.drawn(sharp, by), atol=1e-6)
    glossy = {"diffuse": 0.5, "specular": [0.5] * 3, "exponent": 20.0 * 8, "product": "full"}
    changes = {f"material__{key}": value for key, value in glossy.items()}
    plain = Made(made.job.out, light__name="gradient", methods=["texture"], **changes)
    assert np.abs(plain.drawn(replace(sharp, sharpness=0)) - made.drawn(sharp)).max() < 0.1
    method = plain.picture()
    method._exposures = by._exposures
    np.testing.assert_allclose(plain.drawn(replace(sharp, sharpness=0), method), made.drawn(sharp, by), atol=1e-5)


def test_a_turned_light_is_the_light_turned(made):
    by, state = made.picture(), replace(made.state(), method="texture", tilt=120.0)
    shown, method = made.drawn(state, by), by._methods["texture", False]
    light = sh.rotate(made.job.light.coefficients(3), state.rotation()).astype(np.float32)
    wanted = score.tone_map(method.draw(by.camera(state), light), by._exposures[0, False])
    np.testing.assert_allclose(shown, wanted, atol=1e-5)
    assert np.abs(shown - made.drawn(replace(state, tilt=0.0), by)).mean() > 0.005


def test_split_and_error_are_against_the_texture(made):
    by, state = made.picture(), made.state()
    assert state.method == "net"
    net, texture = made.drawn(state, by), made.drawn(replace(state, method="texture"), by)
    split = made.drawn(replace(state, split=True, mouse=0.25), by)
    bar = WIDTH // 4
    np.testing.assert_array_equal(split[:, : bar - 1], net[:, : bar - 1])
    np.testing.assert_array_equal(split[:, bar + 1 :], texture[:, bar + 1 :])
    assert (split[:, bar] == 1).all()
    error = np.minimum(8 * np.abs(net - texture), 1)
    np.testing.assert_allclose(made.drawn(replace(state, error=True), by), error, atol=1e-5)
    both = made.drawn(replace(state, error=True, split=True, mouse=0.25), by)
    np.testing.assert_array_equal(both[:, : bar - 1], net[:, : bar - 1])
    np.testing.assert_allclose(both[:, bar + 1 :], error[:, bar + 1 :], atol=1e-5)


def test_the_help_lies_over_the_picture_with_its_first_line_on_top(made, monkeypatch):
    monkeypatch.setattr(picture, "help_image", lambda scale: np.float32([[[1, 0, 0, 1]] * 9, [[0, 0, 1, 0.5]] * 9]))
    plain, helped = made.drawn(made.state()), made.drawn(replace(made.state(), help=True))
    edge = picture.MARGIN
    np.testing.assert_array_equal(helped[edge, edge : edge + 9], [[1, 0, 0]] * 9)
    half = (plain[edge + 1, edge : edge + 9] + [0, 0, 1]) / 2
    np.testing.assert_allclose(helped[edge + 1, edge : edge + 9], half, atol=1e-6)
    helped[edge : edge + 2, edge : edge + 9] = plain[edge : edge + 2, edge : edge + 9]
    np.testing.assert_array_equal(helped, plain)


def test_help_scales_with_the_screen():
    small, large = help_image(), help_image(2.0)
    assert large.shape[0] == pytest.approx(2 * small.shape[0], rel=0.04)
    assert ((small >= 0) & (small <= 1)).all()
    assert (small[..., 0] == 1).any()


def test_only_what_has_changed_is_drawn(made, monkeypatch):
    by, state, drawn = made.picture(), replace(made.state(), method="texture"), []
    made.drawn(state, by)
    monkeypatch.setattr(by._methods["texture", False], "render", lambda camera: drawn.append(camera))
    for same in (state, replace(state, help=True), replace(state, mouse=0.1)):
        made.drawn(same, by)
    assert not drawn
    made.drawn(replace(state, orbit=state.orbit.zoomed(1)), by)
    assert len(drawn) == 1


def test_black_lights_are_black(made):
    by, state = made.picture(), replace(made.state(), method="texture")
    by.show.lights["gradient"][:] = 0
    assert not made.drawn(state, by).any()


def test_a_net_that_the_cpu_draws_is_shown(tmp_path):
    wide = Made(tmp_path, methods=["texture", "net"], render__net=DEFERRED, train__steps=2)
    assert wide.exported.drawn_by == DEFERRED
    state = wide.state()
    by = wide.picture()
    for name in ("2", "G", "]"):
        state.key(name)
        assert wide.drawn(state, by).any()
    assert by.milliseconds > 0


def test_more_bands_than_gloss_has_are_shown_without(tmp_path):
    many = Made(tmp_path, methods=["texture"], transfer__bands=9, transfer__directions=8)
    state = many.state()
    state.key("G")
    assert not state.glossy
    assert many.drawn(state).any()


def test_no_stage_opens_a_window_unasked(tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    assert "view" not in config(tmp_path).stages
    run(config(tmp_path, stages=["bake"], methods=["texture"]))
