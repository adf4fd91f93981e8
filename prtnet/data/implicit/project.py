"""Points moved onto a surface: Newton steps along the gradient, float64."""

import logging
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError
from prtnet.data.implicit.field import Field, unit_gradient
from prtnet.data.samples import Samples
from prtnet.data.scene import IDENTITY, Frame

log = logging.getLogger(__name__)
Array = np.ndarray

# unit lengths: where a point counts as being on the surface
ON_SURFACE = 1e-7
STEPS = 36  # three do where the surface is smooth; at creases two surfaces pull in turn
REUSED = 3  # steps along one gradient, which costs several distances
LARGEST_SHARE_OFF = 1e-3


def onto(field: Field, points: Float[Array, "n 3"], *, furthest: float) -> Float[Array, "n 3"]:
    """Points (unit coordinates) moved to where the distance is 0, by at most `furthest` in each step.

    p - d g / |g|^2, until |d| < ON_SURFACE; where that never happens, the nearest point on the way.
    """
    best = np.asarray(points, np.float64).copy()
    distance = field.distance(best)
    error = np.abs(distance)
    moving = np.flatnonzero(error >= ON_SURFACE)
    at, distance, slope = best[moving], distance[moving], best[moving]
    for step in range(STEPS):
        if not len(moving):
            break
        if step % REUSED == 0:
            slope = field.gradient(at)
            slope /= np.maximum(np.einsum("ni,ni->n", slope, slope), 1e-12)[:, None]
        move = distance[:, None] * slope
        length = np.linalg.norm(move, axis=1, keepdims=True)
        at = at - move * np.minimum(1, furthest / np.maximum(length, 1e-300))
        distance = field.distance(at)
        nearer = np.abs(distance) < error[moving]
        best[moving[nearer]], error[moving[nearer]] = at[nearer], np.abs(distance[nearer])
        still = np.abs(distance) >= ON_SURFACE
        moving, at, distance, slope = moving[still], at[still], distance[still], slope[still]
    return best


def projected(field: Field, samples: Samples, frame: Frame = IDENTITY, *, furthest: float = 0.05) -> Samples:
    """Samples of a surface's mesh, on the surface itself: positions moved there, both normals those of the gradient.

    `frame` leads from the samples' coordinates to the field's. Faces and weights stay those of the mesh.
    Raises PrtnetError where more than one point in a thousand finds no surface.
    """
    points = onto(field, frame.to_unit(samples.positions), furthest=furthest)
    error = np.abs(field.distance(points))
    lost = int(np.sum(~(error < 1e-6)))
    if lost > LARGEST_SHARE_OFF * len(points):
        raise PrtnetError(
            f"implicit surface: {lost} of {len(points)} points of its mesh are up to {error.max():.2g} off the surface "
            "after projection, expected below 1e-6: is its distance continuous, with a gradient?"
        )
    if lost:
        log.warning("implicit surface: %d of %d points stay up to %.2g off it", lost, len(points), error.max())
    normals = unit_gradient(field, points).astype(np.float32)
    return replace(samples, positions=frame.from_unit(points), normals=normals, geometric_normals=normals)
