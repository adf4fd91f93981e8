"""Diffuse light folded into the last layer: k x 3 numbers in place of k x coefficients, found anew for each light.

Irradiance is E = sum_i t_i L_i per colour, and of a net with a linear output t = s (W h + b) + lobe(n), so

    E = (s L^T W) h + s L^T b + L . lobe(n)

The first two factors are found on the CPU (`fold`), exact to rounding; the last term, of nets with a residual, is the
irradiance of an open point (Ramamoorthi and Hanrahan 2001, *An Efficient Representation for Irradiance Environment
Maps*) in the bands of the net. With four groups each colour has rows of its own.

    uniform vec4 prt_folded[3 q]      // q = k / 4 rounded up: weights of red, of green, of blue
    uniform vec3 prt_folded_bias
    uniform vec3 prt_light[N]         // where the net has a residual
    vec3 prt_irradiance(vec3 position, vec3 normal)
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError, sh
from prtnet.export import form, glsl, limits, shading
from prtnet.export.form import Form
from prtnet.export.limits import Limits
from prtnet.export.spelling import quads, zonal_harmonics
from prtnet.netspec import NetSpec

Array = np.ndarray


class Folded(NamedTuple):
    """Last layer and light: irradiance per colour is weights @ h + biases, and that of an open point."""

    weights: Float32[Array, "3 k"]
    biases: Float32[Array, " 3"]


def can_fold(net: NetSpec) -> bool:
    """Whether the last layer is linear in what enters it."""
    return net.output == "linear"


def fold(net: NetSpec, light: Float[Array, "c 3"]) -> Folded:
    """For the light's SH coefficients; a light of other bands than the net's counts in those that both have.

    Raises PrtnetError where the net's output is not linear.
    """
    if not can_fold(net):
        raise PrtnetError(f"light folding: found a net with output {net.output}, expected linear; use prt_transfer")
    count = sh.count(net.bands)
    weight = net.weights[-1].astype(np.float64).reshape(net.groups, count, -1)
    bias = net.biases[-1].astype(np.float64).reshape(net.groups, count)
    # of four groups the first is for gloss alone
    places = [0, 0, 0] if net.groups == 1 else [1, 2, 3]
    known = net.output_scale * _same_bands(net, light)
    weights = [known[:, colour] @ weight[place] for colour, place in enumerate(places)]
    biases = [known[:, colour] @ bias[place] for colour, place in enumerate(places)]
    return Folded(np.array(weights, np.float32), np.array(biases, np.float32))


def uniforms(net: NetSpec, light: Float[Array, "c 3"]) -> dict[str, Float32[Array, "..."]]:
    """What `prt_irradiance` wants to be set at a change of the light."""
    folded = fold(net, light)
    size = folded.weights.shape[1]
    rows = np.pad(folded.weights, [(0, 0), (0, -size % 4)]).reshape(-1, 4)
    known = _same_bands(net, light).astype(np.float32)
    return {"prt_folded": rows, "prt_folded_bias": folded.biases, shading.LIGHT: known}


def irradiance(net: NetSpec, wanted: Form, target: Limits | None = None) -> str:
    """The text of `prt_irradiance`, to paste in place of that of `prt_transfer` into shaders that need no more.

    Raises PrtnetError as `glsl.transfer` does, and where the output is not linear.
    """
    if not can_fold(net):
        raise PrtnetError(f"light folding: found a net with output {net.output}, expected linear; use prt_transfer")
    target, chosen = target or limits.MINIMUM[wanted.version], wanted.of(net)
    lines = [*_uniforms(net), f"vec3 prt_irradiance({glsl.parameters(net)}) {{"]
    lines += [f"  {line}" for line in _body(form.rounded(net, chosen), chosen, target)]
    return glsl.written(net, chosen, target, lines, components=_components(net))


def _uniforms(net: NetSpec) -> list[str]:
    lines = [f"uniform highp vec4 prt_folded[{3 * quads(net.weights[-1].shape[1])}];"]
    lines += ["uniform highp vec3 prt_folded_bias;"]
    return [*lines, shading.light_declaration(net)] if net.residual else lines


def _components(net: NetSpec) -> int:
    """Floats of uniforms: each vec3 may take the room of a vec4."""
    return 12 * quads(net.weights[-1].shape[1]) + 4 + (4 * sh.count(net.bands) if net.residual else 0)


def _body(net: NetSpec, chosen: Form, target: Limits) -> Iterator[str]:
    names: list[str] = []
    yield from glsl.hidden(net, chosen, target, len(net.weights) - 1, names)
    yield "vec3 sum = prt_folded_bias;"
    if chosen.storage == "literal":
        for i, name in enumerate(names):
            yield _dots(str(i), len(names), name)
    else:
        # spelt out, this takes llvmpipe half a minute to compile at k = 256
        bound = f"{len(names)} * one" if chosen.storage == "texture" else str(len(names))
        yield f"for (int i = 0; i < {bound}; ++i) {_dots('i', len(names), names[0].replace('[0]', '[i]'))}"
    if net.residual:
        lobe: list[str] = []
        yield from zonal_harmonics("normal", sh.cosine_zonal(net.bands), lobe)
        for i, term in enumerate(lobe):
            if term != "0.0":
                yield f"sum += {shading.LIGHT}[{i}] * ({term});"
    yield "return sum;"


def _dots(index: str, size: int, name: str) -> str:
    """Four of the numbers that enter the folded layer times its weights."""
    dots = (f"dot(prt_folded[{colour * size} + {index}], {name})" for colour in range(3))
    return f"sum += vec3({', '.join(dots)});"


def _same_bands(net: NetSpec, light: Float[Array, "c 3"]) -> Float[Array, "k 3"]:
    found = np.zeros((sh.count(net.bands), 3))
    few = min(len(light), len(found))
    found[:few] = light[:few]
    return found
