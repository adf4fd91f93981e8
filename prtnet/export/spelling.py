"""GLSL text that several shaders share: literals, vectors of expressions, and spherical harmonics of a direction.

Everything is spelt out, without arrays or loops, with all constants folded into literals: compilers take it best so.
"""

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

Array = np.ndarray

CHOSEN = "prt_net"  # of a stack of nets in one set of textures, the number of the one that is evaluated


def number(value: float | np.floating, digits: int = 9) -> str:
    """A GLSL float literal; of 9 digits it reads back as the same float32. Denormals, which GLSL may flush, are 0."""
    text = f"{float(value):.{digits}g}" if abs(value) >= np.finfo(np.float32).tiny else "0"
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def vector(kind: str, values: Float[Array, " n"], digits: int = 9) -> str:
    """A constructor of literals: vec4, mat4 (column by column), ..."""
    return f"{kind}({', '.join(number(value, digits) for value in values)})"


def quads(size: int) -> int:
    """Number of vec4s that hold this many floats."""
    return (size + 3) // 4


def grouped(names: list[str]) -> list[str]:
    """Expressions in turn as vec4s, the last one padded with 0."""
    padded = names + ["0.0"] * (-len(names) % 4)
    return [f"vec4({', '.join(padded[i : i + 4])})" for i in range(0, len(padded), 4)]


def component(name: str, index: int) -> str:
    """Float `index` of the vec4s name0, name1, ..."""
    return f"{name}{index // 4}.{'xyzw'[index % 4]}"


def zonal_harmonics(direction: str, zonal: Float[Array, " bands"], names: list[str]) -> Iterator[str]:
    """Statements after which names[i] is zonal_l Y_i(direction), by the recurrences of `sh.evaluate`.

    `direction` names a unit vec3 in world space. Once per function: the statements declare variables.
    """
    terms: dict[int, str] = {}
    diagonal = math.sqrt(1 / (4 * math.pi))
    for m in range(len(zonal)):
        if m > 0:
            before = (f"ac{m - 1}", f"as{m - 1}") if m > 1 else ("1.0", "0.0")
            yield f"float ac{m} = {direction}.x * {before[0]} - {direction}.y * {before[1]};"
            yield f"float as{m} = {direction}.x * {before[1]} + {direction}.y * {before[0]};"
            diagonal *= math.sqrt((2 * m + 1) / (2 * m))
        for l in range(m, len(zonal)):
            legendre = _legendre(direction, l, m, diagonal * (math.sqrt(2) if m else 1))
            yield f"float q{l}_{m} = {legendre};"
            scaled = f"{number(zonal[l])} * q{l}_{m}"
            terms[l * l + l + m] = f"{scaled} * ac{m}" if m else scaled
            terms[l * l + l - m] = f"{scaled} * as{m}" if m else scaled
    names += [terms[i] if abs(zonal[math.isqrt(i)]) > 1e-12 else "0.0" for i in range(len(terms))]


def _legendre(direction: str, l: int, m: int, diagonal: float) -> str:
    if l == m:
        return number(diagonal)
    ahead = math.sqrt((4 * l * l - 1) / (l * l - m * m))
    first = f"{number(ahead)} * {direction}.z * q{l - 1}_{m}"
    if l == m + 1:
        return first
    behind = ahead * math.sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1))
    return f"{first} - {number(behind)} * q{l - 2}_{m}"
