"""A page in headless Chromium, driven by the DevTools protocol over a pipe: no driver, no port, no network.

Rendering is SwiftShader's, the same on every machine. What the page asks for, logs and throws is kept for whoever
wants to know (https://chromedevtools.github.io/devtools-protocol).
"""

import fcntl
import json
import os
import select
import shutil
import signal
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from prtnet import PrtnetError

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--remote-debugging-pipe",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    # containers give /dev/shm too little room
    "--disable-dev-shm-usage",
)
# where the protocol's pipe has its ends in the browser
READS, WRITES = 3, 4


def find() -> str | None:
    """The Chromium on the path, or None."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class NoBrowser(PrtnetError):
    """There is no Chromium, or it does not start."""


class Browser:
    """One page of a browser of its own; ends it at the end of a `with` block.

    `seconds` is how long each answer may take. Raises NoBrowser where there is none that starts, and PrtnetError
    where it does not answer.
    """

    def __init__(self, *flags: str, size: tuple[int, int] = (960, 600), scale: float = 1, seconds: float = 120):
        program = find()
        if program is None:
            raise NoBrowser("browser: found no Chromium, expected one on the path; apt-get install chromium")
        self.seconds = seconds
        self.events: list[dict[str, Any]] = []
        self._answers: dict[int, dict[str, Any]] = {}
        self._session, self._last, self._rest = "", 0, b""
        self._folder = tempfile.TemporaryDirectory(prefix="prtnet-browser", ignore_cleanup_errors=True)
        self._start(program, flags)
        try:
            self._open(size, scale)
        except BaseException as error:
            self.close()
            if isinstance(error, PrtnetError):
                raise NoBrowser(f"browser: found {program} not to start ({error}), expected one that does") from None
            raise

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the browser and everything it started."""
        with suppress(ProcessLookupError):
            os.killpg(self._process, signal.SIGKILL)
        with suppress(ChildProcessError):
            os.waitpid(self._process, 0)
        for end in (self._to, self._from):
            with suppress(OSError):
                os.close(end)
        self._folder.cleanup()

    def goto(self, url: str) -> None:
        """Open an address and wait until its scripts have run."""
        before = len(self.events)
        self.send("Page.navigate", url=url)
        loaded = "Page.loadEventFired"
        self._wait(lambda: any(event["method"] == loaded for event in self.events[before:]), f"load {url}")

    def evaluate(self, expression: str) -> Any:
        """What JavaScript gives, as JSON; promises are awaited. Raises PrtnetError with what it throws."""
        found = self.send("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in found:
            thrown = found["exceptionDetails"].get("exception", {}).get("description") or found["exceptionDetails"]
            raise PrtnetError(f"browser: the page threw {thrown}, expected {expression[:80]!r} to run")
        return found["result"].get("value")

    def send(self, method: str, **values: Any) -> dict[str, Any]:
        """One command of the protocol and its answer."""
        self._last += 1
        message: dict[str, Any] = {"id": self._last, "method": method, "params": values}
        if self._session:
            message["sessionId"] = self._session
        try:
            os.write(self._to, json.dumps(message).encode() + b"\0")
        except BrokenPipeError:
            raise PrtnetError(f"browser: found Chromium ended, expected it to answer {method}") from None
        own = self._last
        self._wait(lambda: own in self._answers, method)
        answer = self._answers.pop(own)
        if "error" in answer:
            raise PrtnetError(f"browser: {method}: found {answer['error'].get('message')}, expected a result")
        return answer.get("result", {})

    def told(self, method: str) -> list[dict[str, Any]]:
        """The events of one kind so far."""
        self._wait(lambda: True, method, patience=0)
        return [event["params"] for event in self.events if event["method"] == method]

    def complaints(self) -> list[str]:
        """Errors and warnings of the page's console, and what its scripts threw."""
        logged = [entry for entry in self.told("Runtime.consoleAPICalled") if entry["type"] in ("error", "warning")]
        texts = [" ".join(str(word.get("value")) for word in entry["args"]) for entry in logged]
        texts += [str(entry["exceptionDetails"]) for entry in self.told("Runtime.exceptionThrown")]
        entries = [entry["entry"] for entry in self.told("Log.entryAdded")]
        return texts + [entry["text"] for entry in entries if entry["level"] in ("error", "warning")]

    def requests(self) -> list[str]:
        """The addresses that the page asked for."""
        return [entry["request"]["url"] for entry in self.told("Network.requestWillBeSent")]

    def _start(self, program: str, flags: Sequence[str]) -> None:
        theirs_in, ours_out = os.pipe()
        ours_in, theirs_out = os.pipe()
        # out of the way of the two numbers that they get in the browser
        high_in, high_out = (fcntl.fcntl(end, fcntl.F_DUPFD, 16) for end in (theirs_in, theirs_out))
        actions = [(os.POSIX_SPAWN_DUP2, high_in, READS), (os.POSIX_SPAWN_DUP2, high_out, WRITES)]
        actions += [(os.POSIX_SPAWN_OPEN, end, os.devnull, os.O_RDWR, 0) for end in (0, 1, 2)]
        profile = f"--user-data-dir={Path(self._folder.name) / 'profile'}"
        arguments = [program, *FLAGS, *flags, profile, "about:blank"]
        environment = os.environ | {"HOME": self._folder.name}
        self._process = os.posix_spawn(program, arguments, environment, file_actions=actions, setpgroup=0)
        for end in (theirs_in, theirs_out, high_in, high_out):
            os.close(end)
        self._to, self._from = ours_out, ours_in

    def _open(self, size: tuple[int, int], scale: float) -> None:
        pages = [each for each in self.send("Target.getTargets")["targetInfos"] if each["type"] == "page"]
        found = self.send("Target.attachToTarget", targetId=pages[0]["targetId"], flatten=True)
        self._session = found["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")
        self.resize(size, scale)

    def resize(self, size: tuple[int, int], scale: float = 1, *, mobile: bool = False) -> None:
        """The window in CSS pixels and the screen's pixels per CSS pixel."""
        width, height = size
        self.send(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=mobile
        )

    def _wait(self, done: Any, what: str, patience: float | None = None) -> None:
        """Read until `done()`, or, with patience 0, what there is."""
        end = time.monotonic() + (self.seconds if patience is None else patience)
        while patience == 0 or not done():
            ready, _, _ = select.select([self._from], [], [], max(0.0, end - time.monotonic()))
            if not ready:
                if patience == 0:
                    return
                raise PrtnetError(f"browser: found no answer in {self.seconds:g} s, expected one to {what}")
            read = os.read(self._from, 1 << 20)
            if not read:
                raise PrtnetError(f"browser: found Chromium ended, expected it to answer {what}")
            self._take(read)

    def _take(self, read: bytes) -> None:
        *messages, self._rest = (self._rest + read).split(b"\0")
        for message in map(json.loads, messages):
            if "id" in message:
                self._answers[message["id"]] = message
            else:
                self.events.append(message)
