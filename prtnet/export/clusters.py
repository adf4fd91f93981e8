"""Several nets that share one scene, `prtnet.clusters`, in GLSL: which of them counts how much at a point, and all of
them in one set of textures.

    void prt_cluster_weights(vec3 position, out float weights[N])    // sum to 1; or (int part, ...), split by parts
    vec3 prt_cluster_position(int cluster, vec3 position)            // of the scene to the cluster's own cube

Transfer is linear in the nets' outputs and radiance in the transfer, so that a program may blend either: a program for
each net and their colours one over the other (`share`), or one program that knows all nets (`stacked`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError, clusters
from prtnet.clusters import ClusterSpec
from prtnet.encoding import HashGrid
from prtnet.export import form, glsl, grid, hash_grid, limits, weight_texture
from prtnet.export.form import Form
from prtnet.export.limits import Limits
from prtnet.export.spelling import CHOSEN, number, vector
from prtnet.netspec import NetSpec

Array = np.ndarray

WEIGHTS, POSITION = "prt_cluster_weights", "prt_cluster_position"
_COMMON = (
    "position_frequencies", "normal_frequencies", "encoding", "activation", "negative_slope", "output", "output_scale",
    "residual",
)  # fmt: skip


def functions(spec: ClusterSpec) -> str:
    """The text of both functions, in any version."""
    frames = [clusters.own_frame(spec, index) for index in range(len(spec.nets))]
    cubes = ", ".join(vector("vec4", np.array([*centre, scale])) for centre, scale in frames)
    count = len(frames)
    scene = f"(file position - ({', '.join(map(repr, map(float, spec.centre)))})) * {float(spec.scale)!r}"
    lines = [
        f"// {count} clusters of a scene; position = {scene}, computed in float64",
        f"void {WEIGHTS}({'int part' if spec.split.parts else 'vec3 position'}, out float weights[{count}]) {{",
        *(f"  {line}" for line in _weights(spec)),
        "}",
        f"vec3 {POSITION}(int cluster, vec3 position) {{",
        f"  vec4 cubes[{count}] = vec4[{count}]({cubes});",
        "  return (position - cubes[cluster].xyz) * cubes[cluster].w;",
        "}",
    ]
    helper = [] if spec.split.parts else ["float prt_cluster_step(float distance) {", f"  {_step(spec.delta)}", "}"]
    return "\n".join([*helper, *lines]) + "\n"


def _step(delta: float) -> str:
    """`clusters.smooth_step`: exactly 0 and 1 beyond delta, so that no net runs for a weight that is but rounding."""
    if delta == 0:
        return "return distance >= 0.0 ? 1.0 : 0.0;"
    return f"float x = clamp(0.5 + {number(0.5 / delta)} * distance, 0.0, 1.0); return x * x * (3.0 - 2.0 * x);"


def _weights(spec: ClusterSpec) -> Iterator[str]:
    """Statements that fill `weights`."""
    split = spec.split
    if split.parts:
        of_part = ", ".join(map(str, spec.cluster))
        yield f"int clusters[{split.parts}] = int[{split.parts}]({of_part});"
        for index in range(len(spec.nets)):
            yield f"weights[{index}] = clusters[part] == {index} ? 1.0 : 0.0;"
        return
    arriving, leaves = {0: "1.0"}, {}
    for index, plane in enumerate(split.planes):
        side = f"prt_cluster_step(position.{'xyz'[plane.axis]} - ({number(plane.at)}))"
        yield f"float s{index} = {side};"
        for child, share in ((plane.below, f"(1.0 - s{index})"), (plane.above, f"s{index}")):
            whole = share if index == 0 else f"a{index} * {share}"
            if child < 0:
                leaves[-1 - child] = whole
            else:
                arriving[child] = whole
        if index + 1 < len(split.planes):
            yield f"float a{index + 1} = {arriving[index + 1]};"
    for index in range(len(spec.nets)):
        terms = [leaves.get(leaf, "1.0") for leaf, cluster in enumerate(spec.cluster) if cluster == index]
        yield f"weights[{index}] = {' + '.join(terms)};"


def share(spec: ClusterSpec, index: int) -> str:
    """The text of `vec2 prt_cluster_share(vec3 position)`, to paste below `functions`: the weight of one cluster, and
    the sum of those of all clusters up to it."""
    so_far = " + ".join(f"weights[{each}]" for each in range(index + 1))
    lines = [f"float weights[{len(spec.nets)}];", f"{WEIGHTS}(position, weights);"]
    body = "\n".join(f"  {line}" for line in [*lines, f"return vec2(weights[{index}], {so_far});"])
    return f"vec2 prt_cluster_share(vec3 position) {{\n{body}\n}}\n"


@dataclass(frozen=True, eq=False)
class Stack:
    """One `prt_transfer` of the scene's positions for all nets, and what its samplers read."""

    text: str
    weights: Float[Array, "h w 4"]
    grids: tuple[Float[Array, "_ _ _ _"], ...]
    hashes: tuple[HashGrid, ...]


