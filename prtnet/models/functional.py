"""Losses on what the coefficients are for: a norm of linear functionals of their error, some drawn for each step.

projection  the error of the transfer as a function on the sphere, sum_i e_i Y_i(w), in uniform directions w.
radiance    the error of a diffuse surface of albedo 1, sum_i e_i L_i for e the error of t / pi, under lights L; or of
            half a glossy one (`gloss`).

Both see errors of coefficients together, as a picture does, and do not depend on how the axes lie, which L1 and Huber
norms of single coefficients do. With the norm l2 there is nothing to gain. The basis is orthonormal, so the mean
square over the sphere is the sum of squares of the coefficients (Parseval): `projection` is the loss l2, with noise.
And the lights have no preferred direction, so `radiance` is l2 with a weight for each band, their mean power in it.
"""

from math import pi, sqrt

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from prtnet import sh
from prtnet.models.loss import rho

Array = np.ndarray

KINDS = ("projection", "radiance")
POOL = 8192  # functionals of a run, of which each step draws some
_CHUNK = 1 << 22  # values held at a time


def pool(kind: str, bands: int, seed: int) -> Float[Tensor, "p k"]:
    """The functionals of a run as rows: their values are dot products with the coefficients of t / pi.

    Those of `projection` are scaled so that its mean square is that of the coefficients.
    """
    if kind == "radiance":
        rows = lights(POOL, bands, np.random.default_rng(seed))
    else:
        rows = sh.evaluate(sphere(POOL), bands) * sqrt(4 * pi / sh.count(bands))
    return torch.from_numpy(rows.astype(np.float32))


def lights(count: int, bands: int, rng: np.random.Generator) -> Float[Array, "n k"]:
    """SH coefficients of random grey lights: a disc in a sky of constant radiance, damped by no window.

    The disc's centre is uniform on the sphere, its angular radius between 2 and 90 degrees, uniform in the logarithm,
    and the sky's share uniform in [0, 1]. Each light gives radiance 1 to an open diffuse surface of albedo 1 that
    faces the disc (but for what the bands cut off).
    """
    axes = rng.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    radius = np.radians(np.exp(rng.uniform(np.log(2), np.log(90), count)))
    share = rng.uniform(0, 1, count)
    # irradiance pi: the disc's radiance is 1 / sin^2 of its radius
    zonal = _disc_zonal(radius, bands) / np.sin(radius)[:, None] ** 2
    coefficients = (1 - share)[:, None] * sh.evaluate(axes, bands) * zonal[:, sh.band_index(bands)]
    coefficients[:, 0] += share * sqrt(4 * pi)
    return coefficients


def _disc_zonal(radius: Float[Array, " n"], bands: int) -> Float[Array, "n bands"]:
    """2 pi times the integral of P_l(t) over [cos radius, 1], which is (P_{l-1} - P_{l+1}) / (2 l + 1) at its foot."""
    legendre = np.polynomial.legendre.legvander(np.cos(radius), bands)
    order = np.arange(1, bands)
    rest = (legendre[:, :-2] - legendre[:, 2:]) / (2 * order + 1)
    return 2 * pi * np.concatenate([1 - np.cos(radius)[:, None], rest], axis=1)


def sphere(count: int) -> Float[Array, "n 3"]:
    """A Fibonacci lattice on the whole sphere."""
    index = np.arange(count) + 0.5
    height, turn = 1 - 2 * index / count, index * pi * (3 - sqrt(5))
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)


def draw(functionals: Float[Tensor, "p k"], count: int, seed: int, step: int) -> Float[Tensor, "d k"]:
    """The functionals of one step, which follow from the seed and the step alone."""
    generator = torch.Generator().manual_seed(seed * 1_000_003 + step)
    chosen = torch.randint(len(functionals), (count,), generator=generator)
    return functionals[chosen.to(functionals.device)]


def loss(
    predicted: Float[Tensor, "n c"],
    target: Float[Tensor, "n c"],
    functionals: Float[Tensor, "d k"],
    *,
    kind: str,
    delta: float,
    bands: Float[Tensor, " c"] | None = None,
    points: Float[Tensor, " n"] | None = None,
    counts: Float[Tensor, "_ d"] | None = None,
) -> Float[Tensor, ""]:
    """Mean over points, groups of coefficients and functionals of weighted rho(functional(predicted - target)).

    `counts` are weights of functionals at each group of each point. Weights of bands scale the coefficients by their
    roots, so that they mean the same as in the loss l2. However many values there are, `_CHUNK` of them are held at a
    time, and found again for the gradient.
    """
    error = predicted.float() - target
    error = error if bands is None else error * bands.sqrt()
    k = functionals.shape[1]
    groups = error.shape[1] // k
    weights = torch.ones(len(error), device=error.device) if points is None else points
    # a row for each group of a point
    error, weights = error.reshape(-1, k), weights.repeat_interleave(groups)
    rows = max(1, _CHUNK // len(functionals))
    if len(error) <= rows:
        return _total(error, weights, functionals, kind, delta, counts) / (len(error) * len(functionals))
    total = error.new_zeros(())
    for first in range(0, len(error), rows):
        part = slice(first, first + rows)
        own = None if counts is None else counts[part]
        arguments = (error[part], weights[part], functionals, kind, delta, own)
        total = total + checkpoint(_total, *arguments, use_reentrant=False, preserve_rng_state=False)
    return total / (len(error) * len(functionals))


def _total(
    error: Float[Tensor, "n k"],
    weights: Float[Tensor, " n"],
    functionals: Float[Tensor, "d k"],
    kind: str,
    delta: float,
    counts: Float[Tensor, "n d"] | None,
) -> Float[Tensor, ""]:
    values = error @ functionals.T
    zero = values.new_zeros(()).expand_as(values)
    norms = rho(kind, values, zero, delta)
    norms = norms if counts is None else norms * counts
    return (norms.sum(1) * weights).sum()
