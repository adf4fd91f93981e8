"""Fits a small network of sines to the signed distance of a mesh.

SIREN (Sitzmann et al. 2020, *Implicit Neural Representations with Periodic Activation Functions*) with the factor of
the first layer in its weights. The loss is the error relative to the distance, so that the surface counts most and far
points still allow long steps; the error of the gradient, whose direction is known from the nearest point (Gropp et al.
2020 have its length alone); and slopes above 1 once more, which sphere tracing would pay for at every step.
"""

import logging
import math
import time
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32
from torch import Tensor
from torch.nn import functional

from prtnet import PrtnetError, console
from prtnet.data import samples
from prtnet.data.implicit.neural import Neural, steepest
from prtnet.data.normals import unit
from prtnet.data.scene import IDENTITY, Frame
from prtnet.data.signed_distance import Distance
from prtnet.models.inference import one_thread
from prtnet.models.soap import Soap

log = logging.getLogger(__name__)
Array = np.ndarray

MARGIN = 0.1  # of the box about the mesh that the network knows, in unit lengths
POINTS = 1 << 18
# shares of the points: on the surface, in two shells of these standard deviations about it; the rest is in the box
SHELLS = ((0.2, 0.0), (0.25, 0.01), (0.3, 0.05))
BATCH = 1024
# standard deviation of the phase of the first layer over a unit length, about: at most, and for each neuron. Few
# neurons with many waves agree with the points and with nothing between them.
FIRST, FIRST_SHARE = 16.0, 0.25
MATRIX_RATE, RATE = 0.025, 0.02  # the highest, of SOAP and of Adam
NEAR = 0.02  # distance at which errors weigh half as much as on the surface
DIRECTION, REACH = 0.3, 0.3  # weight of the gradient's error, and the distance at which it has halved
OVER = 1.0  # weight of slopes above 1
SLACK = 1.05  # of the greatest slope found


@dataclass(frozen=True, eq=False)
class Shells:
    """Points about a mesh with their signed distances and the unit gradients there, in its unit coordinates."""

    positions: Float32[Array, "n 3"]
    distances: Float32[Array, " n"]
    gradients: Float32[Array, "n 3"]


def box_of(distance: Distance) -> tuple[float, float, float]:
    """Half the box about the origin that a network of the mesh knows."""
    x, y, z = np.abs(distance.scene.vertices).max(axis=0) + MARGIN
    return float(x), float(y), float(z)


def shells(distance: Distance, count: int, rng: np.random.Generator) -> Shells:
    """At most `count` points, dense about the surface that is seen from outside.

    Raises PrtnetError for a mesh without an inside.
    """
    half = np.array(box_of(distance))
    points = samples.area_uniform(distance.scene, count, rng).positions.copy()
    first = 0
    for share, deviation in SHELLS:
        last = first + round(share * count)
        points[first:last] += deviation * rng.normal(size=(last - first, 3))
        first = last
    points[first:] = rng.uniform(-1, 1, (count - first, 3)) * half
    points = np.clip(points, -half, half)
    signed, found = distance.signed(points, rng)
    gradients = unit(points - found.where) * np.where(signed < 0, -1, 1)[:, None]
    # too near for a direction: that of the triangle
    near = np.abs(signed) < 1e-4
    gradients[near] = distance.scene.face_normals[found.face[near]]
    # what is within the solid is no surface of it, and no depth is measured from there
    below = np.flatnonzero(near | (signed < 0))
    seen = np.ones(count, bool)
    seen[below] = ~distance.hidden(found.at(below), rng)
    return Shells(*(each[seen].astype(np.float32) for each in (points, signed, gradients)))


@dataclass(frozen=True)
class Fit:
    """A network, with the CPU time of its points and steps."""

    field: Neural
    cpu_seconds: float


