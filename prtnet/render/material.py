"""What light becomes at a surface: a diffuse part and normalised Phong gloss, in NumPy, the twin of the GLSL methods.

    B(w_o) = diffuse * albedo / pi * sum_i t_i L_i  +  specular * sum_k s_l(k) H_k Y_k(r)
    H_k = sum_ij tau_ijk t_i L_j                                  transferred radiance; the cosine is in t already

t: transfer, L: the light's SH coefficients per colour, tau: integral of Y_i Y_j Y_k dw, r: the direction to the eye
mirrored at the shading normal, s_l: zonal coefficients of (e+1)/2pi max(0, cos)^e (`sh.phong_lobe`).

Parts of the scene may reflect otherwise, and the exponent may follow from the file's roughness: a `Reflectance` says
what each point does. The orders of t, L and H may differ; what a product of two functions has above H's is cut.

Two spellings of the same sum. `full` is the triple product at each point (Ng, Ramamoorthi and Hanrahan 2004, *Triple
Product Wavelet Integrals for All-Frequency Relighting*). `fixed_light` makes M_ik = sum_j tau_ijk L_j once per light,
H = M^T t (Sloan 2008, *Stupid Spherical Harmonics Tricks*, products; Dhawal, Aakash KT and Narayanan 2022, *PRTT*).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, pi

import numpy as np
from jaxtyping import Float, Float64

from prtnet import PrtnetError, sh
from prtnet.export import gloss

Array = np.ndarray

PRODUCTS = ("fixed_light", "full")
ROUGHNESS = ("config", "file")
# points whose products of "25 25" are held at a time
STEP = 1 << 13


@dataclass(frozen=True)
class OfPart:
    """What one part reflects; None: as the rest of the scene."""

    diffuse: float | None = None
    specular: tuple[float, ...] | None = None
    exponent: float | None = None


@dataclass(frozen=True)
class Material:
    """How the scene reflects. Raises PrtnetError, naming the configuration's key, for what cannot be."""

    diffuse: float = 1.0  # weight of the albedo's part
    specular: tuple[float, ...] = (0.0, 0.0, 0.0)  # linear RGB: what the lobe reflects of all light
    exponent: float = 20.0  # of the Phong lobe
    product: str = "fixed_light"
    parts: Mapping[str, OfPart] = field(default_factory=dict)  # by their names
    roughness: str = "config"  # file: exponents follow from its roughness where it has one and `parts` have no exponent
    light_bands: int | None = None  # of L; as many as the transfer's when left out
    radiance_bands: int | None = None  # of H; the same

    def __post_init__(self) -> None:
        _check("material", self.diffuse, self.specular, self.exponent)
        for name, part in self.parts.items():
            _check(f"material.parts.{name}", part.diffuse, part.specular, part.exponent)
        if self.product not in PRODUCTS:
            raise PrtnetError(f"material.product: found {self.product!r}, expected one of {', '.join(PRODUCTS)}")
        if self.roughness not in ROUGHNESS:
            raise PrtnetError(f"material.roughness: found {self.roughness!r}, expected one of {', '.join(ROUGHNESS)}")

    @property
    def name(self) -> str:
        """As rows of scores call it: `glossy` where anything is specular, `glossy full` with the full product."""
        if not self.glossy:
            return "diffuse"
        return "glossy full" if self.product == "full" else "glossy"

    @property
    def glossy(self) -> bool:
        return any(self.specular) or any(any(part.specular or ()) for part in self.parts.values())

    @property
    def varies(self) -> bool:
        """Whether weights or exponents may differ between points."""
        return bool(self.parts) or self.roughness == "file"

    @property
    def one_exponent(self) -> bool:
        """Whether the lobe is the same everywhere."""
        own = (part.exponent for part in self.parts.values())
        return self.roughness == "config" and all(e is None or e == self.exponent for e in own)

    def orders(self, bands: int) -> tuple[int, int]:
        """(bands of the light, bands of the radiance) beside `bands` of transfer.

        Raises PrtnetError for bands that are none, or that the product cannot have.
        """
        light, out = self.light_bands or bands, self.radiance_bands or bands
        for key, found in (("light_bands", self.light_bands), ("radiance_bands", self.radiance_bands)):
            if found is not None and found < 1:
                raise PrtnetError(f"material.{key}: found {found}, expected at least 1, or null for transfer.bands")
        if out > bands + light - 1:
            raise PrtnetError(
                f"material.radiance_bands: found {out} bands of radiance, expected at most {bands + light - 1}, which "
                f"is all that {bands} bands of transfer times {light} of light have"
            )
        return light, out

    def words(self) -> str:
        """All of it in a line, for reports."""
        if not self.glossy:
            text = f"diffuse {self.diffuse:g}"
        else:
            text = f"{_words(self.diffuse, self.specular, self.exponent)}, product {self.product}"
        if self.roughness == "file":
            text += ", exponents by the file's roughness"
        orders = [f"{found} bands of {what}" for found, what in self._own_orders() if found]
        parts = [f"{name}: {_words(part.diffuse, part.specular, part.exponent)}" for name, part in self.parts.items()]
        return "; ".join([", ".join([text, *orders]), *parts])

    def _own_orders(self) -> tuple[tuple[int | None, str], ...]:
        return (self.light_bands, "light"), (self.radiance_bands, "radiance")

    def gloss_macs(self, bands: int) -> int:
        """Multiply-adds of the lobe at one point, as `gloss.macs` counts them; the diffuse part comes on top."""
        return gloss.macs(bands, self.product, *self.orders(bands)) if self.glossy else 0


