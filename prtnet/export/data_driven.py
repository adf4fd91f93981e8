"""Data-driven transfer in GLSL and as files for others (docs/data-driven.md).

    reduce          a pixel for each element: u_i = sum_j M_ij x_j^(1/g), from a texture of direct light, per colour
    prt_indirect    vec3 prt_indirect(vec2 uv): (sum_i u_i B_i(uv))^g, four elements to a layer of an array texture,
                    their coefficients as mat4x3; 0 or more

The text is the same in GLSL 330 and 300 es. Basis textures have rows of length 1, so that their values shrink as texels
grow in number: what is stored is `scale` times as large, and the matrix that much smaller, a power of two near the
square root of that number. 16-bit floats then hold all of it with the same relative error.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32

from prtnet import data_driven, store
from prtnet.data import texture
from prtnet.data.quantise import Stored
from prtnet.data.texture import Page
from prtnet.data_driven import DataDriven
from prtnet.export import certificate, glsl, lamps
from prtnet.export.spelling import number, quads, vector
from prtnet.export.texture_file import write_exr

Array = np.ndarray

SPEC, EXR = "data_driven.safetensors", "indirect_basis.exr"
# of lamps (`export.lamps`): the function, and the passes that make the direct vector of it
DIRECT, MEASURE, AVERAGE = "direct.glsl", "measure.frag", "average.frag"
# the passes of this module: the function to paste, and a whole shader that writes it for each texel
REDUCE, BLEND, TEXELS = "reduce.frag", "indirect.glsl", "indirect.frag"
NAMES = (SPEC, EXR, DIRECT, MEASURE, AVERAGE, REDUCE, BLEND, TEXELS)
COLOURS = ("red", "green", "blue")
# where prt_indirect finds coefficients: in a uniform array, in a uniform block, or in the texture that reduce drew
HELD = ("uniform", "block", "texture")
BLOCK = "prt_coefficient_block"


def scale_of(spec: DataDriven) -> float:
    """What stored basis values are multiples of: a power of two, exact in any format."""
    return float(2.0 ** round(math.log2(math.sqrt(max(len(spec.texels), 1)))))


def reduce(spec: DataDriven) -> str:
    """Fragment shader, without a version line, for a target of `width` x 1: pixel i is u_i / scale, RGB.

    Texel j of the texture `prt_direct`, row by row from (0, 0) on, is x_j; `prt_matrix` is `matrix_texels`.
    """
    count = spec.matrices.shape[3]
    firsts = ["element"] + [f"element + {bank * width(spec)}" for bank in range(1, _banks(spec))]
    rows = [f"texelFetch(prt_matrix, ivec2(q, {first}), 0)" for first in firsts]
    taken = "mat4x3(prt_light(4 * q), prt_light(4 * q + 1), prt_light(4 * q + 2), prt_light(4 * q + 3))"
    if len(rows) == 1:
        step = [f"sum += {taken} * {rows[0]};"]
    else:
        step = [f"mat3x4 x = transpose({taken});"]
        step += [f"sum[{bank}] += dot(x[{bank}], {row});" for bank, row in enumerate(rows)]
    found = "texelFetch(prt_direct, ivec2(j % wide, j / wide), 0).rgb"
    if spec.gamma != 1:
        found = f"pow(max({found}, 0.0), vec3({number(1 / spec.gamma)}))"
    lines = [
        f"uniform highp sampler2D prt_direct;  // texel j, row by row: direct light at point j of {count}",
        "uniform highp sampler2D prt_matrix;  // texel (q, i): M[i, 4 q to 4 q + 3] / scale",
        "out vec4 colour;",
        "vec3 prt_light(int j) {",
        f"  if (j >= {count}) return vec3(0.0);",
        "  int wide = textureSize(prt_direct, 0).x;",
        f"  return {found};",
        "}",
        "void main() {",
        "  int element = int(gl_FragCoord.x);",
        "  vec3 sum = vec3(0.0);",
        f"  for (int q = 0; q < {quads(count)}; ++q) {{",
        *(f"    {line}" for line in step),
        "  }",
        "  colour = vec4(sum, 1.0);",
        "}",
    ]
    return "\n".join(lines) + "\n"


def matrix_texels(spec: DataDriven, keyframe: int = 0) -> Float32[Array, "rows columns 4"]:
    """What `prt_matrix` holds: texel (q, i) is M[i, 4 q to 4 q + 3] / scale; the banks one below the other, each padded
    with rows of 0 to `width`."""
    banks, n, m = spec.matrices.shape[1:]
    table = np.zeros((banks, width(spec), 4 * quads(m)), np.float32)
    table[:, :n, :m] = spec.matrices[keyframe] / np.float32(scale_of(spec))
    return table.reshape(banks * width(spec), -1, 4)


def width(spec: DataDriven) -> int:
    """Pixels of the target of `reduce`: elements, padded to whole layers."""
    return 4 * quads(spec.elements)


def indirect(spec: DataDriven, *, held: str = "uniform", stored: Stored | None = None) -> str:
    """The text of `prt_indirect` and what it reads: the array texture `prt_basis`, and coefficients where HELD says.

    `stored`: basis textures kept as bytes, whose range becomes part of the text.
    """
    assert held in HELD, held
    layers, banks = quads(spec.elements), _banks(spec)
    about = f"// {spec.quantity}; layer q: scale times elements 4 q to 4 q + 3" + ", bank by bank" * (banks > 1)
    lines = [f"uniform highp sampler2DArray prt_basis;  {about}", *_declared(held, layers)]
    lines += ["vec3 prt_indirect(vec2 uv) {"]
    sums: list[list[str]] = [[] for _ in range(banks)]
    for layer in range(layers):
        matrix = f"u{layer}"
        lines += [f"  mat4x3 {matrix} = {_matrix(held, layer)};"]
        lines += [f"  mat3x4 v{layer} = transpose({matrix});"] * (banks > 1)
        for bank in range(banks):
            basis = _texel(bank * layers + layer, stored)
            term = f"{matrix} * {basis}" if banks == 1 else f"dot(v{layer}[{bank}], {basis})"
            sums[bank].append(term)
    joined = ", ".join(" + ".join(terms) for terms in sums)
    lines += [f"  vec3 sum = {joined};" if banks == 1 else f"  vec3 sum = vec3({joined});"]
    found = "max(sum, 0.0)" if spec.gamma == 1 else f"pow(max(sum, 0.0), vec3({number(spec.gamma)}))"
    return "\n".join([*lines, f"  return {found};", "}"]) + "\n"


def _declared(held: str, layers: int) -> list[str]:
    if held == "block":
        return [f"layout(std140) uniform {BLOCK} {{ highp vec4 prt_coefficients[{4 * layers}]; }};"]
    if held == "texture":
        return ["uniform highp sampler2D prt_coefficients;"]
    return [f"uniform highp mat4x3 prt_coefficients[{layers}];  // column i of matrix q: u / scale of element 4 q + i"]


def _matrix(held: str, layer: int) -> str:
    """u of four elements, a column each."""
    if held == "uniform":
        return f"prt_coefficients[{layer}]"
    places = range(4 * layer, 4 * layer + 4)
    if held == "block":
        columns = [f"prt_coefficients[{place}].rgb" for place in places]
    else:
        columns = [f"texelFetch(prt_coefficients, ivec2({place}, 0), 0).rgb" for place in places]
    return f"mat4x3({', '.join(columns)})"


def _texel(layer: int, stored: Stored | None) -> str:
    """Values of four elements where a fragment is."""
    found = f"texture(prt_basis, vec3(uv, {layer}.0))"
    if stored is None or stored.levels[0].dtype != np.uint8:
        return found
    four = slice(4 * layer, 4 * layer + 4)
    return f"({found} * {vector('vec4', stored.scale[four])} + {vector('vec4', stored.offset[four])})"


def whole(spec: DataDriven, text: str) -> str:
    """Fragment shader about `prt_indirect`, without a version line: its value at the centre of each texel of a target
    of the atlas's size."""
    main = f"  colour = vec4(prt_indirect(gl_FragCoord.xy * {number(1 / spec.size)}), 1.0);"
    return "\n".join([text + "out vec4 colour;", "void main() {", main, "}"]) + "\n"


