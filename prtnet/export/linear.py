"""Transfer as a weighted sum of a few vectors (`prtnet.models.pca`), as GLSL: what a table of vectors and weights say.

The table has a row for each cluster: V vec4 of its mean, then V of each of its vectors. V is 1 for a diffuse material,
whose table holds what these are under the light, RGB; for gloss it holds the transfer itself, in padded groups. A table
of one row may be an array of uniforms, which llvmpipe reads twice as fast as a texture.
"""

import numpy as np
from jaxtyping import Float, Float32

Array = np.ndarray

NAME = "linear_table"
CLUSTERS = "cluster_map"
MOST_UNIFORMS = 128  # vec4 of a table that is no texture; OpenGL promises 256


def index_bytes(clusters: int) -> int:
    """Of the cluster of a texel or vertex."""
    return 0 if clusters == 1 else 1 if clusters <= 256 else 2


def in_uniforms(table: Float[Array, "c e v 4"]) -> bool:
    """Whether a table is short enough for an array of uniforms."""
    return len(table) == 1 and table[0].size <= 4 * MOST_UNIFORMS


def image(table: Float[Array, "c e v 4"]) -> Float32[Array, "c _ 4"]:
    """The table as a texture, texel (x, y) = image[y, x]."""
    return np.ascontiguousarray(table.reshape(len(table), -1, 4), np.float32)


def decoding(table: Float[Array, "c e v 4"]) -> str:
    """`void linear_decode(int cluster, vec4 w0, ..., out vec4 v0, ...)`, with the uniform that it reads."""
    _, entries, vectors, _ = table.shape
    if in_uniforms(table):
        lines = [f"uniform vec4 {NAME}[{entries * vectors}];", f"#define LINEAR_ENTRY(i) {NAME}[i]"]
    else:
        lines = [f"uniform sampler2D {NAME};", f"#define LINEAR_ENTRY(i) texelFetch({NAME}, ivec2(i, cluster), 0)"]
    weights = [f"vec4 w{layer}" for layer in range(_layers(entries - 1))]
    outputs = [f"out vec4 v{vector}" for vector in range(vectors)]
    lines.append(f"void linear_decode(int cluster, {', '.join([*weights, *outputs])}) {{")
    for vector in range(vectors):
        terms = [f"LINEAR_ENTRY({vector})"]
        terms += [
            f"w{element // 4}[{element % 4}] * LINEAR_ENTRY({(1 + element) * vectors + vector})"
            for element in range(entries - 1)
        ]
        lines.append(f"  v{vector} = {' + '.join(terms)};")
    return "\n".join([*lines, "}", ""])


def looking_up(elements: int, vectors: int, weight: str) -> str:
    """`void linear_look_up(vec2 uv, out vec4 v0, ...)`: four texels, each by its own cluster, then the bilinear mean.

    `weight`: an expression with {layer} and {texel} in it, the vec4 of weights there. Texels of one cluster are blended
    before they are decoded; the text has one decoder for both cases, since compilers take their time over each.
    """
    layers, outputs = range(_layers(elements)), [f"v{vector}" for vector in range(vectors)]
    weights, found = [f"w{layer}" for layer in layers], [f"f{vector}" for vector in range(vectors)]
    own = [f"w{layer} = {weight.format(layer=layer, texel='texel')};" for layer in layers]
    lines = [
        f"uniform usampler2D {CLUSTERS};",
        f"void linear_look_up(vec2 uv, {', '.join(f'out vec4 {each}' for each in outputs)}) {{",
        f"  ivec2 side = textureSize({CLUSTERS}, 0);",
        "  vec2 place = uv * vec2(side) - 0.5;",
        "  ivec2 low = ivec2(floor(place));",
        "  vec2 part = place - vec2(low);",
        "  ivec2 texels[4];",
        "  int clusters[4];",
        "  float shares[4];",
        "  for (int i = 0; i < 4; ++i) {",
        "    ivec2 step = ivec2(i & 1, i >> 1);",
        "    texels[i] = clamp(low + step, ivec2(0), side - 1);",
        f"    clusters[i] = int(texelFetch({CLUSTERS}, texels[i], 0).r);",
        "    vec2 both = mix(1.0 - part, part, vec2(step));",
        "    shares[i] = both.x * both.y;",
        "  }",
        "  bool alike = clusters[1] == clusters[0] && clusters[2] == clusters[0] && clusters[3] == clusters[0];",
        f"  vec4 {', '.join(weights + found)};",
        *(f"  {each} = vec4(0.0);" for each in outputs),
        "  for (int i = 0; i < (alike ? 1 : 4); ++i) {",
        "    ivec2 texel = texels[i];",
        "    if (alike) {",
        *(f"      w{layer} = {_blend(weight, layer)};" for layer in layers),
        "    } else {",
        *(f"      {each}" for each in own),
        "    }",
        f"    linear_decode(clusters[i], {', '.join(weights + found)});",
        "    float share = alike ? 1.0 : shares[i];",
        *(f"    {each} += share * {one};" for each, one in zip(outputs, found, strict=True)),
        "  }",
        "}",
    ]
    return "\n".join([*lines, ""])


def _blend(weight: str, layer: int) -> str:
    return " + ".join(f"shares[{i}] * {weight.format(layer=layer, texel=f'texels[{i}]')}" for i in range(4))


def _layers(elements: int) -> int:
    """vec4 that hold so many weights."""
    return -(-elements // 4)