def stacked(spec: ClusterSpec, wanted: Form, target: Limits | None = None, *, blended: bool = True) -> Stack:
    """All nets in one program. Where not `blended`, the one of the greatest weight alone.

    Raises PrtnetError where the nets are not of one size, where the scene is split by its parts, or where `target`, the
    least that the version promises unless given, cannot hold them.
    """
    _check_alike(spec)
    target = target or limits.MINIMUM[wanted.version]
    chosen, nets, count = replace(wanted, storage="texture"), spec.nets, len(spec.nets)
    rounded = [form.rounded(net, chosen) for net in nets]
    weights = np.concatenate([weight_texture.texels(net, chosen.precision) for net in rounded])
    grids = tuple(np.concatenate(each) for each in zip(*(net.grids for net in nets), strict=True))
    pairs = zip(*(net.hashes for net in nets), strict=True)
    hashes = tuple(HashGrid(each[0].cells, np.concatenate([one.table for one in each])) for each in pairs)
    text = glsl.transfer(nets[0], chosen, target, name="prt_net_transfer", stack=count)
    text = f"int {CHOSEN} = 0;  // of {count}, each at positions of its own\n{text}{functions(spec)}"
    text += _blend(nets[0], count) if blended else _dominant(nets[0], count)
    needs = glsl.needs(nets[0], chosen, target, len(text))
    tables = [hash_grid.texels(each.table).shape[0] for each in hashes]
    volumes = [grid.texels(each).shape[0] for each in grids]
    largest = {"texture_side": max(tables, default=0), "volume_side": max(volumes, default=0)}
    limits.check(replace(needs, weight_side=max(weights.shape[:2]), **largest), target)
    return Stack(text, weights, grids, hashes)


def _check_alike(spec: ClusterSpec) -> None:
    if spec.split.parts:
        raise PrtnetError(
            "split.select: found fragment for a scene split by its parts, whose fragments do not know theirs; expected "
            "draw, or split.by=grid or count"
        )
    kinds = {_kind(net) for net in spec.nets}
    if len(kinds) > 1:
        layers = sorted({str(form.sizes_of(net)) for net in spec.nets})
        found = f"layers {' and '.join(layers)}" if len(layers) > 1 else "other encodings, activations or grids"
        raise PrtnetError(f"split.select: found fragment with nets of {found}, expected all alike; use draw")


def _kind(net: NetSpec) -> tuple[object, ...]:
    """What nets must have in common to be one function with other numbers."""
    grids = [(each.shape, each.dtype.name) for each in net.grids]
    hashes = [(each.cells, each.table.shape, each.table.dtype.name) for each in net.hashes]
    words = [getattr(net, name) for name in _COMMON]
    return (str(form.sizes_of(net)), str(grids), str(hashes), *words)


def _outputs(net: NetSpec, letter: str) -> list[str]:
    return [f"{letter}{i}" for i in range(glsl.vectors(net))]


def _head(net: NetSpec, count: int) -> list[str]:
    outputs = ", ".join(f"out vec4 {name}" for name in _outputs(net, "t"))
    lines = [f"void prt_transfer(vec3 position, vec3 normal, {outputs}) {{"]
    return [*lines, f"  float weights[{count}];", f"  {WEIGHTS}(position, weights);"]


def _blend(net: NetSpec, count: int) -> str:
    """Every fragment goes through its own clusters, mostly one: those beside it may be at others at the same time."""
    sums, terms = _outputs(net, "t"), _outputs(net, "n")
    lines = [*_head(net, count), f"  {' = '.join(sums)} = vec4(0.0);", f"  vec4 {', '.join(terms)};"]
    lines += [f"  for (int next = 0; next < {count}; ++next) {{"]
    lines += [f"    while (next < {count} && weights[next] <= 0.0) ++next;", f"    if (next == {count}) break;"]
    lines += [f"    {CHOSEN} = next;"]
    lines += [f"    prt_net_transfer({POSITION}(next, position), normal, {', '.join(terms)});"]
    lines += [f"    {total} += weights[next] * {term};" for total, term in zip(sums, terms, strict=True)]
    return "\n".join([*lines, "  }", "}"]) + "\n"


def _dominant(net: NetSpec, count: int) -> str:
    lines = [*_head(net, count), f"  {CHOSEN} = 0;"]
    lines += [f"  for (int i = 1; i < {count}; ++i) if (weights[i] > weights[{CHOSEN}]) {CHOSEN} = i;"]
    names = ", ".join(_outputs(net, "t"))
    return "\n".join([*lines, f"  prt_net_transfer({POSITION}({CHOSEN}, position), normal, {names});", "}"]) + "\n"
