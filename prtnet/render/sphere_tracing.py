"""Sphere tracing of a camera's rays in float64: the plain twin of `prtnet.export.sphere_tracing`."""

import numpy as np
from jaxtyping import Bool, Float64

from prtnet.data.implicit.field import Field
from prtnet.export.sphere_tracing import BOX, GRAZING, LEAST, NEAR, REFINEMENTS, STEPS
from prtnet.render.camera import Camera
from prtnet.render.transfer_map import pixel_angle

Array = np.ndarray


def met(
    field: Field, camera: Camera, size: int, *, steps: int = STEPS, refinements: int = REFINEMENTS
) -> tuple[Float64[Array, "p 3"], Bool[Array, " p"]]:
    """(points, whether the ray met any) of the pixels of a square frame, row by row from the top."""
    rays, eye = camera.rays(size).reshape(-1, 3), np.asarray(camera.eye, np.float64)
    pixel = pixel_angle(camera, size)
    apart = np.where(np.abs(rays) < 1e-20, 1e-20, rays)
    low, high = (-BOX - eye) / apart, (BOX - eye) / apart
    enter = np.maximum(np.minimum(low, high).max(axis=1), 0)
    leave = np.maximum(low, high).min(axis=1) - enter
    start = eye + enter[:, None] * rays
    t, found = np.zeros(len(rays)), np.full(len(rays), np.inf)
    going = np.flatnonzero(leave >= 0)
    for step in range(steps):
        t[going] += found[going] / field.lipschitz if step else 0
        found[going] = field.distance(start[going] + t[going, None] * rays[going])
        near = np.maximum(NEAR * pixel * (enter + t), LEAST)
        going = going[(t[going] <= leave[going]) & (found[going] > near[going])]
        if not len(going):
            break
    inside = (t == 0) & (found < -LEAST)
    hit = ~inside & (t <= leave) & (found <= np.maximum(pixel * (enter + t), LEAST))
    points = np.zeros_like(start)
    points[hit] = refined(field, start[hit] + t[hit, None] * rays[hit], rays[hit], refinements)
    return points, hit


def refined(
    field: Field, points: Float64[Array, "n 3"], rays: Float64[Array, "n 3"], refinements: int
) -> Float64[Array, "n 3"]:
    """Points near the surface moved to it: by Newton's method along their rays, then once along the gradient."""
    for _ in range(refinements):
        slope = np.einsum("ni,ni->n", field.gradient(points), rays)
        points = points - (field.distance(points) / np.minimum(slope, -GRAZING))[:, None] * rays
    slope = field.gradient(points)
    squared = np.maximum(np.einsum("ni,ni->n", slope, slope), 1e-12)
    return points - (field.distance(points) / squared)[:, None] * slope
