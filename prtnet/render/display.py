"""How pictures are shown: a tone curve, bloom, and reflections of the light. Scores never see any of it.

All work on linear RGB "h w 3"; curve and bloom on radiance times the exposure, where 1 is the brightest that a screen
shows. The sRGB encoding comes after them.
"""

from dataclasses import dataclass
from math import inf, log2, pi, sqrt

import numpy as np
from jaxtyping import Float, Float64

from prtnet import PrtnetError
from prtnet.data import light_sampler, mapping
from prtnet.data.light import Light
from prtnet.render.gbuffer import GBuffer
from prtnet.render.material import mirrored

Array = np.ndarray
Image = Float[Array, "h w 3"]

TONES = ("linear", "reinhard", "exposure")
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear sRGB
WHITE = 4.0  # the least luminance that the Reinhard curve shows as white
THRESHOLD = 1.0  # bloom is of what exceeds the screen
OPEN = sqrt(pi) / 2  # t_0 of a point that sees its whole hemisphere


@dataclass(frozen=True)
class Display:
    """The choices. Raises PrtnetError, naming the configuration's key, for what cannot be."""

    tone: str = "linear"
    bloom: float = 0.0  # share of the light above the screen's white that spreads, 0 to 1
    highlights: float = 0.0  # weight of the light mirrored in every surface, 0 or more

    def __post_init__(self) -> None:
        if self.tone not in TONES:
            raise PrtnetError(f"render.tone: found {self.tone!r}, expected one of {', '.join(TONES)}")
        if not 0 <= self.bloom <= 1:
            raise PrtnetError(f"render.bloom: found {self.bloom}, expected a share from 0 to 1")
        if not 0 <= self.highlights < inf:
            raise PrtnetError(f"render.highlights: found {self.highlights}, expected a finite weight of 0 or more")

    def check(self, light: Light) -> None:
        """Raises PrtnetError for highlights of a light that is no radiance anywhere."""
        if self.highlights and light.image is None and (light.beam is None or light.beam.depth == 0):
            raise PrtnetError(
                f"render.highlights: found {self.highlights} with light {light.name}, which comes from a single "
                "direction and has no image to mirror; expected 0, or light=sun, a disc"
            )


def show(display: Display, linear: Image, exposure: float) -> Float64[Array, "h w 3"]:
    """Linear values in [0, 1], to be sRGB-encoded: exposed, bloomed, through the curve. Ringing below 0 is clipped."""
    exposed = np.maximum(exposure * np.asarray(linear, np.float64), 0)
    return tone(bloom(exposed, display.bloom), display.tone)


def tone(exposed: Float[Array, "*n 3"], curve: str) -> Float64[Array, "*n 3"]:
    """Colours of 0 or more into [0, 1], never falling where they rise.

    linear clips. reinhard scales each colour by its luminance, L (1 + L / WHITE^2) / (1 + L) (Reinhard et al. 2002,
    *Photographic Tone Reproduction for Digital Images*, eq. 4). exposure is that of film, 1 - exp(-x) per channel.
    """
    exposed = np.asarray(exposed, np.float64)
    if curve == "exposure":
        return -np.expm1(-exposed)
    if curve == "reinhard":
        luminance = (exposed @ LUMINANCE)[..., None]
        exposed = exposed * (1 + luminance / WHITE**2) / (1 + luminance)
    return np.minimum(exposed, 1)


def bloom(exposed: Image, strength: float) -> Float64[Array, "h w 3"]:
    """The light above THRESHOLD, a share `strength` of it, spread by the mean of the levels of a Gaussian pyramid
    (Burt and Adelson 1983, *The Laplacian Pyramid as a Compact Image Code*).

    No light is made and none is lost but over the border. The widest level spans about an eighth of the frame.
    """
    exposed = np.asarray(exposed, np.float64)
    bright = np.maximum(exposed - THRESHOLD, 0)
    if not strength or not bright.any():
        return exposed
    levels = max(1, round(log2(min(exposed.shape[:2]))) - 3)
    spread, level, shapes = np.zeros_like(bright), bright, []
    for _ in range(levels):
        shapes.append(level.shape)
        level = _halved(level)
        wide = level
        for shape in reversed(shapes):
            wide = _doubled(wide, shape)
        spread += wide / levels
    return exposed + strength * (spread - bright)


def _smooth(image: Float64[Array, "h w 3"], axis: int) -> Float64[Array, "h w 3"]:
    """The kernel (1, 4, 6, 4, 1) / 16 along an axis, black beyond the border."""
    edges = [(2, 2) if each == axis else (0, 0) for each in range(3)]
    padded, count = np.pad(image, edges), image.shape[axis]
    parts = [np.take(padded, range(start, start + count), axis=axis) for start in range(5)]
    return (parts[0] + parts[4]) / 16 + (parts[1] + parts[3]) / 4 + parts[2] * 0.375


def _halved(image: Float64[Array, "h w 3"]) -> Float64[Array, "h2 w2 3"]:
    return _smooth(_smooth(image, 0), 1)[::2, ::2]


def _doubled(image: Float64[Array, "h w 3"], shape: tuple[int, ...]) -> Float64[Array, "h2 w2 3"]:
    """To a shape about twice as large, with the sum that the image stands for: 4 pixels each."""
    wide = np.zeros(shape)
    wide[::2, ::2] = 4 * image
    return _smooth(_smooth(wide, 0), 1)


def highlights(
    light: Light, gbuffer: GBuffer, transfer: Float[Array, "n k"], strength: float
) -> Float64[Array, "size size 3"]:
    """`strength` times the light in the mirrored direction at every covered pixel, linear RGB, times t_0 of direct
    transfer over that of an open point: what is in shadow does not shine. Only the light is mirrored, no surface."""
    towards = np.asarray(gbuffer.eye) - gbuffer.positions.astype(np.float64)
    directions = mirrored(towards, gbuffer.normals)
    if light.image is not None:
        radiance = mapping.sample("lat_long", light.image[None], directions)
    else:
        radiance = light_sampler.of_light(light).radiance(directions)
    image = np.zeros((gbuffer.size * gbuffer.size, 3))
    image[gbuffer.pixel] = strength * radiance * np.clip(transfer[:, 0].astype(np.float64) / OPEN, 0, 1)[:, None]
    return image.reshape(gbuffer.size, gbuffer.size, 3)
