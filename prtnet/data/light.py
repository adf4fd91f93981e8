"""Distant light: SH coefficients L_i = integral of L Y_i dw for shading, and a lat-long image where there is one.

`from_file` reads probes of any mapping (`prtnet.data.probe`), `by_name` makes lights by formula
(`prtnet.data.analytic_light`). A lat-long image has u = 1/2 + atan2(x, -z) / 2pi and v = 0 at +y, with texel centres
at half-integers: its centre looks down -z, +x is at u = 3/4, and row 0 is the top.
"""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Float64

from prtnet import PrtnetError, sh
from prtnet.data import analytic_light, probe
from prtnet.data.analytic_light import AnalyticOptions, Beam, sky
from prtnet.data.mapping import lat_long_directions as directions
from prtnet.data.mapping import lat_long_solid_angles as solid_angles
from prtnet.data.probe import Probe

__all__ = ["Light", "by_name", "directions", "from_file", "load", "project", "sky", "solid_angles", "turn"]

Array = np.ndarray
NAMES = tuple(field.name for field in fields(AnalyticOptions))


@dataclass(frozen=True, eq=False)
class Light:
    """A light and what is done to it. `image` is turned as the light is; windows are of the coefficients alone."""

    name: str  # in tables, with what is not default
    unturned: Callable[[int], Array]  # bands -> "k 3"
    image: Float32[Array, "h w 3"] | None = None  # linear lat-long radiance; none where a light has no size in texels
    beam: Beam | None = None  # unturned, what such a light is instead
    rotation: float = 0.0  # degrees about +y, from +z towards +x
    window: str = "none"  # against ringing: none, hann, lanczos
    window_size: float | None = None  # bands; as many as there are where left out

    def coefficients(self, bands: int) -> Float32[Array, "k 3"]:
        """SH coefficients per colour: projected, turned, windowed."""
        found = self.unturned(bands)
        if self.rotation:
            found = sh.rotate(found, about_y(self.rotation))
        if self.window == "none":
            return found
        factors = sh.window(self.window, self.window_size or bands, bands)
        return (found * factors[sh.band_index(bands)][:, None]).astype(np.float32)


def from_file(path: str | Path, kind: str = "auto") -> Light:
    """A light probe of any mapping in `prtnet.data.probe`; raises PrtnetError as its `load`."""
    read = probe.load(path, kind)
    name = Path(path).resolve().name if Path(path).is_dir() else Path(path).stem
    return Light(name, partial(probe.project, read), probe.to_lat_long(read))


def by_name(name: str, options: AnalyticOptions | None = None) -> Light:
    """A light by formula: sky, constant, gradient, sun, directional or green. The sun and directional have no image."""
    options = deepcopy(options) if options else AnalyticOptions()  # the light outlives what is done to them later
    if name not in NAMES:
        raise PrtnetError(f"light.name: found {name!r}, expected one of {', '.join(NAMES)}, or a file as light.path")
    if name == "sky":
        image = probe.clean(sky(**asdict(options.sky)), "light=sky")
        return Light(name, partial(project, image), image)
    if name == "directional":
        coefficients = partial(analytic_light.directional, options.directional)
        found = Light(name, coefficients, beam=analytic_light.beam(name, options))
    else:
        lobes = analytic_light.lobes(name, options)
        found = Light(name, partial(analytic_light.project, lobes))
        if name == "sun":
            found = replace(found, beam=analytic_light.beam(name, options))
        else:
            towards = directions(analytic_light.HEIGHT, 2 * analytic_light.HEIGHT)
            found = replace(found, image=analytic_light.radiance(lobes, towards).astype(np.float32))
    if not found.unturned(1).any():
        raise PrtnetError(f"light: {name} holds no light at all: its colours are 0")
    return found


def adjust(light: Light, *, rotation: float = 0.0, window: str = "none", window_size: float | None = None) -> Light:
    """The light turned by `rotation` degrees about +y, with a window; what is not default joins its name."""
    if not np.isfinite(rotation):
        raise PrtnetError(f"light.rotation: found {rotation}, expected degrees")
    if window not in sh.WINDOWS:
        raise PrtnetError(f"light.window: found {window!r}, expected one of {', '.join(sh.WINDOWS)}")
    if window_size is not None and not 0 < window_size < np.inf:
        raise PrtnetError(f"light.window_size: found {window_size}, expected more than 0 bands")
    if window_size is not None and window == "none":
        raise PrtnetError(f"light.window_size: found {window_size} with light.window=none, expected hann or lanczos")
    name = light.name
    if window != "none":
        name += f" {window}" + (f" {window_size:g}" if window_size else "")
    if rotation:
        name += f" turned {rotation:g}"
    image = None if light.image is None else turn(light.image, rotation)
    return replace(light, name=name, image=image, rotation=rotation, window=window, window_size=window_size)


def load(path: str | Path, kind: str = "lat_long") -> Float32[Array, "h w 3"]:
    """A probe as a lat-long radiance image, linear RGB; `kind` as in `prtnet.data.probe.load`, and so the errors."""
    return probe.to_lat_long(probe.load(path, kind))


def project(lat_long: Float[Array, "h w 3"], bands: int) -> Float32[Array, "k 3"]:
    """SH coefficients of a lat-long radiance image per colour: every texel at its centre with its exact solid angle."""
    return probe.project(Probe("lat_long", np.asarray(lat_long)[None]), bands)


def about_y(degrees: float) -> Float64[Array, "3 3"]:
    """The rotation about +y that takes +z towards +x, counter-clockwise seen from above."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])


def turn(lat_long: Float32[Array, "h w 3"], degrees: float) -> Float32[Array, "h w 3"]:
    """A lat-long image turned as `about_y` turns directions: its columns move to the left, blended between texels."""
    columns = degrees / 360 * lat_long.shape[1]
    whole = round(columns) if np.isclose(columns, round(columns), atol=1e-9) else int(np.floor(columns))
    share = np.float32(max(columns - whole, 0))
    near, far = np.roll(lat_long, -whole, axis=1), np.roll(lat_long, -whole - 1, axis=1)
    return near * (1 - share) + far * share if share > 1e-6 else near
