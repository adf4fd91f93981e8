"""A net as one GLSL function with its weights as literals. No arrays, no loops; without grids nothing to bind.

    void prt_transfer(vec3 position, vec3 normal, out vec4 t0, out vec4 t1, ...)

`position` is the centred position in [-1, 1]^3, `normal` the unit world normal, and `t0.x, t0.y, ...` the SH
coefficients of the transfer, the last vector padded with 0. Each layer is h = b + mat4(...) * x0 + mat4(...) * x1 + ...
over vec4s. Sine and cosine are polynomials of the reduced argument in turns, since those of some drivers
are off by 1e-3 at high frequencies. Grids of features are samplers prt_grid0, prt_grid1, ... (`prtnet.export.grid`),
hashed ones prt_hash0, ... (`prtnet.export.hash_grid`).
"""

import math
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Int

from prtnet import PrtnetError, netspec, sh
from prtnet.export import grid, hash_grid
from prtnet.export.spelling import grouped, number, quads, vector, zonal_harmonics
from prtnet.netspec import NetSpec

VERSIONS = ("330", "430", "300 es")
MAX_LITERAL_MACS = 60_000

# sin(2 pi t) = t P(t^2) on a quarter turn, minimax in absolute error: 3.3e-9
_SINE = (6.28318516, -41.34165503, 81.60100406, -76.54978194, 39.53670321)
_TURN = 6.28125  # 2 pi but for 1.9e-3


def emit(net: NetSpec, *, version: str = "330", storage: str = "literal") -> str:
    """The text of `prt_transfer` and its helpers (all named prt_...), to paste into a shader of that version.

    Raises PrtnetError where the net is too large for literals: compilers take minutes.
    """
    _check(net, version, storage)
    lines = [_header(net)]
    if version.endswith("es"):
        lines += ["precision highp float;", "precision highp int;"]
    lines += grid.declarations(net) + hash_grid.declarations(net) + _helpers(net)
    lines += [f"void prt_transfer(vec3 position, vec3 normal, {_outputs(net)}) {{"]
    lines += [f"  {line}" for line in _body(net)]
    return "\n".join(lines) + "\n}\n"


def fragment_shader(net: NetSpec, version: str = "330") -> str:
    """A whole fragment shader with its version line: `emit` within `around`."""
    head = [f"#version {version}" if version.endswith("es") else f"#version {version} core"]
    if version.endswith("es"):
        head += ["precision highp float;", "precision highp sampler2D;"]
    return "\n".join(head) + "\n" + around(net, emit(net, version=version))


def around(net: NetSpec, source: str, *, first: int = 0) -> str:
    """Shader text about the function text `source`, without a version line.

    Reads textures `positions` and `normals` at the pixel and writes up to 8 of the vec4s, from `first` on: no driver
    needs to have more outputs.
    """
    names = [f"t{i}" for i in range(vectors(net))]
    written = names[first : first + 8]
    lines = ["uniform sampler2D positions;", "uniform sampler2D normals;"]
    lines += [f"layout(location = {i}) out vec4 colour_{name};" for i, name in enumerate(written)]
    lines += [source, "void main() {"]
    lines += ["  ivec2 pixel = ivec2(gl_FragCoord.xy);"]
    lines += ["  vec3 position = texelFetch(positions, pixel, 0).xyz, normal = texelFetch(normals, pixel, 0).xyz;"]
    lines += [f"  vec4 {', '.join(names)};"]
    lines += [f"  prt_transfer(position, normal, {', '.join(names)});"]
    lines += [f"  colour_{name} = {name};" for name in written]
    return "\n".join(lines) + "\n}\n"


def validate(source: str) -> str | None:
    """Runs glslangValidator on a whole fragment shader: None where it is not installed, else "" for valid text.

    Raises PrtnetError with the validator's words where the text is not valid.
    """
    program = shutil.which("glslangValidator")
    if program is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "net.frag"
        file.write_text(source)
        result = subprocess.run([program, str(file)], capture_output=True, text=True, check=False)
    if result.returncode:
        raise PrtnetError(f"exported shader: glslangValidator found {result.stdout.strip()[-2000:]}")
    return ""


