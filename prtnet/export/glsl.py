"""A net as one GLSL function.

    void prt_transfer(vec3 position, vec3 normal, out vec4 t0, out vec4 t1, ...)

`position` is the centred position in [-1, 1]^3, `normal` the unit world normal, and `t0.x, t0.y, ...` the SH
coefficients of the transfer, the last vector padded with 0. Weights are literals (`prtnet.export.literal`), so that
without grids there is nothing to bind, or stand in a texture (`prtnet.export.weight_texture`) or in uniform blocks
(`prtnet.export.uniform_block`). Sine and cosine are polynomials of the reduced argument in turns, since those of some
drivers are off by 1e-3 at high frequencies. Grids of features are samplers prt_grid0, prt_grid1, ...
(`prtnet.export.grid`), hashed ones prt_hash0, ... (`prtnet.export.hash_grid`). A net with texel features, prt_texels0,
... (`prtnet.export.texel_grid`), has a third parameter, `vec2 uv`, the place in the atlas it was trained with, v up.
"""

import math
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

from prtnet import PrtnetError, netspec, sh
from prtnet.export import form, grid, hash_grid, limits, literal, texel_grid, uniform_block, weight_texture
from prtnet.export.form import Form
from prtnet.export.limits import Limits
from prtnet.export.spelling import grouped, number, quads, zonal_harmonics
from prtnet.netspec import NetSpec

VERSIONS = form.VERSIONS

# sin(2 pi t) = t P(t^2) on a quarter turn, minimax in absolute error: 3.3e-9
_SINE = (6.28318516, -41.34165503, 81.60100406, -76.54978194, 39.53670321)
_TURN = 6.28125  # 2 pi but for 1.9e-3
_TRIANGLE = "vec3 prt_quarter(vec3 t) { return 4.0 * t; }"


def emit(
    net: NetSpec,
    *,
    version: str = "330",
    storage: str = "literal",
    precision: str = "float32",
    digits: int = 9,
    target: Limits | None = None,
) -> str:
    """The text of `prt_transfer` and its helpers (all named prt_...), to paste into a shader of that version.

    What it computes is the net `form.rounded`. Raises PrtnetError where the net is too large for literals, since
    compilers take minutes, or for `target`: the least that the version promises, unless given.
    """
    return transfer(net, Form(version, storage, precision, digits), target)


def transfer(
    net: NetSpec, wanted: Form, target: Limits | None = None, *, name: str = "prt_transfer", stack: int = 1
) -> str:
    """`emit` with its options as one, and the function's name. `stack`: as `hidden` has it."""
    target = target or limits.MINIMUM[wanted.version]
    chosen = wanted.of(net)
    outputs = ", ".join(f"out vec4 t{i}" for i in range(vectors(net)))
    lines = [f"void {name}({parameters(net)}, {outputs}) {{"]
    lines += [f"  {line}" for line in _body(form.rounded(net, chosen), chosen, target, stack)]
    return written(net, chosen, target, lines)


def inputs(net: NetSpec) -> dict[str, str]:
    """What a point is given by, with types: the first parameters of all functions of a point."""
    return {"position": "vec3", "normal": "vec3"} | ({"uv": "vec2"} if net.texels else {})


def parameters(net: NetSpec) -> str:
    """`inputs` as a function declares them."""
    return ", ".join(f"{kind} {name}" for name, kind in inputs(net).items())


def fragment_shader(net: NetSpec, version: str = "330") -> str:
    """A whole fragment shader with its version line: `emit` within `around`."""
    return whole(version, around(net, emit(net, version=version)))


def whole(version: str, text: str) -> str:
    """With the version line."""
    if version.endswith("es"):
        return f"#version {version}\nprecision highp float;\nprecision highp sampler2D;\n{text}"
    return f"#version {version} core\n{text}"


def around(net: NetSpec, source: str, *, first: int = 0) -> str:
    """Shader text about the function text `source`, without a version line.

    Reads textures `positions` and `normals`, and `uvs` where the net takes them, at the pixel and writes up to 8 of the
    vec4s, from `first` on: no driver needs to have more outputs.
    """
    names = [f"t{i}" for i in range(vectors(net))]
    written = names[first : first + 8]
    lines = [f"layout(location = {i}) out vec4 colour_{name};" for i, name in enumerate(written)]
    lines += [*point(net), source, "void main() {", *at_pixel(net)]
    lines += [f"  vec4 {', '.join(names)};"]
    lines += [f"  prt_transfer({', '.join([*inputs(net), *names])});"]
    lines += [f"  colour_{name} = {name};" for name in written]
    return "\n".join(lines) + "\n}\n"


def point(net: NetSpec) -> list[str]:
    """The textures that give a pixel its point: `positions`, `normals`, and `uvs` where the net takes them."""
    return [f"uniform sampler2D {name}s;" for name in inputs(net)]


def at_pixel(net: NetSpec) -> list[str]:
    """Statements after which a pixel has its point."""
    fetched = [f"  {kind} {name} = {kind}(texelFetch({name}s, pixel, 0));" for name, kind in inputs(net).items()]
    return ["  ivec2 pixel = ivec2(gl_FragCoord.xy);", *fetched]


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
    return form.padded_macs_of(form.sizes_of(net), net.groups)


