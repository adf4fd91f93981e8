"""What light becomes at a surface: a diffuse part and normalised Phong gloss, in NumPy, the twin of the GLSL methods.

    B(w_o) = diffuse * albedo / pi * sum_i t_i L_i  +  specular * sum_k s_l(k) H_k Y_k(r)
    H_k = sum_ij tau_ijk t_i L_j                                  transferred radiance; the cosine is in t already

t: transfer, L: the light's SH coefficients per colour, tau: integral of Y_i Y_j Y_k dw, r: the direction to the eye
mirrored at the shading normal, s_l: zonal coefficients of (e+1)/2pi max(0, cos)^e (`sh.phong_lobe`). H has the bands
of t: what a product of two b-band functions has above b is cut.

Two spellings of the same sum. `full` is the triple product at each point (Ng, Ramamoorthi and Hanrahan 2004, *Triple
Product Wavelet Integrals for All-Frequency Relighting*). `fixed_light` makes M_ik = sum_j tau_ijk L_j once per light,
H = M^T t (Sloan 2008, *Stupid Spherical Harmonics Tricks*, products; Dhawal, Aakash KT and Narayanan 2022, *PRTT*).
"""

from dataclasses import dataclass
from math import inf, pi

import numpy as np
from jaxtyping import Float, Float64

from prtnet import PrtnetError, sh
from prtnet.export import gloss

Array = np.ndarray

PRODUCTS = ("fixed_light", "full")
# points whose products of "25 25" are held at a time
STEP = 1 << 13


@dataclass(frozen=True)
class Material:
    """How the whole scene reflects. Raises PrtnetError, naming the configuration's key, for what cannot be."""

    diffuse: float = 1.0  # weight of the albedo's part
    specular: tuple[float, ...] = (0.0, 0.0, 0.0)  # linear RGB: what the lobe reflects of all light
    exponent: float = 20.0  # of the Phong lobe
    product: str = "fixed_light"

    def __post_init__(self) -> None:
        if not 0 <= self.diffuse < inf:
            raise PrtnetError(f"material.diffuse: found {self.diffuse}, expected a finite weight of 0 or more")
        if len(self.specular) != 3 or not all(0 <= value < inf for value in self.specular):
            expected = "expected 3 finite values of 0 or more, linear RGB"
            raise PrtnetError(f"material.specular: found {list(self.specular)}, {expected}")
        if not 0 < self.exponent < inf:
            raise PrtnetError(f"material.exponent: found {self.exponent}, expected a finite number above 0")
        if self.product not in PRODUCTS:
            raise PrtnetError(f"material.product: found {self.product!r}, expected one of {', '.join(PRODUCTS)}")

    @property
    def name(self) -> str:
        """As rows of scores call it: `glossy` where anything is specular."""
        return "glossy" if self.glossy else "diffuse"

    @property
    def glossy(self) -> bool:
        return any(self.specular)

    def words(self) -> str:
        """All of it in a line, for reports."""
        if not self.glossy:
            return f"diffuse {self.diffuse:g}"
        colour = ", ".join(f"{value:g}" for value in self.specular)
        return f"diffuse {self.diffuse:g}, specular {colour}, exponent {self.exponent:g}, product {self.product}"

    def gloss_macs(self, bands: int) -> int:
        """Multiply-adds of the lobe at one pixel, as `gloss.macs` counts them; the diffuse part comes on top."""
        return gloss.macs(bands, self.product) if self.glossy else 0


DIFFUSE = Material()


