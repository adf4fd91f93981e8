"""The web page of a run: its net beside a texture, under several lights, checked in a browser where there is one."""

import hashlib
import logging
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from prtnet import PrtnetError, console, netspec, score, sh, store
from prtnet.data import atlas as atlases
from prtnet.data import light as lights
from prtnet.data import unwrap
from prtnet.data.light import Light
from prtnet.export import web
from prtnet.export.browser import Browser, NoBrowser
from prtnet.export.web import Certificate, Cost, Look, PageLight
from prtnet.netspec import NetSpec
from prtnet.pipeline.bake import Baked, BakedTexture, bake_texture
from prtnet.pipeline.job import Job
from prtnet.pipeline.train import Trained
from prtnet.pipeline.views import cameras_of, drawing_of
from prtnet.render import gbuffer as gbuffers
from prtnet.render.camera import Camera
from prtnet.render.marched import Drawing
from prtnet.render.material import Material
from prtnet.render.verify import TOLERANCE

log = logging.getLogger(__name__)
Array = np.ndarray

NAME = "page.html"
SIDE = 512  # texels along one side of the page's texture
EXPOSED_SIZE = 128  # of the frame that exposures are found in
FRAME = (960, 600)  # of the browser that measures


def write_page(job: Job, baked: Baked, trained: Trained | None, *, side: int | None = SIDE) -> Path:
    """Write page.html into the run folder. `side`: texels along one side of its texture, baked anew where the job's is
    another; None takes the job's. Implicit surfaces have none.

    Raises PrtnetError, and leaves no page behind, where there is no net or a browser does not compute what NumPy does.
    """
    path = job.out / NAME
    path.unlink(missing_ok=True)
    if trained is None:
        raise PrtnetError(f"web page: found methods {job.config.methods}, expected net among them")
    eye = cameras_of(job)[0]
    look = _look(eye, job.material)
    lights = _lights(job, drawing_of(job, baked, EXPOSED_SIZE), trained.net, eye, look)
    page = _of_triangles(job, baked.texture, trained.net, side) if baked.texture else _of_surface(job, trained.net)

    def made(certificate: Certificate) -> str:
        return page(lights=lights, look=look, certificate=replace(certificate, notes=_notes(job)))

    certificate = measured(job, made(Certificate(reason="not yet")))
    error = certificate.measured["error_max"] if certificate.measured else 0.0
    if not error <= TOLERANCE:
        raise PrtnetError(
            f"web page: the browser's net differs from NumPy's by {error:.2g} in a coefficient, expected at most "
            f"{TOLERANCE:g}; no page was written"
        )
    text = made(certificate)
    store.write_text(path, text)
    log.info("web page: %s, %s; %s", path, console.size(len(text.encode())), _words(certificate))
    return path


def _of_triangles(job: Job, baked: BakedTexture, net: NetSpec, side: int | None) -> Callable[..., str]:
    """`web.page` with its net, its mesh and its texture."""
    texture = _texture(job, baked, side)
    atlas, net_uv = texture.atlas, None
    if net.texels:
        # the page's texture may have an atlas of its own, and the net knows that of its training
        atlas, net_uv = atlases.joined(atlas, baked.atlas)
    return partial(web.page, net, atlas, texture.pages, texture_cost=_cost(job, texture), net_uv=net_uv)


def _of_surface(job: Job, net: NetSpec) -> Callable[..., str]:
    """`web.surface_page` with its net and its surface."""
    assert job.implicit
    return partial(web.surface_page, net, job.implicit)


def measure(page: Path) -> dict[str, Any]:
    """What headless Chromium makes of a page: error_max and error_mean of its net against NumPy at its random points,
    seconds until the first picture and until it is ready, the frame's size and milliseconds by each method, browser and
    device.

    Raises NoBrowser, or PrtnetError where the page does not start.
    """
    with Browser(size=FRAME) as found:
        facts = started(found, page) | found.evaluate("prtnet.certify()")
        # JSON has no NaN
        facts["error_max"] = np.inf if facts["error_max"] is None else facts["error_max"]
        facts |= timed(found)
    return facts


