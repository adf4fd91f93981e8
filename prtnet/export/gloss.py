"""Phong gloss as a GLSL function of the transfer, the light and the mirrored direction of view.

    vec3 prt_gloss(vec3 mirrored, vec4 t0, vec4 t1, ...)   // sum_ijk tau_ijk t_i L_j s_l(k) Y_k(mirrored), per colour
    vec3 prt_gloss(vec3 mirrored, float exponent, vec4 t0, vec4 t1, ...)   // where exponents vary

tau is symmetric, so the products of transfer and lobe are summed by pairs, p_ik = t_i y_k + t_k y_i with i <= k and
y_k = s_l Y_k(mirrored), before any of the three colours is looked at: the full product needs no more multiply-adds
than the one with a fixed light. Where transfer and lobe have other orders, what one lacks is left out of the pairs.

Both forms are one long sum with literals. On llvmpipe, 25 coefficients at 256^2, such a frame takes 1.7 times a diffuse
one and compiles in half a second; with the light's matrix as an array of uniforms it took 4 times (7 s to compile), as
unrolled fetches from a texture 5 times, and as a loop over that texture 8 times.
"""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError, sh
from prtnet.export.spelling import component, number, quads, vector, zonal_harmonics

Array = np.ndarray

MAX_BANDS = 8  # ten thousand multiply-adds, 4 s of compiling; at 5 bands 1.4 thousand and 0.4 s
# s_l as literals, or how many of them to find from an exponent that the function is given
Lobe = Float[Array, " bands"] | int


def fixed_light(matrix: Float[Array, "3 ki kk"], lobe: Lobe) -> str:
    """The function for one light: `matrix` is M_ik = sum_j tau_ijk L_j per colour (Sloan 2008).

    Raises PrtnetError above MAX_BANDS.
    """
    bands = sh.bands_of(matrix.shape[1])
    check(bands, bands_out=_bands(lobe))
    lines = []
    for i, k, product in _pairs(bands, _bands(lobe)):
        if matrix[:, i, k].any():
            lines.append(f"sum += {vector('vec3', matrix[:, i, k])} * {product};")
    return _function(bands, lobe, ["vec3 sum = vec3(0.0);", *lines, "return sum;"])


def full(
    lobe: Lobe,
    bands: int | None = None,
    bands_light: int | None = None,
    coefficient: Callable[[int], str] = lambda j: f"light[{j // 4}][{j % 4}]",
) -> str:
    """The function for any light: it reads `uniform mat4x3 light[]`, whose column j of light[l] is RGB of L_{4l+j}, or
    what `coefficient` spells as L_j.

    `bands` of the transfer and of the light are as many as the lobe's where left out. Only the tau that are not zero
    are written. Raises PrtnetError above MAX_BANDS.
    """
    bands = bands or _bands(lobe)
    bands_light = bands_light or bands
    check(bands, bands_light, _bands(lobe))
    lines = []
    sums: list[list[str]] = [[] for _ in range(sh.count(bands_light))]
    tau = sh.triple_product(bands, bands_light, _bands(lobe))
    for i, k, product in _pairs(bands, _bands(lobe)):
        lines.append(f"float p{i}_{k} = {product};")
        for j in np.flatnonzero(tau[i, :, k]):
            sums[j].append(f"{number(tau[i, j, k])} * p{i}_{k}")
    lines.append("vec3 sum = vec3(0.0);")
    lines += [f"sum += {coefficient(j)} * ({' + '.join(terms)});" for j, terms in enumerate(sums) if terms]
    return _function(bands, lobe, [*lines, "return sum;"])


