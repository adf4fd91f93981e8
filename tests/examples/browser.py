"""A headless Chromium for tests, over the pipe of its DevTools protocol: no port, no driver, no package.

Pages come from a folder over HTTP on the loopback interface; everything that leaves it would be seen in `requests`.
"""

import base64
import fcntl
import io
import json
import os
import select
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--remote-debugging-pipe",
    "--disable-dev-shm-usage",
]
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a folder on loopback."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


class Page:
    """One tab. `console` and `requests` hold what it has said and asked for."""

    def __init__(self, send: int, receive: int):
        self._send, self._receive, self._rest, self._last = send, receive, b"", 0
        self.session: str | None = None
        self._loaded = False
        self.console: list[str] = []
        self.requests: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, *, seconds: float = 60, **params: Any) -> dict[str, Any]:
        """The result of a method of the protocol."""
        self._last += 1
        own = {"sessionId": self.session} if self.session else {}
        message = json.dumps({"id": self._last, "method": method, "params": params} | own)
        os.write(self._send, message.encode() + b"\0")
        end = time.monotonic() + seconds
        while True:
            found = self._next(end)
            if found.get("id") == self._last:
                assert "error" not in found, (method, found["error"])
                return found["result"]

    def _next(self, end: float) -> dict[str, Any]:
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._receive], [], [], max(0, end - time.monotonic()))
            content = os.read(self._receive, 1 << 20) if ready else b""
            assert content, f"chromium says nothing; the page said {self.console}"
            self._rest += content
        text, _, self._rest = self._rest.partition(b"\0")
        found = json.loads(text)
        params = found.get("params", {})
        if found.get("method") == "Runtime.consoleAPICalled":
            said = " ".join(str(each.get("value", each.get("description"))) for each in params["args"])
            self.console.append(f"{params['type']}: {said}")
        elif found.get("method") == "Runtime.exceptionThrown":
            self.console.append(f"exception: {params['exceptionDetails']}")
        elif found.get("method") == "Log.entryAdded":
            self.console.append(f"{params['entry']['level']}: {params['entry']['text']}")
        elif found.get("method") == "Page.loadEventFired":
            self._loaded = True
        elif found.get("method") == "Network.requestWillBeSent":
            self.requests.append(params["request"]["url"])
        return found

    def open(self, url: str, width: int, height: int) -> None:
        """A page in a window of this size, loaded with all that its text names."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self._loaded = False
        self.call("Page.navigate", url=url)
        end = time.monotonic() + 60
        while not self._loaded:
            self._next(end)

    def evaluate(self, expression: str) -> Any:
        """The value of an expression of JavaScript, awaited where it is a promise."""
        found = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, expression: str, seconds: float = 60) -> None:
        """Until an expression is true."""
        end = time.monotonic() + seconds
        while not self.evaluate(f"Boolean({expression})"):
            assert time.monotonic() < end, f"{expression} did not come true; the page said {self.console}"
            time.sleep(0.02)

    def picture(self) -> np.ndarray:
        """What the tab shows, "h w 3", 0 to 255."""
        shot = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"))


@contextmanager
def browser(profile: Path) -> Iterator[Page]:
    """A tab of a Chromium with a profile of its own in a new folder, closed at the end."""
    assert CHROMIUM is not None
    (child_in, send), (receive, child_out) = os.pipe(), os.pipe()
    # it reads commands from 3 and writes answers to 4, which a shell makes of numbers that are surely others
    far = [fcntl.fcntl(number, fcntl.F_DUPFD_CLOEXEC, 10) for number in (child_in, child_out)]
    words = ["bash", "-c", f'exec "$@" 3<&{far[0]} 4>&{far[1]}', "bash", CHROMIUM, *FLAGS, f"--user-data-dir={profile}"]
    quiet = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(words, pass_fds=far, **quiet)
    for number in (child_in, child_out, *far):
        os.close(number)
    try:
        page = Page(send, receive)
        yield page
        page.session = None
        page.call("Browser.close")
        process.wait(20)
    finally:
        os.close(send)
        os.close(receive)
        if process.poll() is None:
            process.kill()
            process.wait()