def radiance(
    material: Material,
    albedo: Float[Array, "n 3"],
    transfer: Float[Array, "n c"],
    light: Float[Array, "k 3"],
    normals: Float[Array, "n 3"],
    towards: Float[Array, "n 3"],
    *,
    groups: int = 1,
    incident: Float[Array, "n k 3"] | None = None,
) -> Float[Array, "n 3"]:
    """B of points with linear RGB albedo and shading normals, seen from `towards` (normals and views of any length).

    Of 4 `groups` of channels the first is the direct transfer, for gloss; the others have light from other surfaces in
    them, for the diffuse part in red, green and blue. `incident` is that light under this very light instead
    (`data.transfer.incident`), for both parts (Dhawal, Aakash KT and Narayanan 2022).
    """
    direct = transfer[:, : transfer.shape[1] // groups]
    received = irradiance(transfer, light, groups)
    if incident is not None:
        received = received + np.sqrt(4 * pi) * incident[:, 0]
    out = material.diffuse * (albedo / pi * received)
    if material.glossy:
        facing = lobe(mirrored(towards, normals), material.exponent, sh.bands_of(direct.shape[1]))
        seen = reflected(direct, light, facing, material.product)
        if incident is not None:
            seen = seen + np.einsum("nkc,nk->nc", incident, facing)
        out = out + np.asarray(material.specular) * seen
    return out


def irradiance(transfer: Float[Array, "n c"], light: Float[Array, "k 3"], groups: int) -> Float[Array, "n 3"]:
    """sum_i t_i L_i per colour: with one group's t for all colours, or with those of groups 1, 2, 3 of four."""
    if groups == 1:
        return transfer @ light
    coloured = transfer.reshape(len(transfer), groups, -1)[:, 1:]
    return np.einsum("nck,kc->nc", coloured, light)


def mirrored(towards: Float[Array, "n 3"], normals: Float[Array, "n 3"]) -> Float64[Array, "n 3"]:
    """Unit directions `towards` (of any length), mirrored at normals (of any length): 2 (n.w) n - w."""
    towards, normals = (np.asarray(v, np.float64) for v in (towards, normals))
    towards, normals = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (towards, normals))
    return 2 * np.sum(normals * towards, axis=1, keepdims=True) * normals - towards


def lobe(directions: Float[Array, "n 3"], exponent: float, bands: int) -> Float[Array, "n k"]:
    """s_l Y_k(r): what the Phong lobe about each unit direction takes of each coefficient of incoming radiance."""
    return sh.evaluate(directions, bands) * sh.phong_lobe(exponent, bands)[sh.band_index(bands)]


def fixed_light_matrix(
    light: Float[Array, "kj 3"], bands: int, bands_out: int | None = None
) -> Float64[Array, "3 _ _"]:
    """M_ik = sum_j tau_ijk L_j per colour: takes transfer of `bands` to transferred radiance of `bands_out` (the same
    when left out). Raises PrtnetError where the product cannot have that many bands."""
    bands_light = sh.bands_of(len(light))
    bands_out = bands if bands_out is None else bands_out
    most = bands + bands_light - 1
    if bands_out > most:
        raise PrtnetError(
            f"triple product: found {bands_out} bands of radiance, expected at most {most}, which is all that "
            f"{bands} bands of transfer times {bands_light} of light have"
        )
    tau = sh.triple_product(bands, bands_light, bands_out)
    return np.einsum("ijk,jc->cik", tau, np.asarray(light, np.float64))


def reflected(
    transfer: Float[Array, "n k"], light: Float[Array, "kj 3"], facing: Float[Array, "n ko"], product: str
) -> Float64[Array, "n 3"]:
    """sum_k H_k facing_k per point and colour, in float64: H by the matrix of a fixed light, or by the full product
    of each point's transfer with the light. `facing` is that of `lobe`."""
    bands, bands_out = sh.bands_of(transfer.shape[1]), sh.bands_of(facing.shape[1])
    matrix = fixed_light_matrix(light, bands, bands_out)
    tau = sh.triple_product(bands, sh.bands_of(len(light)), bands_out)
    out = np.empty((len(transfer), 3))
    for first in range(0, len(transfer), STEP):
        part = slice(first, first + STEP)
        own, lobes = np.asarray(transfer[part], np.float64), np.asarray(facing[part], np.float64)
        if product == "fixed_light":
            out[part] = np.stack([np.sum((own @ colour) * lobes, axis=1) for colour in matrix], axis=1)
        else:
            blocked = np.tensordot(own, tau, axes=1)  # n j k: the light as the point sees it, before there is one
            out[part] = np.einsum("njk,nk->nj", blocked, lobes) @ np.asarray(light, np.float64)
    return out
