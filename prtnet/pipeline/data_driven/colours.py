"""Lights in colours that were not learned from, and what they do to an operator on all colours at once."""

from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float64

from prtnet import PrtnetError
from prtnet.models.data_driven import DARK, Pairs, basis_of, ridge_of
from prtnet.pipeline.data_driven.errors import norms

Array = np.ndarray

# what a white light is turned into, to ask of colours that were not learned from: two that no surface has
TINTS = ((1.0, 0.15, 0.05), (0.05, 0.3, 1.0), (0.2, 1.0, 0.1))


def tinted(pairs: Pairs) -> Pairs:
    """The same lights in saturated colours, in turns. Exact: no transport here changes the colour of light, so that a
    channel of a lightmap is proportional to that channel of the light."""
    tints = np.asarray([TINTS[number % len(TINTS)] for number in range(len(pairs.direct))], np.float32)[:, None]
    return replace(pairs, lightmaps=pairs.lightmaps * tints, direct=pairs.direct * tints)


def joint(training: Pairs, unseen: Pairs, coloured: Pairs, elements: int, ridge: float) -> dict[str, Any]:
    """Errors of an operator from the 3 m direct values of all colours to 3 t texels; one for all keyframes."""
    light, maps, weight = _in_one(training)
    lit = weight > 0
    try:
        basis, c = basis_of(maps[lit] * weight[lit, None], elements)
    except PrtnetError:
        return {}
    matrix = ridge_of(c, (light[lit] * weight[lit, None]).T, ridge)
    found: dict[str, Any] = {"channels": "joint", "gamma": 1.0}
    for name, pairs in {"training": training, "unseen": unseen, "coloured": coloured}.items():
        light, wanted, _ = _in_one(pairs)
        found[name] = _relative((light @ matrix.T) @ basis, wanted, pairs)
        found |= {"projection": _relative((wanted @ basis.T) @ basis, wanted, pairs)} if name == "unseen" else {}
    return found


def _relative(made: Float64[Array, "c _"], wanted: Float64[Array, "c _"], pairs: Pairs) -> float:
    """The error of lightmaps that have the values of all colours in a row."""
    sizes = norms(pairs.direct)[:, None]
    weight = np.divide(1, sizes, out=np.zeros_like(sizes), where=sizes > 0)
    scaled = [(each.reshape(len(each), -1, 3) * weight) for each in (made - wanted, wanted)]
    return float(np.linalg.norm(scaled[0]) / max(np.linalg.norm(scaled[1]), 1e-30))


def _in_one(pairs: Pairs) -> tuple[Float64[Array, "c _"], Float64[Array, "c _"], Float64[Array, " c"]]:
    """Direct vectors and lightmaps with the values of all colours in a row, and one over the norm of the former, 0 of
    dark ones."""
    light, maps = (each.reshape(len(each), -1).astype(np.float64) for each in (pairs.direct, pairs.lightmaps))
    size = np.linalg.norm(light, axis=1)
    lit = size > DARK * max(size.max(initial=0.0), 1e-30)
    return light, maps, np.where(lit, 1 / np.where(lit, size, 1), 0)
