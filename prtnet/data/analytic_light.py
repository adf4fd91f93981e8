"""Lights by formula: a sky, constant, gradient, sun, directional, and the two lobes of Green 2003.

All but the sky and the directional light are sums of lobes p(cos) around axes, p a polynomial, 0 outside a cap: their
SH are zonal, L_i = f_l Y_i(axis) with f_l = 2 pi integral of p(t) P_l(t) dt (Funk and Hecke), and exact.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64

from prtnet import PrtnetError, sh
from prtnet.data import mapping

Array = np.ndarray
HEIGHT = 256  # rows of a lat-long image of a light
UP, DOWN = (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)


@dataclass
class SkyOptions:
    sun: list[float] = field(default_factory=lambda: [0.75, 0.55, 0.45])  # points to the sun, any length
    sun_irradiance: list[float] = field(default_factory=lambda: [3.6, 3.1, 2.4])  # on a surface that faces it
    sun_sharpness: float = 16.0  # of its lobe exp(sharpness (cos - 1)), about 1 / sqrt(sharpness) rad wide
    zenith: list[float] = field(default_factory=lambda: [0.20, 0.34, 0.62])
    horizon: list[float] = field(default_factory=lambda: [0.62, 0.70, 0.78])
    ground: list[float] = field(default_factory=lambda: [0.16, 0.13, 0.10])


@dataclass
class ConstantOptions:
    radiance: list[float] = field(default_factory=lambda: [1.0, 1.0, 1.0])


@dataclass
class GradientOptions:
    """Linear in the height y of a direction between these radiances."""

    zenith: list[float] = field(default_factory=lambda: [0.25, 0.45, 0.90])  # at +y
    horizon: list[float] = field(default_factory=lambda: [0.80, 0.85, 0.90])
    nadir: list[float] = field(default_factory=lambda: [0.20, 0.16, 0.12])  # at -y


@dataclass
class SunOptions:
    """A disc of constant radiance in a black sky."""

    direction: list[float] = field(default_factory=lambda: [0.75, 0.55, 0.45])  # points to its centre, any length
    radius: float = 0.267  # degrees, up to 90; the sun's own, seen from the earth
    irradiance: list[float] = field(default_factory=lambda: [3.6, 3.1, 2.4])  # on a surface that faces it


@dataclass
class DirectionalOptions:
    """All light from one direction."""

    direction: list[float] = field(default_factory=lambda: [0.75, 0.55, 0.45])  # points to the light, any length
    irradiance: list[float] = field(default_factory=lambda: [3.6, 3.1, 2.4])  # on a surface that faces it


@dataclass
class GreenOptions:
    """max(0, 5 cos theta - 4) + max(0, -4 sin(theta - pi) cos(phi - 2.5) - 3), its pole theta = 0 at +y.

    Green 2003, *Spherical Harmonic Lighting: The Gritty Details*, has its pole at z; here x y z became z x y, so that
    phi runs from +z to +x and the lobes are around +y and (sin 2.5, 0, cos 2.5).
    """

    radiance: list[float] = field(default_factory=lambda: [1.0, 1.0, 1.0])  # factor of the function


@dataclass
class AnalyticOptions:
    sky: SkyOptions = field(default_factory=SkyOptions)
    constant: ConstantOptions = field(default_factory=ConstantOptions)
    gradient: GradientOptions = field(default_factory=GradientOptions)
    sun: SunOptions = field(default_factory=SunOptions)
    directional: DirectionalOptions = field(default_factory=DirectionalOptions)
    green: GreenOptions = field(default_factory=GreenOptions)


@dataclass(frozen=True)
class Lobe:
    """colour * p(w.axis) in the directions w within a cap around the axis."""

    axis: tuple[float, float, float]  # unit
    colour: tuple[float, float, float]
    profile: tuple[float, ...] = (1.0,)  # p, a polynomial of the cosine, lowest power first
    depth: float = 2.0  # of the cap, 1 - the cosine at its rim: 2 is the whole sphere, 1 half of it


@dataclass(frozen=True)
class Beam:
    """A disc of one radiance around an axis; of depth 0, all light from the axis, and the colour its irradiance."""

    axis: tuple[float, float, float]  # unit
    colour: tuple[float, float, float]
    depth: float = 0.0  # 1 - the cosine at the disc's rim


def beam(name: str, options: AnalyticOptions) -> Beam:
    """What sun and directional are besides their coefficients. Raises PrtnetError as `lobes`."""
    if name == "sun":
        disc = _disc(options.sun)
        return Beam(disc.axis, disc.colour, disc.depth)
    x, y, z = unit("light.directional.direction", options.directional.direction)
    return Beam((x, y, z), _colour("light.directional.irradiance", options.directional.irradiance))


def lobes(name: str, options: AnalyticOptions) -> list[Lobe]:
    """What constant, gradient, sun and green are made of. Raises PrtnetError for values that mean nothing."""
    if name == "constant":
        return [Lobe(UP, _colour("light.constant.radiance", options.constant.radiance))]
    if name == "gradient":
        given = asdict(options.gradient)
        zenith, horizon, nadir = (
            _colour(f"light.gradient.{key}", given[key]) for key in ("zenith", "horizon", "nadir")
        )
        above, below = _minus(zenith, horizon), _minus(nadir, horizon)
        return [Lobe(UP, horizon), Lobe(UP, above, (0, 1), 1), Lobe(DOWN, below, (0, 1), 1)]
    if name == "sun":
        return [_disc(options.sun)]
    colour = _colour("light.green.radiance", options.green.radiance)
    second = (float(np.sin(2.5)), 0.0, float(np.cos(2.5)))
    return [Lobe(UP, colour, (-4, 5), 1 / 5), Lobe(second, colour, (-3, 4), 1 / 4)]


def zonal(lobe: Lobe, bands: int) -> Float64[Array, " bands"]:
    """f_l of a lobe of colour 1. Gauss's rule on the cap: exact, for the integrand is a polynomial."""
    nodes, weights = np.polynomial.legendre.leggauss((bands + len(lobe.profile)) // 2 + 1)
    cosine = 1 - lobe.depth * (1 - nodes) / 2
    values = np.polynomial.polynomial.polyval(cosine, np.asarray(lobe.profile, float)) * weights * lobe.depth / 2
    return 2 * np.pi * np.polynomial.legendre.legvander(cosine, bands - 1).T @ values


def project(light: Sequence[Lobe], bands: int) -> Float32[Array, "k 3"]:
    """SH coefficients per colour of a sum of lobes, exact."""
    total = np.zeros((sh.count(bands), 3))
    for lobe in light:
        along = sh.evaluate(np.asarray(lobe.axis), bands) * zonal(lobe, bands)[sh.band_index(bands)]
        total += along[:, None] * np.asarray(lobe.colour)
    return total.astype(np.float32)


def radiance(light: Sequence[Lobe], towards: Float[Array, "*n 3"]) -> Float64[Array, "*n 3"]:
    """Radiance of a sum of lobes in unit directions, at the very direction."""
    total = np.zeros(towards.shape)
    for lobe in light:
        cosine = towards @ np.asarray(lobe.axis)
        values = np.polynomial.polynomial.polyval(cosine, np.asarray(lobe.profile, float))
        total += np.where(1 - cosine <= lobe.depth, values, 0)[..., None] * np.asarray(lobe.colour)
    return total


def directional(options: DirectionalOptions, bands: int) -> Float32[Array, "k 3"]:
    """SH coefficients of a light from one direction: irradiance times Y_i there."""
    direction = unit("light.directional.direction", options.direction)
    irradiance = _colour("light.directional.irradiance", options.irradiance)
    return (sh.evaluate(direction, bands)[:, None] * np.asarray(irradiance)).astype(np.float32)


def sky(height: int = HEIGHT, **knobs: Any) -> Float32[Array, "h w 3"]:
    """A clear sky over dull ground with a soft sun from the side; linear radiance, `height` x twice that.

    Knobs as in SkyOptions. The lobe of the sun is so wide that five bands still carry its shadow, and is scaled to
    `sun_irradiance`.
    """
    given: dict[str, Any] = {key: value if np.isscalar(value) else list(value) for key, value in knobs.items()}
    options = SkyOptions(**given)
    for key in ("sun_irradiance", "zenith", "horizon", "ground"):
        _colour(f"light.sky.{key}", getattr(options, key))
    towards = mapping.lat_long_directions(height, 2 * height)
    up = towards[..., 1:2]
    above = np.clip(up, 0, 1) ** 0.5
    dome = np.asarray(options.horizon) * (1 - above) + np.asarray(options.zenith) * above
    # 3 degrees of haze between sky and ground: no hard edge to alias
    share = np.clip(up / 0.1 + 0.5, 0, 1)
    share = share * share * (3 - 2 * share)
    lobe = np.exp(options.sun_sharpness * (towards @ unit("light.sky.sun", options.sun) - 1))[..., None]
    peak = np.asarray(options.sun_irradiance) / _facing_irradiance(options.sun_sharpness)
    return (np.asarray(options.ground) * (1 - share) + (dome + peak * lobe) * share).astype(np.float32)


def unit(key: str, direction: Sequence[float]) -> Float64[Array, " 3"]:
    """The direction at length 1, or a PrtnetError that names the key."""
    length = float(np.linalg.norm(direction)) if len(direction) == 3 else 0.0
    if not (length > 0 and np.isfinite(length)):
        raise PrtnetError(f"{key}: found {list(direction)}, expected a finite vector other than 0, towards the light")
    return np.asarray(direction, np.float64) / length


def _disc(options: SunOptions) -> Lobe:
    if not 0 < options.radius <= 90:
        raise PrtnetError(f"light.sun.radius: found {options.radius} degrees, expected more than 0 and at most 90")
    irradiance = np.array(_colour("light.sun.irradiance", options.irradiance))
    angle = np.radians(options.radius)
    red, green, blue = irradiance / (np.pi * np.sin(angle) ** 2)
    x, y, z = unit("light.sun.direction", options.direction)
    # 1 - cos without its loss of digits at half a degree
    return Lobe((x, y, z), (red, green, blue), depth=float(2 * np.sin(angle / 2) ** 2))


def _colour(key: str, colour: Sequence[float]) -> tuple[float, float, float]:
    """Three finite values, none negative, not all 0."""
    given = np.asarray(colour, float)
    if given.shape != (3,) or not np.isfinite(given).all() or (given < 0).any():
        raise PrtnetError(f"{key}: found {list(colour)}, expected three finite values, 0 or more: red, green, blue")
    red, green, blue = given.tolist()
    return red, green, blue


def _minus(first: tuple[float, float, float], second: tuple[float, float, float]) -> tuple[float, float, float]:
    return first[0] - second[0], first[1] - second[1], first[2] - second[2]


def _facing_irradiance(sharpness: float) -> float:
    """Integral of max(0, cos) exp(sharpness (cos - 1)) dw."""
    if not sharpness > 0:
        raise PrtnetError(f"light.sky.sun_sharpness: found {sharpness}, expected more than 0")
    return 2 * np.pi * (1 / sharpness - (1 - np.exp(-sharpness)) / sharpness**2)