def _check(key: str, diffuse: float | None, specular: tuple[float, ...] | None, exponent: float | None) -> None:
    if diffuse is not None and not 0 <= diffuse < inf:
        raise PrtnetError(f"{key}.diffuse: found {diffuse}, expected a finite weight of 0 or more")
    if specular is not None and (len(specular) != 3 or not all(0 <= value < inf for value in specular)):
        expected = "expected 3 finite values of 0 or more, linear RGB"
        raise PrtnetError(f"{key}.specular: found {list(specular)}, {expected}")
    if exponent is not None and not 0 < exponent < inf:
        raise PrtnetError(f"{key}.exponent: found {exponent}, expected a finite number above 0")


def _words(diffuse: float | None, specular: tuple[float, ...] | None, exponent: float | None) -> str:
    colour = None if specular is None else ", ".join(f"{value:g}" for value in specular)
    known = (("diffuse", diffuse), ("specular", colour), ("exponent", exponent))
    return ", ".join(f"{key} {v if isinstance(v, str) else f'{v:g}'}" for key, v in known if v is not None)


@dataclass(frozen=True, eq=False)
class Reflectance:
    """What points reflect, one by one."""

    diffuse: Float64[Array, " n"]
    # linear RGB
    specular: Float64[Array, "n 3"]
    exponent: Float64[Array, " n"]


DIFFUSE = Material()


def radiance(
    material: Material,
    albedo: Float[Array, "n 3"],
    transfer: Float[Array, "n c"],
    light: Float[Array, "kj 3"],
    normals: Float[Array, "n 3"],
    towards: Float[Array, "n 3"],
    own: Reflectance | None = None,
    *,
    groups: int = 1,
    incident: Float[Array, "n k 3"] | None = None,
) -> Float[Array, "n 3"]:
    """B of points with linear RGB albedo and shading normals, seen from `towards` (normals and views of any length).

    `own` is what each point reflects, where that is not the same everywhere. The diffuse part sums over the
    coefficients that transfer and light both have.

    Of 4 `groups` of channels the first is the direct transfer, for gloss; the others have light from other surfaces in
    them, for the diffuse part in red, green and blue. `incident` is that light under this very light instead
    (`data.transfer.incident`), for both parts (Dhawal, Aakash KT and Narayanan 2022).
    """
    diffuse = material.diffuse if own is None else own.diffuse[:, None]
    received = irradiance(transfer, light, groups)
    if incident is not None:
        received = received + np.sqrt(4 * pi) * incident[:, 0]
    out = diffuse * (albedo / pi * received)
    if not material.glossy:
        return out
    direct = transfer[:, : transfer.shape[1] // groups]
    return out + shine(material, direct, light, normals, towards, own, incident=incident)


def shine(
    material: Material,
    transfer: Float[Array, "n k"],
    light: Float[Array, "kj 3"],
    normals: Float[Array, "n 3"],
    towards: Float[Array, "n 3"],
    own: Reflectance | None = None,
    *,
    incident: Float[Array, "n _ 3"] | None = None,
) -> Float64[Array, "n 3"]:
    """The specular part of `radiance`, of the direct transfer. Of `incident` it takes the bands that both have."""
    _, bands_out = material.orders(sh.bands_of(transfer.shape[1]))
    facing = lobe(mirrored(towards, normals), material.exponent if own is None else own.exponent, bands_out)
    specular = np.asarray(material.specular) if own is None else own.specular
    seen = reflected(transfer, light, facing, material.product)
    if incident is not None:
        both = min(facing.shape[1], incident.shape[1])
        seen = seen + np.einsum("nkc,nk->nc", incident[:, :both], facing[:, :both])
    return specular * seen


def irradiance(transfer: Float[Array, "n c"], light: Float[Array, "kj 3"], groups: int) -> Float[Array, "n 3"]:
    """sum_i t_i L_i per colour: with one group's t for all colours, or with those of groups 1, 2, 3 of four."""
    both = min(transfer.shape[1] // groups, len(light))
    if groups == 1:
        return transfer[:, :both] @ light[:both]
    coloured = transfer.reshape(len(transfer), groups, -1)[:, 1:, :both]
    return np.einsum("nck,kc->nc", coloured, light[:both])


def mirrored(towards: Float[Array, "n 3"], normals: Float[Array, "n 3"]) -> Float64[Array, "n 3"]:
    """Unit directions `towards` (of any length), mirrored at normals (of any length): 2 (n.w) n - w."""
    towards, normals = (np.asarray(v, np.float64) for v in (towards, normals))
    towards, normals = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (towards, normals))
    return 2 * np.sum(normals * towards, axis=1, keepdims=True) * normals - towards


def lobe(directions: Float[Array, "n 3"], exponent: float | Float[Array, " n"], bands: int) -> Float[Array, "n k"]:
    """s_l Y_k(r): what the Phong lobe about each unit direction takes of each coefficient of incoming radiance."""
    return sh.evaluate(directions, bands) * sh.phong_lobe(exponent, bands)[..., sh.band_index(bands)]


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
