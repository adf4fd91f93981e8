"""Functionals of the loss `radiance` for surfaces that are half diffuse and half glossy.

A glossy one is the radiance that a Phong lobe of exponent e mirrors into an eye, for a light L and the eye's mirrored
direction r:

    B = sum_k s_l(k) H_k Y_k(r),  H_k = sum_ij tau_ijk t_i L_j        (Ng et al. 2004; `prtnet.render.material`)

which is linear in t as a diffuse surface's is: t_i meets sum_jk tau_ijk L_j s_l(k) Y_k(r), the projection onto Y_i of
light times lobe. An eye before the surface mirrors into the half of directions about the normal, so that at each point
those functionals count whose r lies there, and count twice.
"""

from math import pi

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from prtnet import sh
from prtnet.models import functional

Array = np.ndarray


def pool(bands: int, exponent: float, seed: int) -> tuple[Float[Tensor, "p k"], Float[Tensor, "p 3"]]:
    """The functionals of a run, and r for each: the first half are diffuse, with r = 0, the others glossy.

    One factor takes the glossy ones to the mean square that the diffuse ones have on open surfaces: both halves then
    weigh the same, and `huber_delta` means the same in both.
    """
    rng = np.random.default_rng(seed)
    diffuse, lights = np.split(functional.lights(functional.POOL, bands, rng), 2)
    mirrored = rng.normal(size=(len(lights), 3))
    mirrored /= np.linalg.norm(mirrored, axis=1, keepdims=True)
    glossy = mirrored_light(lights, mirrored, exponent)
    normals = functional.sphere(256)
    open_surface = sh.cosine_lobe(normals, bands) / pi
    faces = normals @ mirrored.T >= 0
    glossy *= np.sqrt(np.mean((open_surface @ diffuse.T) ** 2) / np.mean((open_surface @ glossy.T)[faces] ** 2))
    rows, directions = np.concatenate([diffuse, glossy]), np.concatenate([np.zeros_like(mirrored), mirrored])
    return torch.from_numpy(rows.astype(np.float32)), torch.from_numpy(directions.astype(np.float32))


def mirrored_light(lights: Float[Array, "n k"], mirrored: Float[Array, "n 3"], exponent: float) -> Float[Array, "n k"]:
    """pi sum_jk tau_ijk L_j s_l(k) Y_k(r): the functional of t / pi, for each light and unit direction r."""
    bands = sh.bands_of(lights.shape[1])
    lobes = sh.evaluate(mirrored, bands) * sh.phong_lobe(exponent, bands)[sh.band_index(bands)]
    # exact for products of three
    directions, weights = sh.quadrature(3 * (bands - 1))
    basis = sh.evaluate(directions, bands)
    return pi * ((lights @ basis.T) * (lobes @ basis.T)) @ (weights[:, None] * basis)


def counts(normals: Float[Tensor, "n 3"], mirrored: Float[Tensor, "d 3"], groups: int) -> Float[Tensor, "_ d"]:
    """How much each functional counts at each group of each point: diffuse ones once, glossy ones that an eye can see
    twice. Gloss is of direct light, the first group."""
    glossy = mirrored.any(1)
    first = torch.where(glossy, 2.0 * (normals @ mirrored.T >= 0), 1.0)
    others = (~glossy).float().expand_as(first)
    return torch.stack([first] + [others] * (groups - 1), 1).flatten(0, 1)
