"""Real spherical harmonics: the conventions page.

Every other file agrees with this one:

* real and orthonormal on the sphere, integral of Y_i Y_j dw = delta_ij;
* index i = l*l + l + m, from 0, so `bands` b means l = 0 .. b-1 and k = b*b coefficients;
* no Condon-Shortley phase: Y_1 = sqrt(3/4pi) (y, z, x);
* evaluated on the world axes x, y, z. The pole is world z, although "up" is y: turning a light about y is a
  general rotation.

Arrays go in and come out in the floating type they came in; all sums are taken in float64.
"""

from functools import lru_cache
from math import comb, pi, sqrt

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from prtnet import PrtnetError

WINDOWS = ("none", "hann", "lanczos")

Array = np.ndarray
Values = np.ndarray | np.floating | float  # one direction alone gives scalars


def count(bands: int) -> int:
    """Number of coefficients of `bands` bands."""
    if bands < 1:
        raise PrtnetError(f"bands: found {bands}, expected at least 1")
    return bands * bands


def bands_of(coefficients: int) -> int:
    """Inverse of `count`: the number of bands that give this many coefficients."""
    bands = round(coefficients**0.5)
    if bands < 1 or bands * bands != coefficients:
        raise PrtnetError(f"SH coefficients: found {coefficients}, expected a square number (1, 4, 9, 16, ...)")
    return bands


def band_index(bands: int) -> Int[Array, " k"]:
    """The band l of each coefficient: 0, 1 1 1, 2 2 2 2 2, ..."""
    return np.repeat(np.arange(bands), 2 * np.arange(bands) + 1)


def evaluate(directions: Float[Array, "*n 3"], bands: int) -> Float[Array, "*n k"]:
    """Y_i(w) for unit directions w in world space, in the type of `directions`.

    The associated Legendre functions are carried already normalised and without their sin(theta)^m, which joins
    cos(m phi) in a polynomial of x and y: nothing overflows and the poles need no case of their own.
    """
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    out = np.empty((*x.shape, count(bands)), np.float64)
    cosine, sine, diagonal = np.ones_like(z), np.zeros_like(z), sqrt(1 / (4 * pi))
    for m in range(bands):
        if m > 0:
            cosine, sine = x * cosine - y * sine, x * sine + y * cosine
            diagonal *= sqrt((2 * m + 1) / (2 * m))
        scale = sqrt(2) if m > 0 else 1.0
        before, legendre = np.zeros_like(z), np.full_like(z, diagonal * scale)
        for l in range(m, bands):
            if l > m:
                before, legendre = legendre, _legendre_step(l, m, z, legendre, before)
            out[..., l * l + l + m] = legendre * cosine
            if m > 0:
                out[..., l * l + l - m] = legendre * sine
    return out.astype(np.result_type(directions, np.float32), copy=False)


def _legendre_step(l: int, m: int, z: Values, last: Values, before: Values) -> Values:
    """Normalised three-term recurrence in l at fixed m (Press et al. 2007, eq. 6.7.9)."""
    ahead = sqrt((4 * l * l - 1) / (l * l - m * m))
    behind = sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1))
    return ahead * (z * last - behind * before)


def project(
    values: Float[Array, "n c"], directions: Float[Array, "n 3"], weights: Float[Array, " n"], bands: int
) -> Float[Array, "k c"]:
    """Sum of weights * values * Y_i: the SH projection of a sampled function. `weights` are solid angles in sr."""
    basis = evaluate(np.asarray(directions, np.float64), bands)
    projected = basis.T @ (np.asarray(weights, np.float64)[:, None] * values)
    return projected.astype(np.result_type(values, np.float32), copy=False)


