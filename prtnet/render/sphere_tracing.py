"""Sphere tracing of a camera's rays (Hart 1996, *Sphere Tracing*) in float64: the plain twin of march.frag.glsl.

A ray begins where it enters the unit cube grown by a margin, and walks distance / lipschitz at a time. It has met the
surface when the distance is below NEAR of what its pixel covers there, so that outlines grow by no more than that; a
ray that runs out of steps has, when it is within a pixel. Steps of Newton along the ray then take the point to the
surface, and the last one goes along the gradient, for rays that only come near.
"""

import numpy as np
from jaxtyping import Bool, Float64

from prtnet.data.implicit.field import Field
from prtnet.render.camera import Camera
from prtnet.render.transfer_map import pixel_angle

Array = np.ndarray

BOX = 1.01  # half the side of the cube that rays are followed in
NEAR = 0.05  # pixels
LEAST = 1e-5  # the least distance that float32 tells from 0
GRAZING = 0.1  # the least slope of the distance along a ray that Newton's method is told
STEPS, REFINEMENTS = 256, 3


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
    hit = (t <= leave) & (found <= np.maximum(pixel * (enter + t), LEAST))
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
    return projected(field, points)


def projected(field: Field, points: Float64[Array, "n 3"], steps: int = 1) -> Float64[Array, "n 3"]:
    """Points near the surface moved to it along the gradient."""
    for _ in range(steps):
        slope = field.gradient(points)
        squared = np.maximum(np.einsum("ni,ni->n", slope, slope), 1e-12)
        points = points - (field.distance(points) / squared)[:, None] * slope
    return points