def fit(distance: Distance, *, width: int, depth: int, steps: int, seed: int, frame: Frame = IDENTITY) -> Fit:
    """A network of `depth` hidden layers of `width` after exactly `steps` steps; `frame` only goes into it.

    Its `lipschitz` is the greatest slope that `steepest` finds and a margin of SLACK, at least 1. The same arguments
    give the same network. Raises PrtnetError where the fit diverges or the network has no surface.
    """
    rng = np.random.default_rng(seed)
    started = time.process_time()
    data = [torch.tensor(each) for each in vars(shells(distance, POINTS, rng)).values()]
    generator = torch.Generator().manual_seed(seed)
    layers = _initial(width, depth, generator)
    optimisers = [
        Soap([weight for weight, _ in layers], lr=MATRIX_RATE, decay=0.0),
        torch.optim.Adam([bias for _, bias in layers], lr=RATE),
    ]
    highest = [group["lr"] for each in optimisers for group in each.param_groups]
    with one_thread(), console.progress("neural distance", steps, "steps") as reach:
        for step in range(steps):
            for each, rate in zip(optimisers, highest, strict=True):
                each.param_groups[0]["lr"] = rate * _share(step, steps)
                each.zero_grad()
            pick = torch.randint(len(data[0]), (BATCH,), generator=generator)
            loss = _loss(layers, *(each[pick] for each in data))
            if not torch.isfinite(loss):
                raise PrtnetError(
                    f"neural distance: the fit of {distance.scene.name} diverged at step {step} of {steps}: found a "
                    "loss that is no number; take another seed (sdf.seed)"
                )
            loss.backward()
            for each in optimisers:
                each.step()
            reach(step + 1)
    field = _finished(layers, distance, frame, steps, rng)
    seconds = time.process_time() - started
    log.info("neural distance: %s of CPU time, slopes up to %.3f", console.duration(seconds), field.lipschitz)
    return Fit(field, seconds)


Layers = list[tuple[Tensor, Tensor]]


def _initial(width: int, depth: int, generator: torch.Generator) -> Layers:
    layers, inputs = [], 3
    for i, outputs in enumerate([*[width] * depth, 1]):
        spread = min(FIRST, FIRST_SHARE * width) if i == 0 else 1.0
        weight = torch.randn(outputs, inputs, generator=generator) * spread / math.sqrt(inputs)
        # any phase of a wave
        bias = (2 * torch.rand(outputs, generator=generator) - 1) * (math.pi if i < depth else 0.0)
        layers.append((weight.requires_grad_(), bias.requires_grad_()))
        inputs = outputs
    return layers


def _share(step: int, steps: int) -> float:
    """Of the highest rate: a short rise, then a cosine."""
    done, rise = (step + 1) / steps, 0.02
    return done / rise if done < rise else 0.5 * (1 + math.cos(math.pi * (done - rise) / (1 - rise)))


def _loss(layers: Layers, positions: Tensor, distances: Tensor, gradients: Tensor) -> Tensor:
    positions = positions.clone().requires_grad_()
    h = positions
    for weight, bias in layers[:-1]:
        h = torch.sin(functional.linear(h, weight, bias))
    found = functional.linear(h, *layers[-1])[:, 0]
    (slopes,) = torch.autograd.grad(found.sum(), positions, create_graph=True)
    far = distances.abs()
    relative = (found - distances).abs() / (far / NEAR + 1)
    # the root is smooth at 0
    turned = ((slopes - gradients).square().sum(1) + 1e-4).sqrt() / (1 + far / REACH)
    over = functional.relu(slopes.norm(dim=1) - 1).square()
    return 10 * relative.mean() + DIRECTION * turned.mean() + OVER * over.mean()


def _finished(layers: Layers, distance: Distance, frame: Frame, steps: int, rng: np.random.Generator) -> Neural:
    weights, biases = zip(*((w.detach().numpy(), b.detach().numpy()) for w, b in layers), strict=True)
    half = box_of(distance)
    field = Neural(weights, biases, half, 1.0, frame)
    values = field.distance(rng.uniform(-1, 1, (1 << 15, 3)) * np.array(half))
    if values.min() >= 0 or values.max() <= 0:
        raise PrtnetError(
            f"neural distance: the fit of {distance.scene.name} found no surface in {steps} steps: all distances are "
            f"between {values.min():.3g} and {values.max():.3g}, expected both signs; raise sdf.width or sdf.steps"
        )
    slope = max(1.0, SLACK * float(steepest(field, rng)[0]))
    return Neural(weights, biases, half, slope, frame)
