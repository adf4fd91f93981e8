"""Random lighting configurations of a named scenario.

Belcour, Deliot, Barbier and Soler 2022, *A Data-Driven Paradigm for Precomputed Radiance Transfer*, section 4: lights
of one kind, at random places, that a scene is learned under.
"""

from collections.abc import Sequence
from math import pi, sqrt

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError, sh
from prtnet.data.lighting.lamp import LAMPS, Lamp, Lighting, scaled
from prtnet.data.lighting.reach import Reach
from prtnet.data.normals import unit
from prtnet.data.scene import Scene
from prtnet.data.tracer import Tracer

Array = np.ndarray

SCENARIOS = (*LAMPS, "environment")
COLOURS = ("white", "random")
TRIES = 256  # drawings of one configuration
LEAST = 6  # of the points that the scene is judged by are lit
HALF_ANGLES = (20.0, 50.0)  # degrees, of spots
SOFT = (0.5, 0.9)  # share of a spot's cone that has all of its intensity
FROM_ABOVE = 0.9  # share of directional lights
BRIGHTNESS = (0.5, 2.0)  # mean irradiance of what is lit; of environments their mean radiance
SATURATION = (0.4, 1.0)
LOBES = 4  # of an environment, at most
SHARPNESS = (2.0, 16.0)  # of its lobes exp(s (cos - 1))
WINDOW = 1.25  # times as many bands as there are, of Hann's
AMBIENT = (0.1, 0.6)  # share of an environment that is the same in all directions


def check(kinds: Sequence[str], colours: str) -> None:
    """Raises PrtnetError for a kind of light or of colours that there is not."""
    if not kinds or set(kinds) - set(SCENARIOS):
        raise PrtnetError(f"data_driven.scenario: found {list(kinds)}, expected one or more of {', '.join(SCENARIOS)}")
    if colours not in COLOURS:
        raise PrtnetError(f"data_driven.colours: found {colours!r}, expected {' or '.join(COLOURS)}")


def draw(
    kinds: Sequence[str],
    count: int,
    scene: Scene,
    tracer: Tracer,
    rng: np.random.Generator,
    *,
    colours: str = "white",
    bands: int = 5,
) -> list[Lighting]:
    """`count` configurations of one light each, of these kinds in turns, for a scene in unit coordinates.

    Each of them lights some of the scene. Environments have SH of `bands`. The first of many are those of few. Raises
    PrtnetError where a scenario finds no light that reaches the scene.
    """
    check(kinds, colours)
    reach = Reach(scene.centred(), tracer, np.random.default_rng(rng.integers(1 << 32)))
    return [_one(kinds[i % len(kinds)], reach, rng, colours, bands) for i in range(count)]


def _one(kind: str, reach: Reach, rng: np.random.Generator, colours: str, bands: int) -> Lighting:
    brightness = _between(BRIGHTNESS, rng)
    if kind == "environment":
        if not reach.sees_out():
            raise _unlit(kind, reach)
        return Lighting((), (brightness * _environment(rng, colours, bands)).astype(np.float32))
    colour = _colour(colours, rng)
    for _ in range(TRIES):
        lamp = _directional(rng) if kind == "directional" else _near(kind, reach, rng)
        if lamp is None:
            continue
        received = reach.irradiance(lamp)
        # a spot sees what it is aimed at, and may be narrow
        if np.count_nonzero(received) >= (1 if kind == "spot" else LEAST):
            return scaled(Lighting((lamp,)), brightness / received[received > 0].mean() * colour)
    raise _unlit(kind, reach)


def _unlit(kind: str, reach: Reach) -> PrtnetError:
    return PrtnetError(
        f"data_driven.scenario: found no {kind} light that reaches the scene {reach.scene.name}, expected a scene that"
        " is open to it; choose another scenario"
    )


def _directional(rng: np.random.Generator) -> Lamp:
    x, y, z = _random_direction(rng).tolist()
    # travels downwards where it comes from above
    return Lamp("directional", (1, 1, 1), aim=(x, -abs(y) if rng.random() < FROM_ABOVE else y, z))


def _near(kind: str, reach: Reach, rng: np.random.Generator) -> Lamp | None:
    """A point lamp, or a spot that is aimed at a surface point it sees; None where the place sees none."""
    x, y, z = reach.place().tolist()
    point = Lamp("point", (1, 1, 1), (x, y, z))
    if kind == "point":
        return point
    seen = np.flatnonzero(reach.irradiance(point))
    if not len(seen):
        return None
    i, j, k = unit(reach.points.positions[rng.choice(seen, 1)] - [x, y, z])[0].tolist()
    outer = float(rng.uniform(*HALF_ANGLES))
    return Lamp("spot", (1, 1, 1), (x, y, z), (i, j, k), outer * float(rng.uniform(*SOFT)), outer)


def _environment(rng: np.random.Generator, colours: str, bands: int) -> Float[Array, "k 3"]:
    """SH of smooth lobes and of what comes from everywhere alike, of mean radiance 1, damped against ringing."""
    total = np.zeros((sh.count(bands), 3))
    for _ in range(rng.integers(1, LOBES + 1)):
        along = (
            sh.evaluate(_random_direction(rng), bands) * _zonal(_between(SHARPNESS, rng), bands)[sh.band_index(bands)]
        )
        total += rng.uniform(0.2, 1) * along[:, None] * _colour(colours, rng)
    ambient = rng.uniform(*AMBIENT)
    total *= (1 - ambient) * sqrt(4 * pi) / total[0].mean()
    total[0] += ambient * sqrt(4 * pi) * _colour(colours, rng)
    return total * sh.window("hann", WINDOW * bands, bands)[sh.band_index(bands), None]


def _zonal(sharpness: float, bands: int) -> Float[Array, " bands"]:
    """f_l = 2 pi integral of exp(s (t - 1)) P_l(t) dt, for SH f_l Y_i(axis) (Funk and Hecke)."""
    nodes, weights = np.polynomial.legendre.leggauss(48)
    values = np.exp(sharpness * (nodes - 1)) * weights
    return 2 * pi * np.polynomial.legendre.legvander(nodes, bands - 1).T @ values


def _random_direction(rng: np.random.Generator) -> Float[Array, " 3"]:
    return unit(rng.normal(size=(1, 3)))[0]


def _between(bounds: tuple[float, float], rng: np.random.Generator) -> float:
    """Even on a logarithmic scale."""
    return float(np.exp(rng.uniform(*np.log(bounds))))


def _colour(colours: str, rng: np.random.Generator) -> Float[Array, " 3"]:
    """Linear RGB of mean 1."""
    if colours == "white":
        return np.ones(3)
    hue, saturation = rng.uniform(0, 6), rng.uniform(*SATURATION)
    pure = np.clip(np.abs((hue + np.array([0.0, 4.0, 2.0])) % 6 - 3) - 1, 0, 1)
    mixed = 1 - saturation + saturation * pure
    return mixed / mixed.mean()
