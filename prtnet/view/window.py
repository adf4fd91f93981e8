"""The window: hands keys and the mouse on to a state, and draws it when it has changed."""

import ctypes
import ctypes.util
import importlib.util
import logging
import os
import sys
import time
from collections.abc import Callable
from copy import copy
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
from PIL import Image

from prtnet import PrtnetError, gl, store
from prtnet.view.picture import Picture, Show
from prtnet.view.state import State

log = logging.getLogger(__name__)

SIZE = (960, 720)
PAUSE = 1 / 120  # seconds between looks at the keys
HELD = 0.35  # seconds after which an arrow that is held down goes on
ARROWS = ("LEFT", "RIGHT", "UP", "DOWN")
NAMES = {"BRACKETLEFT": "[", "BRACKETRIGHT": "]", "BRACELEFT": "[", "BRACERIGHT": "]", "ESCAPE": "Esc"}


def check() -> None:
    """Raises PrtnetError where no window can be opened: before any work is done for it."""
    if importlib.util.find_spec("moderngl_window") is None:
        raise PrtnetError("stages=[view]: found no moderngl-window, which opens windows: pip install prtnet[viewer]")
    if not sys.platform.startswith("linux"):
        return
    name = os.environ.get("DISPLAY")
    advice = "run it where a screen is (DISPLAY=:0, ssh -X), or on one that nobody sees: xvfb-run prtnet ..."
    if not name:
        raise PrtnetError(f"stages=[view]: found no DISPLAY, expected an X server (of Wayland: Xwayland); {advice}")
    library = ctypes.util.find_library("X11")
    if library is None:
        raise PrtnetError("stages=[view]: found no libX11, which windows need: apt-get install libx11-6")
    x11 = ctypes.CDLL(library)
    x11.XOpenDisplay.restype, x11.XCloseDisplay.argtypes = ctypes.c_void_p, [ctypes.c_void_p]
    display = x11.XOpenDisplay(None)
    if not display:
        raise PrtnetError(f"stages=[view]: found DISPLAY={name}, where no X server answers; {advice}")
    x11.XCloseDisplay(display)


def run(title: str, show: Callable[[], Show], state: State, folder: Path) -> None:
    """Open the window and stay until it is closed. `show` is called when it is open; screenshots go to `folder`.

    Raises PrtnetError where no window with OpenGL 3.3 can be opened.
    """
    opened: list[Any] = []

    def open_window() -> moderngl.Context:
        opened.append(_open(title))
        return opened[0].ctx

    with gl.adopted(open_window):
        window = opened[0]
        scale = window.buffer_width / window.width
        Viewer(window, Picture(show(), scale=scale), state, title, folder).loop()
        window.close()


def _open(title: str) -> Any:
    """A window of moderngl-window, by pyglet. Imported here: both look for a display as soon as they are."""
    try:
        import pyglet  # pyright: ignore[reportMissingImports]

        # it would be a second context
        pyglet.options["shadow_window"] = False
        from moderngl_window.context.pyglet.window import Window  # pyright: ignore[reportMissingImports]

        made = Window(title=title, size=SIZE, gl_version=(3, 3), resizable=True, vsync=False, samples=0)
    except Exception as error:  # pyglet raises what the platform raises
        raise PrtnetError(
            f"stages=[view]: no window could be opened ({type(error).__name__}: {error}); "
            "expected a screen whose driver has OpenGL 3.3"
        ) from error
    made.exit_key = None
    return made


class Viewer:
    """An open window that shows a state."""

    def __init__(self, window: Any, picture: Picture, state: State, title: str, folder: Path):
        from pyglet.window import key  # pyright: ignore[reportMissingImports]

        self._window, self._picture, self.state, self._title, self._folder = window, picture, state, title, folder
        self._name_of, self._drawn, self._held = key.symbol_string, None, {}
        window.key_event_func = self._on_key
        window.mouse_position_event_func = lambda x, y, dx, dy: self._on_mouse(x)
        window.mouse_drag_event_func = self._on_drag
        window.mouse_scroll_event_func = lambda dx, dy: self.state.scroll(dy)
        # arrows that are let go over another window would turn on and on
        window._window.push_handlers(on_expose=self._on_expose, on_deactivate=self._held.clear)

    def loop(self) -> None:
        """Until the window is closed."""
        while not self._window.is_closing:
            self._window._window.dispatch_events()
            for name, since in self._held.items():
                if time.monotonic() - since > HELD:
                    self.state.key(name)
            if self._window.is_closing:
                break
            # a window that is put away may have no pixels
            if self._now() == self._drawn or min(self._window.buffer_size) < 1:
                time.sleep(PAUSE)
            else:
                self._draw()
                self._window._window.flip()

    def _now(self) -> Any:
        """All that the window shows."""
        shown = copy(self.state)
        if not shown.split:
            shown.mouse = 0.0
        return shown, self._window.buffer_size

    def _draw(self) -> None:
        if not self._picture.ready(self.state):
            self._window.title = f"{self._title} · {self.state.words()} · is being made"
        drawn = self._now()
        self._picture.draw(self.state, gl.screen(*self._window.buffer_size))
        self._drawn = drawn
        self._window.title = f"{self._title} · {self.state.words()} · {self._picture.milliseconds:.1f} ms"

    def _on_key(self, symbol: int, action: Any, modifiers: Any) -> None:
        word = str(self._name_of(symbol)).removeprefix("NUM_").removeprefix("_")
        name = NAMES.get(word, word)
        if action == self._window.keys.ACTION_RELEASE:
            self._held.pop(name, None)
        elif name == "Esc":
            self._window.is_closing = True
        elif name == "P":
            self.screenshot()
        else:
            self.state.key(name)
            if name in ARROWS:
                self._held[name] = time.monotonic()

    def _on_mouse(self, x: int) -> None:
        self.state.mouse = x / self._window.width

    def _on_drag(self, x: int, y: int, right: int, down: int) -> None:
        held = self._window.mouse_states
        button = "right" if held.right else "middle" if held.middle or self._window.modifiers.shift else "left"
        self.state.drag(button, right, down, self._window.height)
        self._on_mouse(x)

    def _on_expose(self) -> None:
        # something lay over the window
        self._drawn = None

    def screenshot(self) -> Path:
        """What the window shows, as view_1.png, view_2.png, ... in the run's folder."""
        self._draw()
        image = gl.screen(*self._window.buffer_size).read()[..., :3]
        taken = {path.name for path in self._folder.glob("view_*.png")}
        path = next(path for number in range(1, len(taken) + 2) if (path := self._file(number)).name not in taken)
        with store.atomic(path) as temporary:
            Image.fromarray(np.rint(255 * image).astype(np.uint8)).save(temporary, format="PNG")
        log.info("screenshot: %s", path)
        return path

    def _file(self, number: int) -> Path:
        return self._folder / f"view_{number}.png"