def basis_page(spec: DataDriven, *, dilation: int = 3) -> Page:
    """The basis textures, `scale` times as large and dilated; each bank padded with channels of 0 to whole layers."""
    used = np.zeros(spec.size * spec.size, bool)
    used[spec.texels] = True
    used = used.reshape(spec.size, spec.size)
    banks, n, t = spec.basis.shape
    padded = np.zeros((t, banks, width(spec)), np.float32)
    padded[:, :, :n] = np.moveaxis(spec.basis, 2, 0) * np.float32(scale_of(spec))
    image = data_driven.image(spec, padded.reshape(t, -1))
    return Page((texture.dilated(image, used, dilation),), used)


def channel_names(spec: DataDriven) -> list[str]:
    """Of the EXR: `e00`, `e01`, ..., or `red.e00`, ... with a bank for each colour."""
    digits = max(2, len(str(spec.elements - 1)))
    names = [f"e{i:0{digits}}" for i in range(spec.elements)]
    return names if _banks(spec) == 1 else [f"{bank}.{name}" for bank in COLOURS for name in names]


def files(spec: DataDriven, version: str = "330") -> dict[str, str]:
    """The texts of an export by the names of their files."""
    text = indirect(spec)
    return {
        DIRECT: lamps.functions(),
        MEASURE: glsl.whole(version, lamps.measured()),
        AVERAGE: glsl.whole(version, lamps.AVERAGED),
        REDUCE: glsl.whole(version, reduce(spec)),
        BLEND: text,
        TEXELS: glsl.whole(version, whole(spec, text)),
    }


def facts(spec: DataDriven) -> dict[str, Any]:
    """The entry `data_driven` of a certificate."""
    return {
        "scene": spec.scene,
        "quantity": spec.quantity,
        "elements": spec.elements,
        "banks": _banks(spec),
        "points": spec.matrices.shape[3],
        "keyframes": len(spec.measurements),
        "gamma": spec.gamma,
        "size": spec.size,
        "scale": scale_of(spec),
        "bytes": data_driven.byte_count(spec, 2),
    }


def write(folder: Path, spec: DataDriven, measured: Mapping[str, Any], *, version: str = "330") -> None:
    """Write the files of a run and, last, their certificate with what was `measured` of them.

    Raises PrtnetError, and leaves nothing of it in the folder, where an error is above its bound or a text not valid.
    """
    certificate.remove(folder, NAMES)
    certificate.refuse(measured["errors"])
    texts = files(spec, version)
    checked = [glsl.validate(texts[name]) is not None for name in texts if name.endswith(".frag")]
    for name, text in texts.items():
        store.write_text(folder / name, text)
    data_driven.save(spec, folder / SPEC)
    image = basis_page(spec).levels[0].reshape(spec.size, spec.size, _banks(spec), -1)[..., : spec.elements]
    flat = image.reshape(spec.size, spec.size, -1)
    write_exr(folder / EXR, [flat], half=True, names=[""], channels=channel_names(spec))
    form = {"version": version, "texels": "float16"}
    certificate.write(folder, {"data_driven": facts(spec), "form": form, **measured, "validated": all(checked)}, NAMES)


def _banks(spec: DataDriven) -> int:
    return spec.basis.shape[0]