def macs(bands: int, product: str, bands_light: int | None = None, bands_out: int | None = None) -> int:
    """Multiply-adds of `fixed_light` or `full` at one point, without the SH of the mirrored direction.

    A pair costs 2, or 1 where i = k or one of the two is missing. A fixed light adds 3 colours per pair; the full
    product adds 1 for each tau of the pair that is not zero, and 3 for each coefficient of the light.
    """
    bands_light, bands_out = bands_light or bands, bands_out or bands
    pairs = list(_pairs(bands, bands_out))
    products = sh.count(bands) * sh.count(bands_out)
    if product == "fixed_light":
        return products + 3 * len(pairs)
    tau = sh.triple_product(bands, bands_light, bands_out)
    return products + sum(int(np.count_nonzero(tau[i, :, k])) for i, k, _ in pairs) + 3 * sh.count(bands_light)


def check(bands: int, bands_light: int = 1, bands_out: int = 1) -> None:
    """Raises PrtnetError where the sums would be too long for compilers."""
    orders = {"transfer.bands": bands, "material.light_bands": bands_light, "material.radiance_bands": bands_out}
    for key, found in orders.items():
        if found > MAX_BANDS:
            raise PrtnetError(f"{key}: found {found}, expected at most {MAX_BANDS} with gloss in a shader")


def _bands(lobe: Lobe) -> int:
    return lobe if isinstance(lobe, int) else len(lobe)


def _pairs(bands: int, bands_out: int) -> Iterator[tuple[int, int, str]]:
    """i of the transfer, k of the lobe and the text of p_ik, which holds t_k y_i as well where both have i and k."""
    both = sh.count(min(bands, bands_out))
    for i in range(sh.count(bands)):
        first = component("t", i)
        for k in range(sh.count(bands_out)):
            if i == k or max(i, k) >= both:
                yield i, k, f"{first} * y{k}"
            elif i < k:
                yield i, k, f"({first} * y{k} + {component('t', k)} * y{i})"


def incident(lobe: Lobe, bands: int) -> str:
    """vec3 prt_incident(mirrored, [exponent,] r0, ..., g0, ..., b0, ...): sum_k J_k y_k per colour, J in `bands` bands.

    What the lobe takes of light that is known as SH at the point. Of the bands of lobe and J it takes those both have.
    """
    layers, both = quads(sh.count(bands)), sh.count(min(bands, _bands(lobe)))
    sums = [" + ".join(f"{component(colour, k)} * y{k}" for k in range(both)) for colour in "rgb"]
    arguments = [f"vec4 {colour}{layer}" for colour in "rgb" for layer in range(layers)]
    return _written("prt_incident", lobe, arguments, [f"return vec3({', '.join(sums)});"])


def _function(bands: int, lobe: Lobe, body: list[str]) -> str:
    return _written("prt_gloss", lobe, [f"vec4 t{layer}" for layer in range(quads(sh.count(bands)))], body)


def _written(name: str, lobe: Lobe, vectors: list[str], body: list[str]) -> str:
    """A function whose body knows y_k = s_l Y_k(mirrored)."""
    check(_bands(lobe))
    names: list[str] = []
    if isinstance(lobe, int):
        lines = [*_recurrence(lobe), *zonal_harmonics("mirrored", np.ones(lobe), names)]
        names = [f"s{l} * ({each})" for l, each in zip(sh.band_index(lobe), names, strict=True)]
    else:
        lines = list(zonal_harmonics("mirrored", lobe, names))
    lines += [f"float y{k} = {each};" for k, each in enumerate(names)]
    arguments = ["vec3 mirrored", *(["float exponent"] if isinstance(lobe, int) else []), *vectors]
    return "\n  ".join([f"vec3 {name}({', '.join(arguments)}) {{", *lines, *body]) + "\n}\n"


def _recurrence(bands: int) -> Iterator[str]:
    """s_l of a lobe of any exponent, as `sh.phong_lobe` finds them."""
    yield "float s0 = 1.0;"
    if bands > 1:
        yield "float s1 = (exponent + 1.0) / (exponent + 2.0);"
    for l in range(2, bands):
        yield f"float s{l} = s{l - 2} * (exponent - {l - 2}.0) / (exponent + {l + 1}.0);"
