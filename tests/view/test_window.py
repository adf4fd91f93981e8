"""The window itself, on a screen that nobody sees, and what is said where there is none."""

import importlib.util
import os
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
from PIL import Image

from prtnet import PrtnetError, gl
from prtnet.pipeline import run
from prtnet.view import window
from tests.pipeline.test_pipeline import config
from tests.small import overrides
from tests.view.test_picture import Made

MISSING = [f"{name}: apt-get install {name.lower()}" for name in ("Xvfb", "xdotool") if shutil.which(name) is None]
if importlib.util.find_spec("moderngl_window") is None:
    MISSING.append("moderngl-window: pip install prtnet[viewer]")
SECONDS = 300  # to wait for anything, on a busy machine

CHANGES = {"methods": ["texture", "net"], "light__name": "gradient"}


class Screen:
    """A virtual screen with a window of the command line on it."""

    def __init__(self, out):
        self.out = out
        # Xvfb looks for a free number and tells it
        self.server = subprocess.Popen(
            ["Xvfb", "-noreset", "-displayfd", "1", "-screen", "0", "1280x1024x24", "-nolisten", "tcp"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self.server.stdout is not None
        self.environment = os.environ | {"DISPLAY": f":{self.server.stdout.readline().strip()}"}
        arguments = overrides(out, stages="[view]", **CHANGES | {"methods": "[texture,net]"})
        with (out / "log").open("w") as log:
            self.viewer = subprocess.Popen(
                [sys.executable, "-m", "prtnet", *arguments], env=self.environment, stdout=log, stderr=log
            )

    def end(self):
        for process in (self.viewer, self.server):
            process.kill()
            process.wait()
        assert self.server.stdout is not None
        self.server.stdout.close()

    def tell(self, *words: str) -> str:
        done = subprocess.run(["xdotool", *words], env=self.environment, capture_output=True, text=True, check=False)
        return done.stdout.strip()

    def until(self, what):
        """The first true value of what is called again and again."""
        deadline = time.monotonic() + SECONDS
        while not (found := what()):
            assert self.viewer.poll() is None, (self.out / "log").read_text()
            assert time.monotonic() < deadline, (self.out / "log").read_text()
            time.sleep(0.05)
        return found

    def window(self) -> str:
        return self.until(lambda: self.tell("search", "--name", "prtnet cornell"))

    def titled(self, *words: str) -> str:
        """The title, once it has these words and the frame is drawn."""

        def title():
            found = self.tell("getwindowname", self.window())
            return found if found.endswith(" ms") and all(word in found for word in words) else ""

        return self.until(title)

    def press(self, key: str, *words: str) -> str:
        self.tell("key", "--window", self.window(), key)
        return self.titled(*words)

    def shot(self, number: int) -> np.ndarray:
        self.tell("key", "--window", self.window(), "p")
        file = self.out / f"view_{number}.png"
        self.until(file.exists)
        return np.asarray(Image.open(file), np.float32) / 255


@pytest.fixture
def screen(tmp_path):
    found = Screen(tmp_path)
    yield found
    found.end()


@pytest.mark.skipif(bool(MISSING), reason=f"a window needs {'; '.join(MISSING)}")
def test_a_window_shows_what_is_drawn_without_one(screen):
    title = screen.titled("net", "diffuse", "gradient")
    assert title.startswith("prtnet cornell · net · diffuse · gradient · ")
    made = Made(screen.out, **CHANGES)
    state, by = made.state(), made.picture()

    def same(shown: np.ndarray) -> None:
        made.target = gl.target(shown.shape[1], shown.shape[0])
        # a window has 8 bits
        assert np.abs(made.drawn(state, by) - shown).max() < 1.01 / 255

    first = screen.shot(1)
    assert first.shape == (window.SIZE[1], window.SIZE[0], 3)
    assert len(np.unique(first)) > 20
    same(first)
    for key, words in (("1", ["texture"]), ("g", ["glossy"]), ("bracketright", ["exponents x 1.41"]), ("l", ["sky"])):
        screen.press(key, *words)
        state.key({"bracketright": "]"}.get(key, key.upper()))
    same(screen.shot(2))
    screen.press("Right", "turned 5")
    state.key("RIGHT")
    screen.press("h")
    state.key("H")
    same(screen.shot(3))
    screen.tell(
        "mousemove", "--window", screen.window(), "300", "200", "mousedown", "1", "mousemove_relative", "40", "9"
    )
    screen.tell("mouseup", "1")
    screen.tell("windowsize", "--sync", screen.window(), "500", "640")
    screen.press("h")
    screen.press("e", "8 x error")
    screen.press("e")
    state.key("H")
    state.drag("left", 40, 9, 720)
    turned = screen.shot(4)
    assert turned.shape == (640, 500, 3)
    same(turned)
    screen.tell("key", "--window", screen.window(), "Escape")
    assert screen.viewer.wait(SECONDS) == 0


@pytest.mark.parametrize("name", [None, ":9999"])
def test_without_a_screen_nothing_is_begun(tmp_path, monkeypatch, name):
    """Whether moderngl-window is there or not."""
    monkeypatch.setattr(window.importlib.util, "find_spec", lambda package: package)
    monkeypatch.delenv("DISPLAY", raising=False)
    if name:
        monkeypatch.setenv("DISPLAY", name)
    found = f"found DISPLAY={name}, where no X server answers" if name else "found no DISPLAY, expected an X server"
    with pytest.raises(PrtnetError, match=f"{found}.*xvfb-run prtnet|libX11"):
        run(config(tmp_path, stages=["view"]))
    assert not list(tmp_path.iterdir())


def test_without_the_extra_the_line_to_type_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(window.importlib.util, "find_spec", lambda package: None)
    with pytest.raises(PrtnetError, match=r"pip install prtnet\[viewer\]"):
        run(config(tmp_path, stages=["bake", "view"]))
    assert not list(tmp_path.iterdir())
