"""Screenshots of the page and of the viewer of one run, as their users see them.

    python experiments/exports/pictures.py runs/exports_page experiment=exports ablation=none ...

opens RUN/page.html in headless Chromium, as wide as a desktop and as a phone, and `prtnet KEYS stages=[view] out=RUN`,
with the KEYS of the run, on a screen that nobody sees (Xvfb, xdotool). Writes page.png, phone.png and viewer.png, at
most 300 kB each, into experiments/exports/results/.
"""

import base64
import io
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from PIL import Image

from prtnet import PrtnetError
from prtnet.export.browser import Browser
from prtnet.pipeline import web

RESULTS = Path(__file__).parent / "results"
SCREENS = {"page": ((960, 640), 1.0, False), "phone": ((390, 780), 1.5, True)}
LARGEST = 300_000  # bytes of a picture
PATIENCE = 300.0  # seconds to wait for anything
PRESSED = ("s",)  # split, the texture to the right


def of_page(file: Path, results: Path) -> None:
    """page.png and phone.png: the page once its last frame is there, with all its pixels."""
    for name, (size, scale, mobile) in SCREENS.items():
        with Browser(size=size, scale=scale) as found:
            found.resize(size, scale, mobile=mobile)
            found.goto(file.resolve().as_uri())
            found.evaluate("prtnet.ready")
            # all pixels, where a busy machine makes the page draw fewer
            found.evaluate("prtnet.viewer.full = true; prtnet.viewer.changed()")
            until(lambda found=found: not found.evaluate("prtnet.viewer.pending"))
            shot = found.send("Page.captureScreenshot", format="png")["data"]
        keep(Image.open(io.BytesIO(base64.b64decode(shot))), results / f"{name}.png")


def of_viewer(run: Path, words: list[str], results: Path) -> None:
    """viewer.png: what the key P writes after those of PRESSED."""
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", "1", "-screen", "0", "1280x1024x24", "-nolisten", "tcp"],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    assert server.stdout is not None
    environment = os.environ | {"DISPLAY": f":{server.stdout.readline().strip()}"}

    def tell(*arguments: str) -> str:
        done = subprocess.run(["xdotool", *arguments], env=environment, capture_output=True, text=True, check=False)
        return done.stdout.strip()

    arguments = [sys.executable, "-m", "prtnet", *words, "stages=[view]", f"out={run}"]
    viewer = subprocess.Popen(arguments, env=environment)
    before = set(run.glob("view_*.png"))
    try:
        window = until(lambda: tell("search", "--name", "^prtnet "), viewer)
        for key in (*PRESSED, "p"):
            until(lambda: tell("getwindowname", window).endswith(" ms"), viewer)
            tell("key", "--window", window, key)
        until(lambda: set(run.glob("view_*.png")) - before, viewer)
        (shot,) = set(run.glob("view_*.png")) - before
        keep(Image.open(shot), results / "viewer.png")
    finally:
        for process in (viewer, server):
            process.kill()
            process.wait()


def until(found: Callable[[], object], process: "subprocess.Popen[bytes] | None" = None) -> str:
    """The first true value of what is called again and again, while a process goes on."""
    deadline = time.monotonic() + PATIENCE
    while not (value := found()):
        if process and process.poll() is not None:
            raise PrtnetError("pictures: found the viewer ended, expected a window; it says why above")
        if time.monotonic() > deadline:
            raise PrtnetError(f"pictures: found nothing in {PATIENCE:g} s, expected a window or a picture")
        time.sleep(0.1)
    return str(value)


def keep(image: Image.Image, path: Path) -> None:
    """A PNG of at most LARGEST bytes: of fewer colours where it must be."""
    path.parent.mkdir(parents=True, exist_ok=True)
    image = image.convert("RGB")
    image.save(path, optimize=True)
    if path.stat().st_size > LARGEST:
        image.quantize(256).save(path, optimize=True)
    while path.stat().st_size > LARGEST:
        image = image.resize((round(0.85 * image.width), round(0.85 * image.height)), Image.Resampling.LANCZOS)
        image.quantize(256).save(path, optimize=True)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    of_page(Path(sys.argv[1]) / web.NAME, RESULTS)
    of_viewer(Path(sys.argv[1]), sys.argv[2:], RESULTS)
