"""Lighting configurations: lamps near a scene, and light from far away as SH.

Everything is in unit coordinates. Lamps have no size, so their shadows are hard.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64

from prtnet import PrtnetError, sh

Array = np.ndarray
Triple = tuple[float, float, float]

LAMPS = ("point", "spot", "directional")


@dataclass(frozen=True)
class Lamp:
    """One light. `kind` is point, spot or directional."""

    kind: str
    # linear RGB: of point and spot the intensity, which makes an irradiance of colour / distance^2 on what faces them;
    # of directional that irradiance itself
    colour: Triple
    position: Triple = (0.0, 0.0, 0.0)  # unit coordinates; directional has none
    aim: Triple = (0.0, -1.0, 0.0)  # unit vector that light travels along; point has none
    # half angles of a spot in degrees: all of its intensity up to `inner`, none from `outer` on, a smooth step between
    inner: float = 20.0
    outer: float = 30.0

    def __post_init__(self) -> None:
        if self.kind not in LAMPS:
            raise PrtnetError(f"lamp: found the kind {self.kind!r}, expected one of {', '.join(LAMPS)}")
        if not 0 <= self.inner < self.outer < 90:
            raise PrtnetError(
                f"lamp: found half angles of {self.inner:g} and {self.outer:g} degrees, expected"
                " 0 <= inner < outer < 90"
            )
        if not (np.isfinite([*self.colour, *self.position]).all() and min(self.colour) >= 0):
            raise PrtnetError(f"lamp: found {self}, expected finite numbers and colours of at least 0")
        if abs(np.linalg.norm(self.aim) - 1) > 1e-4:
            raise PrtnetError(f"lamp: found an aim of length {np.linalg.norm(self.aim):.3g}, expected a unit vector")


@dataclass(frozen=True, eq=False)
class Lighting:
    """A lighting configuration: its lamps, and the SH coefficients of the radiance that arrives from far away."""

    lamps: tuple[Lamp, ...] = ()
    environment: Float32[Array, "k 3"] | None = None


def arriving(
    lamp: Lamp, positions: Float[Array, "n 3"]
) -> tuple[Float64[Array, "n 3"], Float64[Array, " n"], Float64[Array, " n"]]:
    """(unit vectors to the lamp, distances, strengths) at points; times colour and the cosine at the surface a strength
    is the irradiance where nothing is in the way. Directional lamps are infinitely far away."""
    points = np.asarray(positions, np.float64)
    if lamp.kind == "directional":
        towards = np.broadcast_to(-np.asarray(lamp.aim), points.shape)
        return towards, np.full(len(points), np.inf), np.ones(len(points))
    away = np.asarray(lamp.position) - points
    distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
    towards, strength = away / distance[:, None], 1 / distance**2
    if lamp.kind == "spot":
        outer, inner = np.cos(np.radians([lamp.outer, lamp.inner]))
        step = np.clip((-towards @ np.asarray(lamp.aim) - outer) / (inner - outer), 0, 1)
        strength = strength * step * step * (3 - 2 * step)
    return towards, distance, strength


def scaled(lighting: Lighting, factor: float | Float[Array, " 3"]) -> Lighting:
    """The same light, brighter, in all colours or in each."""
    factors = np.broadcast_to(np.asarray(factor, np.float64), 3)
    lamps = tuple(replace(lamp, colour=_triple(np.asarray(lamp.colour) * factors)) for lamp in lighting.lamps)
    distant = lighting.environment
    return Lighting(lamps, None if distant is None else (distant * factors).astype(np.float32))


def together(lightings: Sequence[Lighting]) -> Lighting:
    """All of them at once."""
    distant = [each.environment for each in lightings if each.environment is not None]
    longest = max((len(each) for each in distant), default=0)
    padded = [np.pad(each, ((0, longest - len(each)), (0, 0))) for each in distant]
    lamps = tuple(lamp for each in lightings for lamp in each.lamps)
    return Lighting(lamps, np.sum(padded, axis=0).astype(np.float32) if distant else None)


def to_dict(lighting: Lighting) -> dict[str, Any]:
    """As plain values, for keys and files. Inverse: `from_dict`."""
    distant = lighting.environment
    lamps = [asdict(lamp) for lamp in lighting.lamps]
    return {"lamps": lamps, "environment": None if distant is None else np.asarray(distant, np.float64).tolist()}


def from_dict(words: Mapping[str, Any]) -> Lighting:
    """Inverse of `to_dict`; what a lamp does not say is as in `Lamp`. Raises PrtnetError for what is no lamp."""
    try:
        lamps = tuple(_lamp(**lamp) for lamp in words["lamps"])
        distant = words.get("environment")
        found = None if distant is None else np.asarray(distant, np.float32)
    except (KeyError, TypeError, ValueError) as error:
        raise PrtnetError(f"lighting: found {words!r}, expected lamps and an environment ({error})") from None
    if found is not None:
        sh.bands_of(len(found))
    return Lighting(lamps, found)


def _lamp(
    kind: str,
    colour: Any = (1, 1, 1),
    position: Any = (0, 0, 0),
    aim: Any = (0, -1, 0),
    inner: float = 20.0,
    outer: float = 30.0,
) -> Lamp:
    return Lamp(str(kind), _triple(colour), _triple(position), _triple(aim), float(inner), float(outer))


def _triple(values: Any) -> Triple:
    x, y, z = (float(value) for value in values)
    return x, y, z