def measured(job: Job, text: str, ask: Callable[[Path], dict[str, Any]] = measure) -> Certificate:
    """The certificate of a page's text: run in Chromium where there is one that starts, once for each text.

    `ask`: what is measured of a page on disk.
    """

    def run() -> tuple[dict[str, Array], dict[str, Any]]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / NAME
            path.write_text(text, encoding="utf-8")
            return {}, ask(path)

    try:
        return Certificate(job.store.make("page", {"page": hashlib.sha256(text.encode()).hexdigest()}, run).facts)
    except NoBrowser as error:
        return Certificate(reason=str(error))


def started(browser: Browser, page: Path) -> dict[str, Any]:
    """Open a page: seconds to its first picture and until it is ready. Raises PrtnetError where it does not start."""
    start = time.perf_counter()
    browser.goto(page.resolve().as_uri())
    browser.evaluate("prtnet.ready")
    ready = time.perf_counter() - start
    if not browser.evaluate("Boolean(prtnet.certify)"):
        message = browser.evaluate("document.getElementById('message').textContent")
        raise PrtnetError(f"web page: found {message!r} in the browser, expected a picture")
    return {"ready_seconds": round(ready, 2), "first_seconds": browser.evaluate("prtnet.first_ms") / 1000}


def timed(browser: Browser) -> dict[str, Any]:
    """Milliseconds of each kind of frame of a page that has started, the frame's size, and the browser."""
    facts = {f"{name}_ms": taken for name, taken in browser.evaluate("prtnet.viewer.time(3)").items()}
    size = browser.evaluate("[prtnet.renderer.canvas.width, prtnet.renderer.canvas.height]")
    return facts | {"frame": size, "browser": browser.send("Browser.getVersion")["product"]}


def _words(certificate: Certificate) -> str:
    found = certificate.measured
    if not found:
        return f"not measured, {certificate.reason}"
    return f"{found['browser']}: {found['error_max']:.1e} at most, first picture in {found['first_seconds']:.1f} s"


def _texture(job: Job, baked: BakedTexture, side: int | None) -> BakedTexture:
    options = job.config.atlas
    if side is None or side == options.size:
        return baked
    other = replace(job.config, atlas=replace(options, size=side))
    try:
        return bake_texture(replace(job, config=other))
    except unwrap.DoesNotFit as error:
        raise PrtnetError(
            f"export.web_texture: found {side}, expected more, or null for the {options.size} of atlas.size ({error})"
        ) from None


def _cost(job: Job, texture: BakedTexture) -> Cost:
    """8-bit texels, decoded after the bilinear fetch."""
    count = job.groups * sh.count(job.config.transfer.bands)
    sides = [len(page.used) for page in texture.pages]
    held = sum(score.texture_bytes(side, count, texel_bytes=1) for side in sides)
    return Cost(score.fetch_macs(count, "bilinear") + count, held)


def _look(eye: Camera, material: Material) -> Look:
    tint, strength = np.asarray(material.specular), float(max(material.specular))
    red, green, blue = (float(value) for value in (tint / strength if strength else np.ones(3)))
    return Look(
        eye.eye,
        eye.target,
        eye.fov_y,
        min(material.diffuse, 1.0),
        min(strength, 1.0),
        (red, green, blue),
        float(np.clip(material.exponent, 1, 100)),
    )


def _lights(job: Job, drawing: Drawing, net: NetSpec, eye: Camera, look: Look) -> list[PageLight]:
    """The job's light, then those by formula, each with its exposure as in the score: 0.9 / P99 of what the net shows
    in the first view, at the page's first material."""
    gbuffer = drawing.gbuffer(eye)
    transfer = netspec.evaluate_unit(net, gbuffer.positions.astype(np.float64), gbuffer.normals, uv=gbuffer.uv)
    specular = tuple(look.specular * value for value in look.tint)
    material = Material(look.diffuse, specular, look.exponent)

    def made(light: Light) -> PageLight:
        coefficients = light.coefficients(net.bands)
        image = gbuffers.shade(gbuffer, transfer, coefficients, material, groups=net.groups)
        return PageLight(light.name, coefficients, score.exposure([image], [gbuffer.covered]))

    others = [lights.by_name(name) for name in lights.NAMES if name != job.light.name]
    return [made(light) for light in (job.light, *others)]


def _notes(job: Job) -> list[str]:
    material = job.material
    if material.varies:
        return ["The parts of this scene reflect differently in its scores; here they are all alike."]
    return []
