"""The web page of data-driven transfer: the scene of a run under one lamp to move, checked in a browser where there is
one."""

import logging
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError, console, data_driven, store
from prtnet.data import surface, texture
from prtnet.data.atlas import Atlas
from prtnet.data.lighting import direct
from prtnet.data.lighting.lamp import Lamp, Lighting
from prtnet.data.tracer import Tracer
from prtnet.data_driven import DataDriven, Measurement
from prtnet.export import web_data_driven
from prtnet.export.browser import Browser
from prtnet.export.web_data_driven import PageLamp
from prtnet.export.web_frame import Certificate, Look
from prtnet.pipeline.data_driven.learn import Operator
from prtnet.pipeline.job import Job
from prtnet.pipeline.views import cameras_of
from prtnet.pipeline.web import FRAME, measured, started, timed
from prtnet.render.camera import Camera

log = logging.getLogger(__name__)
Array = np.ndarray

NAME = "data_driven.html"
OFFERED = 6  # lights of the database, with their lightmaps
# of u and of texels for the direct light of rays, as shares of the largest: texels are floats of 16 bits
BOUNDS = {"coefficients": 1e-4, "texels": 2e-3}
# percentile of the texels that is just not white: what is next to a lamp may be
EXPOSED = 95
# where the database has no lamp
SUN = Lamp("directional", (3.0, 3.0, 3.0), aim=(0.36, -0.8, -0.48))
# shadow maps have an edge of texels, but no more than so many root mean squares of direct light lie on it
APART = 0.5


def write_page_of(job: Job, made: Operator) -> Path:
    """`write_page` of a run's operator, with the unseen lights of the pose that is shown, the first."""
    shown, unseen = made.ground.keyframes[0], made.unseen
    rows = np.flatnonzero(unseen.keyframe == 0)
    lightings = [unseen.lightings[row] for row in rows]
    return write_page(job, made.spec, shown.atlas, lightings, unseen.lightmaps[rows], tracer=shown.tracer)


def write_page(
    job: Job,
    spec: DataDriven,
    atlas: Atlas,
    lightings: Sequence[Lighting],
    lightmaps: Float32[Array, "l t 3"] | None = None,
    *,
    tracer: Tracer | None = None,
) -> Path:
    """Write data_driven.html into the run folder. `atlas`, in unit coordinates, is that of the basis.

    Of `lightings` a few that are one lamp are offered, of each kind, to be compared with their `lightmaps`; `tracer`
    casts the rays that shadow maps are held against, at the first keyframe. Raises PrtnetError, and leaves no page
    behind, where a browser does not compute what NumPy does.
    """
    path = job.out / NAME
    path.unlink(missing_ok=True)
    if spec.scene != job.scene.digest():
        raise PrtnetError(
            f"web page: found data-driven transfer of another scene than {job.scene.name}, expected that of this one"
        )
    tracer = tracer or job.tracer
    lights = _lights(spec, atlas, tracer, lightings, lightmaps)
    eye = _clearest(cameras_of(job), spec.measurements[0], tracer, lights)
    look = Look(eye.eye, eye.target, eye.fov_y)

    def made(certificate: Certificate) -> str:
        return web_data_driven.page(
            spec, atlas, lights=lights, look=look, title=job.scene.name, notes=_notes(lights), certificate=certificate
        )

    certificate = measured(job, made(Certificate(reason="not yet")), measure)
    if certificate.measured:
        _refuse(certificate.measured["errors"])
    text = made(certificate)
    store.write_text(path, text)
    log.info("web page: %s, %s; %s", path, console.size(len(text.encode())), _words(certificate))
    return path


def measure(page: Path) -> dict[str, Any]:
    """What headless Chromium makes of a page: `errors` under its lights, seconds to its first picture, milliseconds of
    a frame of direct light, of one of both, and of a move of the lamp.

    Raises NoBrowser, or PrtnetError where the page does not start.
    """
    with Browser(size=FRAME) as found:
        facts = started(found, page) | found.evaluate("prtnet.certify()")
        # JSON has no NaN
        facts["errors"] = {name: math.inf if each is None else each for name, each in facts["errors"].items()}
        return facts | timed(found)


def _refuse(errors: Mapping[str, float]) -> None:
    """Raises PrtnetError for an error above its bound."""
    for name, bound in (BOUNDS | {"direct": APART}).items():
        if not errors[name] <= bound:
            raise PrtnetError(
                f"web page: {name}: found the browser {errors[name]:.2g} from NumPy, as a share, expected at most"
                f" {bound:g}; no page was written"
            )