def needs(net: NetSpec, chosen: Form, target: Limits, source_bytes: int = 0, components: int = 0) -> limits.Needs:
    """What a function asks of its target, with the textures that `around` reads."""
    blocks = uniform_block.blocks(net, target.block_bytes) if chosen.storage == "ubo" else []
    flat = [hash_grid.texels(each.table) for each in net.hashes] + [texel_grid.texels(each) for each in net.texels]
    image = weight_texture.texels(net).shape if chosen.storage == "texture" else (0,)
    return limits.Needs(
        source_bytes,
        block_bytes=max((each.nbytes for each in blocks), default=0),
        blocks=len(blocks),
        components=components,
        weight_side=max(image[:2]),
        texture_side=max((max(image.shape[:2]) for image in flat), default=0),
        volume_side=max((max(grid.texels(each).shape[:3]) for each in net.grids), default=0),
        samplers=len(inputs(net)) + len(net.grids) + len(flat) + (chosen.storage == "texture"),
    )


def written(net: NetSpec, chosen: Form, target: Limits, function: list[str], components: int = 0) -> str:
    """The lines of a function, but for its last brace, below what they need. Raises PrtnetError beyond `target`.

    `components`: of the uniforms among these lines.
    """
    lines = [_header(net)]
    if chosen.version.endswith("es"):
        lines += ["precision highp float;", "precision highp int;"]
    lines += grid.declarations(net) + hash_grid.declarations(net) + texel_grid.declarations(net)
    if chosen.storage == "texture":
        lines += weight_texture.declarations(net, chosen.precision)
    elif chosen.storage == "ubo":
        lines += uniform_block.declarations(net, target.block_bytes)
    text = "\n".join([*lines, *_helpers(net), *function]) + "\n}\n"
    limits.check(needs(net, chosen, target, len(text), components), target)
    return text


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


def _helpers(net: NetSpec) -> list[str]:
    lines = []
    if net.encoding != "identity" and (net.position_frequencies or net.normal_frequencies):
        lines += sine_of_turns("vec3") if net.encoding == "frequency" else [_TRIANGLE]
        lines += ["vec3 prt_sin(vec3 f) { return prt_quarter(sign(f) * (0.25 - abs(0.25 - abs(f)))); }"]
        lines += ["vec3 prt_cos(vec3 f) { return prt_quarter(0.25 - abs(f)); }"]
    if len(net.weights) > 1:
        lines += sine_of_turns("vec4") if net.activation == "sine" else []
        lines += [f"vec4 prt_bend(vec4 x) {{ {_activation(net)} }}"]
    return lines


def sine_of_turns(kind: str, name: str = "prt_quarter") -> list[str]:
    """A function of sin(2 pi t) for t in a quarter turn about 0."""
    polynomial = number(_SINE[-1])
    for coefficient in reversed(_SINE[:-1]):
        polynomial = f"{number(coefficient)} + u * ({polynomial})"
    return [f"{kind} {name}({kind} t) {{ {kind} u = t * t; return t * ({polynomial}); }}"]


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


def _body(net: NetSpec, chosen: Form, target: Limits, stack: int) -> Iterator[str]:
    """Statements that fill t0, t1, ... from the point."""
    names: list[str] = []
    yield from hidden(net, chosen, target, len(net.weights), names, stack)
    if net.output_scale != 1:
        names = [f"{number(net.output_scale)} * {name}" for name in names]
    if net.residual:
        lobe: list[str] = []
        yield from zonal_harmonics("normal", sh.cosine_zonal(net.bands), lobe)
        names = [f"{name} + {group}" for name, group in zip(names, net.groups * grouped(lobe), strict=True)]
    for i, expression in enumerate(names):
        yield f"t{i} = {expression};"


def hidden(net: NetSpec, chosen: Form, target: Limits, count: int, names: list[str], stack: int = 1) -> Iterator[str]:
    """Statements after which `names` has what leaves layer `count`, as vec4s. `stack`: of so many nets of these sizes,
    whose textures are joined, the one that `spelling.CHOSEN` says."""
    for letter, frequencies in (("position", net.position_frequencies), ("normal", net.normal_frequencies)):
        yield from _encoding(letter, frequencies if net.encoding != "identity" else 0, names)
    yield from grid.statements(net, names, stack)
    yield from hash_grid.statements(net, names, stack)
    yield from texel_grid.statements(net, names)
    names[:] = grouped(names)
    if chosen.storage == "texture":
        yield from weight_texture.layers(net, names, count, stack)
    elif chosen.storage == "ubo":
        yield from uniform_block.layers(net, names, count, target.block_bytes)
    else:
        yield from literal.layers(net, names, count, chosen.digits)


def _encoding(vector: str, frequencies: int, names: list[str]) -> Iterator[str]:
    letter = vector[0]
    names += [f"{vector}.{axis}" for axis in "xyz"]
    for j in range(frequencies):
        turns = f"{letter}{j}"
        yield f"vec3 {turns} = {number(2.0 ** (j - 1))} * {vector};"
        yield f"{turns} -= floor({turns} + 0.5);"
        yield f"vec3 {turns}s = prt_sin({turns}), {turns}c = prt_cos({turns});"
        names += [f"{turns}{function}.{axis}" for function in "sc" for axis in "xyz"]
