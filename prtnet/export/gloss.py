"""Phong gloss as a GLSL function of the transfer, the light and the mirrored direction of view.

    vec3 prt_gloss(vec3 mirrored, vec4 t0, vec4 t1, ...)   // sum_ijk tau_ijk t_i L_j s_l(k) Y_k(mirrored), per colour

tau is symmetric, so the products of transfer and lobe are summed by pairs, p_ik = t_i y_k + t_k y_i with i <= k and
y_k = s_l Y_k(mirrored), before any of the three colours is looked at: the full product needs no more multiply-adds
than the one with a fixed light.

Both forms are one long sum with literals. On llvmpipe, 25 coefficients at 256^2, such a frame takes 1.7 times a diffuse
one and compiles in half a second; with the light's matrix as an array of uniforms it took 4 times (7 s to compile), as
unrolled fetches from a texture 5 times, and as a loop over that texture 8 times.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError, sh
from prtnet.export.spelling import component, number, quads, vector, zonal_harmonics

Array = np.ndarray

MAX_BANDS = 8  # ten thousand multiply-adds, 4 s of compiling; at 5 bands 1.4 thousand and 0.4 s


def fixed_light(matrix: Float[Array, "3 k k"], lobe: Float[Array, " bands"]) -> str:
    """The function for one light: `matrix` is M_ik = sum_j tau_ijk L_j per colour (Sloan 2008), `lobe` is s_l.

    Raises PrtnetError above MAX_BANDS.
    """
    lines = []
    for i, k, product in _pairs(len(lobe)):
        if matrix[:, i, k].any():
            lines.append(f"sum += {vector('vec3', matrix[:, i, k])} * {product};")
    return _function(lobe, ["vec3 sum = vec3(0.0);", *lines, "return sum;"])


def full(lobe: Float[Array, " bands"]) -> str:
    """The function for any light: it reads `uniform mat4x3 light[]`, whose column j of light[l] is RGB of L_{4l+j}.

    Only the tau that are not zero are written. Raises PrtnetError above MAX_BANDS.
    """
    bands, lines = len(lobe), []
    sums: list[list[str]] = [[] for _ in range(sh.count(bands))]
    tau = sh.triple_product(bands, bands, bands)
    for i, k, product in _pairs(bands):
        lines.append(f"float p{i}_{k} = {product};")
        for j in np.flatnonzero(tau[i, :, k]):
            sums[j].append(f"{number(tau[i, j, k])} * p{i}_{k}")
    lines.append("vec3 sum = vec3(0.0);")
    lines += [f"sum += light[{j // 4}][{j % 4}] * ({' + '.join(terms)});" for j, terms in enumerate(sums)]
    return _function(lobe, [*lines, "return sum;"])


def macs(bands: int, product: str) -> int:
    """Multiply-adds of `fixed_light` or `full` at one point, without the SH of the mirrored direction.

    A pair costs 2, or 1 where i = k. A fixed light adds 3 colours per pair; the full product adds 1 for each tau of
    the pair that is not zero, and 3 for each coefficient of the light.
    """
    count = sh.count(bands)
    pairs = count * (count + 1) // 2
    if product == "fixed_light":
        return count * count + 3 * pairs
    tau = sh.triple_product(bands, bands, bands)
    first, last = np.triu_indices(count)
    return count * count + int(np.count_nonzero(tau[first, :, last])) + 3 * count


def check(bands: int) -> None:
    """Raises PrtnetError where the sums would be too long for compilers."""
    if bands > MAX_BANDS:
        raise PrtnetError(f"transfer.bands: found {bands}, expected at most {MAX_BANDS} with gloss in a shader")


def _pairs(bands: int) -> Iterator[tuple[int, int, str]]:
    """i <= k and the text of p_ik."""
    count = sh.count(bands)
    for i in range(count):
        first = component("t", i)
        yield i, i, f"{first} * y{i}"
        for k in range(i + 1, count):
            yield i, k, f"({first} * y{k} + {component('t', k)} * y{i})"


def _function(lobe: Float[Array, " bands"], body: list[str]) -> str:
    check(len(lobe))
    names: list[str] = []
    lines = list(zonal_harmonics("mirrored", lobe, names))
    lines += [f"float y{k} = {name};" for k, name in enumerate(names)]
    arguments = ", ".join(f"vec4 t{layer}" for layer in range(quads(sh.count(len(lobe)))))
    return "\n  ".join([f"vec3 prt_gloss(vec3 mirrored, {arguments}) {{", *lines, *body]) + "\n}\n"