def _words(certificate: Certificate) -> str:
    found = certificate.measured
    if not found:
        return f"not measured, {certificate.reason}"
    errors = found["errors"]
    return f"{found['browser']}: texels {errors['texels']:.1e}, direct light {100 * errors['direct']:.2g} % apart"


def _notes(lights: Sequence[PageLamp]) -> list[str]:
    if lights[0].lightmap is not None:
        return ["Path-traced: lightmaps of lights that the operator has not learned from."]
    return ["No light of the database is one lamp, or none has a lightmap here: there is nothing to compare with."]


def _lights(
    spec: DataDriven,
    atlas: Atlas,
    tracer: Tracer,
    lightings: Sequence[Lighting],
    lightmaps: Float32[Array, "l t 3"] | None,
) -> list[PageLamp]:
    """Lights of the database that are one lamp, of each kind in turns; one from above where there is none."""
    chosen = _in_turns(lightings)
    lamps = [lightings[row].lamps[0] for row in chosen] or [SUN]
    maps = [None if lightmaps is None else lightmaps[row] for row in chosen] or [None]
    page = texture.gbuffer(atlas, spec.size)
    albedo = surface.texel_albedo(atlas, [page])
    found = []
    for number, (lamp, lightmap) in enumerate(zip(lamps, maps, strict=True), 1):
        one = Lighting((lamp,))
        vector = measured_by_rays(spec, tracer, one)
        arriving = np.maximum(data_driven.indirect(spec, vector), 0) if lightmap is None else lightmap
        shown = arriving
        if spec.quantity == "irradiance":
            received = direct.irradiance(one, tracer, page.positions, page.normals, page.geometric_normals)
            shown = albedo / np.pi * (received + arriving)
        exposure = 0.9 / max(float(np.percentile(np.max(shown, axis=1), EXPOSED)), 1e-6)
        name = f"{number}: {lamp.kind}" if chosen else lamp.kind
        found.append(PageLamp(name, lamp, exposure, lightmap, vector))
    return found


def _in_turns(lightings: Sequence[Lighting]) -> list[int]:
    """Rows of some lightings that are one lamp: the first of each kind, then the second of each, and so on."""
    kinds: dict[str, list[int]] = {}
    for row, each in enumerate(lightings):
        if len(each.lamps) == 1 and each.environment is None:
            kinds.setdefault(each.lamps[0].kind, []).append(row)
    ranked = [(place, row) for rows in kinds.values() for place, row in enumerate(rows)]
    return [row for _, row in sorted(ranked)[:OFFERED]]


def _clearest(cameras: Sequence[Camera], points: Measurement, tracer: Tracer, lights: Sequence[PageLamp]) -> Camera:
    """The first of the views that show most of what the lamps light: a box is dark from behind."""
    places, sides = points.positions[:, 0], points.geometric_normals[:, 0]
    lit = np.zeros(points.count)
    for light in lights:
        assert light.direct is not None
        lit += light.direct.max(axis=1) > 0.1 * light.direct.max(axis=1).mean()
    shown = []
    for camera in cameras:
        away = np.asarray(camera.eye) - places
        distance = np.linalg.norm(away, axis=1)
        across, upwards, depth = camera.basis() @ away.T
        half = math.tan(math.radians(camera.fov_y / 2)) * depth
        seen = (np.einsum("ni,ni->n", away, sides) > 0) & (np.maximum(abs(across), abs(upwards)) < half)
        aims = (away / np.maximum(distance, 1e-9)[:, None]).astype(np.float32)
        clear = tracer.hits(tracer.origins(places.astype(np.float64), sides), aims)[2] >= distance - 0.01
        shown.append(float(lit[seen & clear].sum()))
    return cameras[int(np.argmax(shown))]


def measured_by_rays(spec: DataDriven, tracer: Tracer, lighting: Lighting) -> Float32[Array, "m 3"]:
    """The direct vector of the first keyframe by shadow rays."""
    points = spec.measurements[0]
    positions, normals, sides = (
        getattr(points, name).reshape(-1, 3) for name in ("positions", "normals", "geometric_normals")
    )
    received = direct.irradiance(lighting, tracer, positions.astype(np.float64), normals, sides)
    each: Float[Array, "m s 3"] = received.reshape(points.albedo.shape) * points.albedo / np.pi
    return each.mean(axis=1, dtype=np.float64).astype(np.float32)
