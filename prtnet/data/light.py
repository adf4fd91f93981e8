"""Distant light: lat-long images of linear radiance, and their SH projection L_i = integral of L Y_i dw.

A lat-long image has u = 1/2 + atan2(x, -z) / 2pi and v = 0 at +y, with texel centres at half-integers: its centre
looks down -z, +x is at u = 3/4, and row 0 is the top.
"""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Float64

from prtnet import PrtnetError, sh

log = logging.getLogger(__name__)

# directions of `project` per step: a few MB of basis values at a time
STEP = 1 << 14


def load(path: str | Path) -> Float32[np.ndarray, "h w 3"]:
    """A lat-long radiance image, EXR, HDR or any that OpenImageIO reads; linear RGB. Grey becomes RGB; alpha goes.

    Negative, NaN and infinite values become 0, with their count in the log. Raises PrtnetError when the file is
    missing or unreadable, is not twice as wide as high, or holds no light.
    """
    import OpenImageIO as oiio

    path = Path(path)
    if not path.is_file():
        raise PrtnetError(f"light: {path} is not a file; expected a lat-long EXR or HDR image")
    image = oiio.ImageBuf(str(path))
    pixels = image.get_pixels(oiio.FLOAT) if image.read() else None
    if pixels is None:
        raise PrtnetError(f"light: {path} cannot be read: {image.geterror().strip() or 'no pixels'}")
    pixels = np.asarray(pixels, np.float32)
    if pixels.ndim != 3 or pixels.shape[1] != 2 * pixels.shape[0]:
        found = " x ".join(map(str, pixels.shape[1::-1]))
        raise PrtnetError(f"light: {path} is {found} pixels; expected a lat-long image, twice as wide as high")
    channels = pixels[..., :3] if pixels.shape[2] >= 3 else np.repeat(pixels[..., :1], 3, axis=2)
    return clean(channels, str(path))


def clean(radiance: Float[np.ndarray, "h w 3"], name: str) -> Float32[np.ndarray, "h w 3"]:
    """Negative, NaN and infinite radiance becomes 0 and is counted in the log."""
    infinite = ~np.isfinite(radiance)
    negative = radiance < 0
    if infinite.any() or negative.any():
        lowest = float(radiance.min(where=~infinite, initial=0))
        log.warning(
            "light: %s: set to 0: %d negative values (lowest %.4g) and %d NaN or infinite ones of %d",
            name, int(negative.sum()), lowest, int(infinite.sum()), radiance.size,
        )  # fmt: skip
    cleaned = np.where(infinite | negative, 0, radiance).astype(np.float32)
    if not cleaned.any():
        raise PrtnetError(f"light: {name} holds no light at all: every value is 0, negative, NaN or infinite")
    return cleaned


def directions(height: int, width: int) -> Float64[np.ndarray, "h w 3"]:
    """World direction of each texel's centre."""
    angle = ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    elevation = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    level = np.cos(elevation)[:, None]
    up = np.broadcast_to(np.sin(elevation)[:, None], (height, width))
    return np.stack([level * np.sin(angle), up, -level * np.cos(angle)], -1)


def solid_angles(height: int, width: int) -> Float64[np.ndarray, " h"]:
    """Exact solid angle, in sr, of one texel of each row: a band between two latitudes, cut into `width`."""
    edges = np.sin((0.5 - np.arange(height + 1) / height) * np.pi)
    return -np.diff(edges) * 2 * np.pi / width


def project(lat_long: Float[np.ndarray, "h w 3"], bands: int) -> Float32[np.ndarray, "k 3"]:
    """SH coefficients of a lat-long radiance image per colour: every texel at its centre with its exact solid angle."""
    height, width = lat_long.shape[:2]
    weights = np.repeat(solid_angles(height, width), width)
    towards, radiance = directions(height, width).reshape(-1, 3), lat_long.reshape(-1, 3)
    total = np.zeros((sh.count(bands), 3))
    for first in range(0, len(weights), STEP):
        part = slice(first, first + STEP)
        total += sh.project(np.asarray(radiance[part], np.float64), towards[part], weights[part], bands)
    return total.astype(np.float32)


def sky(
    height: int = 256,
    *,
    sun: Sequence[float] = (0.75, 0.55, 0.45),
    sun_irradiance: Sequence[float] = (3.6, 3.1, 2.4),
    sun_sharpness: float = 16.0,
    zenith: Sequence[float] = (0.20, 0.34, 0.62),
    horizon: Sequence[float] = (0.62, 0.70, 0.78),
    ground: Sequence[float] = (0.16, 0.13, 0.10),
) -> Float32[np.ndarray, "h w 3"]:
    """A clear sky over dull ground with a soft sun from the side; linear radiance, `height` x twice that.

    `sun` points to the sun (any length); its lobe is exp(sharpness (cos - 1)), about 1 / sqrt(sharpness) rad wide, so
    that five bands still carry its shadow, and is scaled to `sun_irradiance` on a surface that faces it.
    """
    towards = directions(height, 2 * height)
    up = towards[..., 1:2]
    above = np.clip(up, 0, 1) ** 0.5
    dome = np.asarray(horizon) * (1 - above) + np.asarray(zenith) * above
    # 3 degrees of haze between sky and ground: no hard edge to alias
    share = np.clip(up / 0.1 + 0.5, 0, 1)
    share = share * share * (3 - 2 * share)
    lobe = np.exp(sun_sharpness * (towards @ _unit(sun) - 1))[..., None]
    peak = np.asarray(sun_irradiance) / _facing_irradiance(sun_sharpness)
    return (np.asarray(ground) * (1 - share) + (dome + peak * lobe) * share).astype(np.float32)


def _unit(direction: Sequence[float]) -> Float64[np.ndarray, " 3"]:
    length = float(np.linalg.norm(direction))
    if not (length > 0 and np.isfinite(length)):
        raise PrtnetError(f"light: found sun direction {list(direction)}, expected a finite vector other than 0")
    return np.asarray(direction, np.float64) / length


def _facing_irradiance(sharpness: float) -> float:
    """Integral of max(0, cos) exp(sharpness (cos - 1)) dw."""
    if not sharpness > 0:
        raise PrtnetError(f"light: found sun sharpness {sharpness}, expected more than 0")
    return 2 * np.pi * (1 / sharpness - (1 - np.exp(-sharpness)) / sharpness**2)
