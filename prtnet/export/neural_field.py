"""A network's distance as GLSL functions of a point in unit coordinates, as `prtnet.export.implicit` has of shapes.

    float prt_distance(vec3 p)
    vec3 prt_gradient(vec3 p)   // by back-propagation
    int prt_part(vec3 p)        // 0

Weights are literals, layer by layer in mat4s; back-propagation multiplies the same matrices from the left. Sine and
cosine are polynomials of the reduced phase, since those of some drivers are off by 1e-3 at large phases. Drivers write
out every call, so a shader that calls each function once compiles quickest. The text is valid as GLSL 330, 430 and
300 es (where the default precision of float has to be high).
"""

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError
from prtnet.data.implicit.neural import Neural
from prtnet.export.glsl import sine_of_turns
from prtnet.export.spelling import number, quads, vector

Array = np.ndarray

MOST_MACS = 20_000  # with sizes rounded up to whole vec4s; beyond it compilers take minutes
_TURN = 6.28125  # 2 pi but for 1.9e-3


def emit(field: Neural, digits: int = 9) -> str:
    """The functions, to paste into a shader of any version. Raises PrtnetError above MOST_MACS multiply-adds."""
    blocks = [_blocks(weight) for weight in field.weights[:-1]]
    macs = sum(16 * block.shape[0] * block.shape[1] for block in blocks)
    if macs > MOST_MACS:
        raise PrtnetError(
            f"neural distance: found {macs} multiply-adds, expected at most {MOST_MACS} to write as GLSL; fit a "
            "network of less width (sdf.width) or depth (sdf.depth)"
        )
    half = vector("vec3", np.array(field.half))
    inside = f"  vec3 inside = clamp(p, -{half}, {half}), away = p - inside;"
    forward = list(_forward(field, digits))
    return "\n".join(
        [
            *_waves(),
            *_constants(field, digits),
            "float prt_distance(vec3 p) {",
            inside,
            *forward,
            "  float squared = dot(away, away);",
            "  return squared > 0.0 ? sqrt(squared + within * within) : within;",
            "}",
            "vec3 prt_gradient(vec3 p) {",
            inside,
            *forward,
            *_backward(field, digits),
            "  float squared = dot(away, away);",
            "  vec3 held = away + within * mix(slope, vec3(0.0), notEqual(away, vec3(0.0)));",
            "  return squared > 0.0 ? held / sqrt(squared + within * within) : slope;",
            "}",
            "int prt_part(vec3 p) { return 0; }",
            "",
        ]
    )


def _waves() -> list[str]:
    """Phases in turns, then their sines and cosines."""
    # whole turns go in two parts, the first of 8 bits, whose multiples float32 holds exactly
    return [
        *sine_of_turns("vec4", "prt_wave"),
        "vec4 prt_turns(vec4 x) {",
        f"  vec4 n = floor({number(0.5 / math.pi)} * x + 0.5);",
        f"  return {number(0.5 / math.pi)} * ((x - {number(_TURN)} * n) - {number(2 * math.pi - _TURN)} * n);",
        "}",
        "vec4 prt_sine(vec4 t) { return prt_wave(sign(t) * (0.25 - abs(0.25 - abs(t)))); }",
        "vec4 prt_cosine(vec4 t) { return prt_wave(0.25 - abs(t)); }",
    ]


def _blocks(matrix: Float[Array, "o i"]) -> Float[Array, "_ _ 4 4"]:
    """Of 4 x 4, padded with 0: [row, column]."""
    rows, columns = (quads(size) for size in matrix.shape)
    padded = np.zeros((4 * rows, 4 * columns), np.float32)
    padded[: matrix.shape[0], : matrix.shape[1]] = matrix
    return padded.reshape(rows, 4, columns, 4).transpose(0, 2, 1, 3)


def _constants(field: Neural, digits: int) -> Iterator[str]:
    """The matrices by name, since two functions and two directions use them."""
    for layer, weight in enumerate(field.weights[:-1]):
        blocks = _blocks(weight)
        for row, column in np.ndindex(*blocks.shape[:2]):
            value = vector("mat4", blocks[row, column].T.ravel(), digits)
            yield f"const mat4 prt_w{layer}_{row}_{column} = {value};"


def _fours(values: Float[Array, " n"], digits: int) -> list[str]:
    """Vectors of literals, padded with 0."""
    padded = np.zeros(4 * quads(len(values)), np.float32)
    padded[: len(values)] = values
    return [vector("vec4", four, digits) for four in padded.reshape(-1, 4)]


def _forward(field: Neural, digits: int) -> Iterator[str]:
    """Statements from `inside` to `within`, with the phases t{layer}_{row} in turns on the way."""
    names = ["vec4(inside, 0.0)"]
    for layer, (weight, bias) in enumerate(zip(field.weights[:-1], field.biases[:-1], strict=True)):
        for row, shift in enumerate(_fours(bias, digits)):
            terms = [shift, *(f"prt_w{layer}_{row}_{column} * {name}" for column, name in enumerate(names))]
            yield f"  vec4 t{layer}_{row} = prt_turns({' + '.join(terms)});"
        count = quads(len(weight))
        # what pads a layer has no weight in the next one
        yield f"  vec4 {', '.join(f'h{layer}_{row} = prt_sine(t{layer}_{row})' for row in range(count))};"
        names = [f"h{layer}_{row}" for row in range(count)]
    last = zip(_fours(field.weights[-1][0], digits), names, strict=True)
    terms = [number(field.biases[-1][0], digits), *(f"dot({value}, {name})" for value, name in last)]
    yield f"  float within = {' + '.join(terms)};"


def _backward(field: Neural, digits: int) -> Iterator[str]:
    """Statements from the phases to `slope`, the gradient of `within`."""
    slopes = _fours(field.weights[-1][0], digits)
    for layer in reversed(range(len(field.weights) - 1)):
        bent = [f"{slope} * prt_cosine(t{layer}_{row})" for row, slope in enumerate(slopes)]
        yield f"  vec4 {', '.join(f'g{layer}_{row} = {value}' for row, value in enumerate(bent))};"
        columns = quads(field.weights[layer].shape[1])
        sums = [
            " + ".join(f"g{layer}_{row} * prt_w{layer}_{row}_{column}" for row in range(len(bent)))
            for column in range(columns)
        ]
        slopes = [f"b{layer}_{column}" for column in range(columns)]
        yield f"  vec4 {', '.join(f'{name} = {total}' for name, total in zip(slopes, sums, strict=True))};"
    yield f"  vec3 slope = {slopes[0]}.xyz;"