def cosine_zonal(bands: int) -> Float[Array, " bands"]:
    """A_l of the clamped cosine, (pi, 2pi/3, pi/4, 0, -pi/24, ...), so that its projection is A_l Y_i(n).

    Ramamoorthi and Hanrahan 2001, *An Efficient Representation for Irradiance Environment Maps*, eq. 8.
    """
    zonal = np.zeros(bands)
    for l in range(bands):
        if l == 1:
            zonal[l] = 2 * pi / 3
        elif l % 2 == 0:
            zonal[l] = 2 * pi * (-1) ** (l // 2 + 1) / ((l + 2) * (l - 1)) * comb(l, l // 2) / 2**l
    return zonal


def cosine_lobe(normals: Float[Array, "*n 3"], bands: int) -> Float[Array, "*n k"]:
    """SH projection of max(0, n.w): the transfer of a point that nothing occludes. Unit normals, world space."""
    lobe = evaluate(np.asarray(normals, np.float64), bands) * cosine_zonal(bands)[band_index(bands)]
    return lobe.astype(np.result_type(normals, np.float32), copy=False)


def phong_lobe(exponent: float | Float[Array, "*n"], bands: int) -> Float[Array, "*n bands"]:
    """s_l of the lobe (e+1)/2pi max(0, cos)^e, normalised to s_0 = 1: blurring a function scales its band l by s_l.

    The integrals of t^e P_l(t) over [0, 1] obey s_l = s_{l-2} (e - l + 2) / (e + l + 1), with s_1 = (e+1)/(e+2).
    """
    e = np.asarray(exponent, np.float64)
    if not np.all(e >= 0):
        raise PrtnetError(f"Phong exponent: found {e.min()}, expected 0 or more")
    lobe = np.ones((*e.shape, max(bands, 2)))
    lobe[..., 1] = (e + 1) / (e + 2)
    for l in range(2, bands):
        lobe[..., l] = lobe[..., l - 2] * (e - l + 2) / (e + l + 1)
    return lobe[..., :bands]


def window(kind: str, size: float, bands: int) -> Float[Array, " bands"]:
    """Factor of each band that damps ringing: hann (1 + cos(pi l / w)) / 2, lanczos sin(pi l / w) / (pi l / w), none 1.

    Sloan 2008, *Stupid Spherical Harmonics (SH) Tricks*, section "Windowing"; from band w = `size` on they are 0.
    """
    if kind not in WINDOWS:
        raise PrtnetError(f"window: found {kind!r}, expected one of {', '.join(WINDOWS)}")
    if not 0 < size < np.inf:
        raise PrtnetError(f"window size: found {size} bands, expected more than 0")
    if kind == "none":
        return np.ones(bands)
    share = np.arange(bands) / size
    # numpy's sinc has the pi in it
    factors = np.sinc(share) if kind == "lanczos" else (1 + np.cos(pi * share)) / 2
    return np.where(share < 1, factors, 0)


def rotate(coefficients: Float[Array, "*b k c"], rotation: ArrayLike) -> Float[Array, "*b k c"]:
    """The coefficients of f(R^-1 w), given those of f: the function turned by R. Reflections are allowed.

    Raises PrtnetError when `rotation` is not an orthogonal 3x3 matrix.
    """
    rotation = np.asarray(rotation, np.float64)
    if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4):
        raise PrtnetError(f"rotation: found {rotation.tolist()}, expected an orthogonal 3x3 matrix")
    matrix = rotation_matrix(rotation, bands_of(coefficients.shape[-2]))
    return (matrix @ coefficients).astype(np.result_type(coefficients, np.float32), copy=False)


def rotation_matrix(rotation: Float[Array, "3 3"], bands: int) -> Float[Array, "k k"]:
    """D with c' = D c for the function turned by `rotation`: a quadrature of Y_i(w) Y_j(R^-1 w), exact to rounding."""
    directions, weights = quadrature(2 * (bands - 1))
    return evaluate(directions, bands).T @ (weights[:, None] * evaluate(directions @ rotation, bands))


@lru_cache(maxsize=16)
def triple_product(bands_i: int, bands_j: int, bands_k: int) -> Float[Array, "ki kj kk"]:
    """tau_ijk = integral of Y_i Y_j Y_k dw: the Gaunt coefficients of the real basis, float64, zeros exact."""
    directions, weights = quadrature(bands_i + bands_j + bands_k - 3)
    basis = evaluate(directions, max(bands_i, bands_j, bands_k))
    first, second, third = (basis[:, : count(bands)] for bands in (bands_i, bands_j, bands_k))
    tau = np.einsum("ni,nj,nk->ijk", weights[:, None] * first, second, third, optimize=True)
    tau[np.abs(tau) < 1e-12] = 0
    tau.setflags(write=False)
    return tau


@lru_cache(maxsize=64)
def quadrature(degree: int) -> tuple[Float[Array, "n 3"], Float[Array, " n"]]:
    """Directions and weights that integrate every polynomial up to `degree` on the sphere exactly (Gauss x uniform)."""
    height, height_weights = np.polynomial.legendre.leggauss(degree // 2 + 1)
    azimuth = (np.arange(degree + 1) + 0.5) * 2 * pi / (degree + 1)
    radius = np.sqrt(1 - height**2)[:, None]
    z = np.broadcast_to(height[:, None], (len(height), degree + 1))
    directions = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], -1).reshape(-1, 3)
    weights = np.repeat(height_weights * 2 * pi / (degree + 1), degree + 1)
    directions.setflags(write=False)
    weights.setflags(write=False)
    return directions, weights
