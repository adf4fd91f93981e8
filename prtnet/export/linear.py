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

    `weight`: an expression of (layer, texel), the vec4 of weights there. Four texels of one cluster are blended first.
    """
    layers = _layers(elements)
    outputs = [f"v{vector}" for vector in range(vectors)]
    fetched = [weight.format(layer=layer, texel="texel") for layer in range(layers)]
    lines = [
        f"uniform usampler2D {CLUSTERS};",
        f"int linear_cluster(ivec2 texel) {{ return int(texelFetch({CLUSTERS}, texel, 0).r); }}",
        f"void linear_add(ivec2 texel, int cluster, float share, {_list('inout vec4', outputs)}) {{",
        f"  vec4 {', '.join(f'f{vector}' for vector in range(vectors))};",
        f"  linear_decode(cluster, {', '.join([*fetched, *(f'f{vector}' for vector in range(vectors))])});",
        *(f"  v{vector} += share * f{vector};" for vector in range(vectors)),
        "}",
        f"void linear_look_up(vec2 uv, {_list('out vec4', outputs)}) {{",
        f"  ivec2 side = textureSize({CLUSTERS}, 0);",
        "  vec2 place = uv * vec2(side) - 0.5;",
        "  vec2 part = place - floor(place);",
        "  ivec2 a = clamp(ivec2(floor(place)), ivec2(0), side - 1);",
        "  ivec2 d = clamp(ivec2(floor(place)) + 1, ivec2(0), side - 1);",
        "  ivec2 b = ivec2(d.x, a.y);",
        "  ivec2 c = ivec2(a.x, d.y);",
        "  vec4 share = vec4((1.0 - part.x) * (1.0 - part.y), part.x * (1.0 - part.y), (1.0 - part.x) * part.y,"
        " part.x * part.y);",
        "  ivec4 own = ivec4(linear_cluster(a), linear_cluster(b), linear_cluster(c), linear_cluster(d));",
        "  if (own == ivec4(own.x)) {",
        f"    linear_decode(own.x, {', '.join([*(_blend(weight, layer) for layer in range(layers)), *outputs])});",
        "    return;",
        "  }",
        *(f"  {each} = vec4(0.0);" for each in outputs),
        *(f"  linear_add({each}, own[{i}], share[{i}], {', '.join(outputs)});" for i, each in enumerate("abcd")),
        "}",
    ]
    return "\n".join([*lines, ""])


def _blend(weight: str, layer: int) -> str:
    return " + ".join(f"share[{i}] * {weight.format(layer=layer, texel=texel)}" for i, texel in enumerate("abcd"))


def _list(kind: str, names: list[str]) -> str:
    return ", ".join(f"{kind} {name}" for name in names)


def _layers(elements: int) -> int:
    """vec4 that hold so many weights."""
    return -(-elements // 4)
