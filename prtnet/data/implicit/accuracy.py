"""What it costs to trace rays against the mesh of an implicit surface instead of the surface itself."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prtnet.data import transfer
from prtnet.data.implicit.march import MarchTracer
from prtnet.data.samples import Samples, select
from prtnet.data.tracer import Tracer

Array = np.ndarray
POINTS, DIRECTIONS = 2000, 256


@dataclass(frozen=True)
class Error:
    """Of SH coefficients at `points` points: root mean square relative to that of the exact ones, and the largest
    difference of one coefficient (an open sky has 0.886 in the first)."""

    relative: float
    worst: float
    points: int


def measured_error(
    quick: Tracer,
    exact: MarchTracer,
    samples: Samples,
    *,
    bands: int = 5,
    directions: int = DIRECTIONS,
    points: int = POINTS,
) -> Error:
    """How far transfer by `quick` is from that by `exact`, at the first `points` of the samples.

    Both trace the same directions, so that what differs is visibility alone. Samples in the coordinates of the tracers,
    on the surface itself (`project.projected`), in random order.
    """
    few = select(samples, np.arange(min(points, len(samples.positions))))
    first, second = (baked(tracer, few, bands, directions) for tracer in (quick, exact))
    return compared(first, second)


def compared(found: Float[Array, "n k"], expected: Float[Array, "n k"]) -> Error:
    """The error of coefficients."""
    difference = found.astype(np.float64) - expected
    size = np.sqrt(np.mean(np.square(expected, dtype=np.float64)))
    relative = float(np.sqrt(np.mean(difference**2)) / size) if size > 0 else 0.0
    return Error(relative, float(np.abs(difference).max(initial=0)), len(found))


def baked(tracer: Tracer | MarchTracer, few: Samples, bands: int, directions: int) -> Float[Array, "n k"]:
    """Transfer of the samples, the same directions for every tracer."""
    return transfer.bake(
        tracer,
        few.positions,
        few.normals,
        bands=bands,
        directions=directions,
        rng=np.random.default_rng(0),
        geometric_normals=few.geometric_normals,
    )