def vectors(net: NetSpec) -> int:
    """Number of vec4 outputs of `prt_transfer`: each group of coefficients is padded to whole ones."""
    return net.groups * quads(sh.count(net.bands))


def padded_macs(net: NetSpec) -> int:
    """Multiply-adds of the layers with every size rounded up to a multiple of 4, as the mat4 form computes them."""
    return _padded_macs([net.weights[0].shape[1], *map(len, net.biases)], net.groups)


def check_size(sizes: list[int], groups: int = 1) -> None:
    """Raises PrtnetError where a net of these layers, inputs first, is too large for literals."""
    if _padded_macs(sizes, groups) > MAX_LITERAL_MACS:
        raise PrtnetError(
            f"GLSL export: found {_padded_macs(sizes, groups)} padded multiply-adds, expected at most"
            f" {MAX_LITERAL_MACS} as literals, since compilers take minutes; lower model.width or model.depth"
        )


def _padded_macs(sizes: list[int], groups: int) -> int:
    vectors = [*map(quads, sizes[:-1]), groups * quads(sizes[-1] // groups)]
    return sum(16 * before * after for before, after in pairwise(vectors))


def _check(net: NetSpec, version: str, storage: str) -> None:
    if version not in VERSIONS:
        raise PrtnetError(f"GLSL version: found {version!r}, expected one of {', '.join(VERSIONS)}")
    if storage != "literal":
        raise PrtnetError(f"GLSL weight storage: found {storage!r}, expected 'literal'")
    check_size([net.weights[0].shape[1], *map(len, net.biases)], net.groups)


def _header(net: NetSpec) -> str:
    sizes = " -> ".join(str(size) for size in (net.weights[0].shape[1], *(len(bias) for bias in net.biases)))
    centre = ", ".join(repr(float(value)) for value in net.centre)
    return f"""\
// {net.name.replace(chr(10), " ")}: precomputed radiance transfer in a small network
// {sizes}, {netspec.macs(net)} multiply-adds
// t: SH coefficients of V max(0, n.w) over the world, {net.bands} bands, index l*l + l + m, Y_1 = sqrt(3/4pi) (y, z, x)
// position = (file position - ({centre})) * {float(net.scale)!r}, computed in float64; normal: unit, in world space
// diffuse radiance = albedo / pi * sum_i t_i L_i with L_i the coefficients of the light{_groups(net)}"""


def _groups(net: NetSpec) -> str:
    if net.groups == 1:
        return ""
    each = quads(sh.count(net.bands))
    names = ", ".join(f"{word} t{group * each}" for group, word in enumerate(("direct", "red", "green", "blue")))
    return f"\n// with light from other surfaces: four groups of {each} vectors, beginning at {names}"


def _outputs(net: NetSpec) -> str:
    return ", ".join(f"out vec4 t{i}" for i in range(vectors(net)))


def _helpers(net: NetSpec) -> list[str]:
    lines = []
    if net.encoding != "identity" and (net.position_frequencies or net.normal_frequencies):
        lines += _sine("vec3") if net.encoding == "frequency" else ["vec3 prt_quarter(vec3 t) { return 4.0 * t; }"]
        lines += ["vec3 prt_sin(vec3 f) { return prt_quarter(sign(f) * (0.25 - abs(0.25 - abs(f)))); }"]
        lines += ["vec3 prt_cos(vec3 f) { return prt_quarter(0.25 - abs(f)); }"]
    if len(net.weights) > 1:
        lines += _sine("vec4") if net.activation == "sine" else []
        lines += [f"vec4 prt_bend(vec4 x) {{ {_activation(net)} }}"]
    return lines


def _sine(kind: str) -> list[str]:
    """sin(2 pi t) for t in a quarter turn about 0."""
    polynomial = number(_SINE[-1])
    for coefficient in reversed(_SINE[:-1]):
        polynomial = f"{number(coefficient)} + u * ({polynomial})"
    return [f"{kind} prt_quarter({kind} t) {{ {kind} u = t * t; return t * ({polynomial}); }}"]


def _activation(net: NetSpec) -> str:
    if net.activation == "leaky_relu":
        return f"return max(x, {number(net.negative_slope)} * x);"
    if net.activation == "relu":
        return "return max(x, 0.0);"
    if net.activation == "sine":
        # whole turns go in two parts, the first of 8 bits, whose multiples float32 holds exactly
        turns = f"vec4 n = floor({number(0.5 / math.pi)} * x + 0.5);"
        rest = f"vec4 t = {number(0.5 / math.pi)} * ((x - {number(_TURN)} * n) - {number(2 * math.pi - _TURN)} * n);"
        return f"{turns} {rest} return prt_quarter(sign(t) * (0.25 - abs(0.25 - abs(t))));"
    if net.activation == "hard_gelu":
        return "return x * clamp(0.5 * x + 0.5, 0.0, 1.0);"
    argument = "x"
    if net.activation == "gelu":
        inner = 2 * math.sqrt(2 / math.pi)
        argument = f"x * ({number(inner)} + {number(inner * 0.044715)} * x * x)"
    # the clamp keeps exp finite, so that no 1 / infinity arises; the value is 0 to float32 long before
    return f"return x / (1.0 + exp(min(-({argument}), vec4(80.0))));"


def _body(net: NetSpec) -> Iterator[str]:
    names: list[str] = []
    for letter, frequencies in (("position", net.position_frequencies), ("normal", net.normal_frequencies)):
        yield from _encoding(letter, frequencies if net.encoding != "identity" else 0, names)
    yield from grid.statements(net, names)
    yield from hash_grid.statements(net, names)
    for i, group in enumerate(grouped(names)):
        yield f"vec4 x0_{i} = {group};"
    for layer in range(len(net.weights)):
        yield from _layer(net, layer)
    result = [f"x{len(net.weights)}_{i}" for i in range(vectors(net))]
    if net.output_scale != 1:
        result = [f"{number(net.output_scale)} * {name}" for name in result]
    if net.residual:
        lobe: list[str] = []
        yield from zonal_harmonics("normal", sh.cosine_zonal(net.bands), lobe)
        result = [f"{name} + {group}" for name, group in zip(result, net.groups * grouped(lobe), strict=True)]
    for i, expression in enumerate(result):
        yield f"t{i} = {expression};"


def _encoding(vector: str, frequencies: int, names: list[str]) -> Iterator[str]:
    letter = vector[0]
    names += [f"{vector}.{axis}" for axis in "xyz"]
    for j in range(frequencies):
        turns = f"{letter}{j}"
        yield f"vec3 {turns} = {number(2.0 ** (j - 1))} * {vector};"
        yield f"{turns} -= floor({turns} + 0.5);"
        yield f"vec3 {turns}s = prt_sin({turns}), {turns}c = prt_cos({turns});"
        names += [f"{turns}{function}.{axis}" for function in "sc" for axis in "xyz"]


def _layer(net: NetSpec, layer: int) -> Iterator[str]:
    weight, bias = net.weights[layer], net.biases[layer]
    groups = net.groups if layer == len(net.weights) - 1 else 1
    each, columns = quads(weight.shape[0] // groups), quads(weight.shape[1])
    rows = groups * each
    row = _padded_rows(len(bias) // groups, groups)
    padded, shift = np.zeros((4 * rows, 4 * columns), np.float32), np.zeros(4 * rows, np.float32)
    padded[row, : weight.shape[1]] = weight
    shift[row] = bias
    for row in range(rows):
        terms = [vector("vec4", shift[4 * row : 4 * row + 4])]
        for column in range(columns):
            block = padded[4 * row : 4 * row + 4, 4 * column : 4 * column + 4]
            terms += [f"{vector('mat4', block.T.ravel())} * x{layer}_{column}"]
        yield f"vec4 x{layer + 1}_{row} = {_bent(net, layer, ' + '.join(terms))};"


def _padded_rows(size: int, groups: int) -> Int[np.ndarray, " n"]:
    """Where groups of `size` rows stand when each begins with a vec4 of its own."""
    return (np.arange(size) + 4 * quads(size) * np.arange(groups)[:, None]).ravel()


def _bent(net: NetSpec, layer: int, expression: str) -> str:
    if layer < len(net.weights) - 1:
        return f"prt_bend({expression})"
    return f"tanh({expression})" if net.output == "tanh" else expression
