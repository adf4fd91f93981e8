"""Layers with their weights as literals: h = b + mat4(...) * x0 + mat4(...) * x1 + ... over vec4s, without arrays and
loops, which compilers take best and run fastest up to some 20 thousand multiply-adds.
"""

from collections.abc import Iterator

from prtnet.export import form
from prtnet.export.spelling import vector
from prtnet.netspec import NetSpec


def layers(net: NetSpec, names: list[str], count: int, digits: int) -> Iterator[str]:
    """GLSL after which `names`, the inputs as vec4s, are the vec4s that leave layer `count`."""
    for i, group in enumerate(names):
        yield f"vec4 x0_{i} = {group};"
    names[:] = [f"x0_{i}" for i in range(len(names))]
    for layer in range(count):
        matrix, shift = form.padded(net, layer)
        made = []
        for row in range(len(shift) // 4):
            four = slice(4 * row, 4 * row + 4)
            terms = [vector("vec4", shift[four], digits)]
            for column, name in enumerate(names):
                block = matrix[four, 4 * column : 4 * column + 4]
                terms += [f"{vector('mat4', block.T.ravel(), digits)} * {name}"]
            made.append(f"x{layer + 1}_{row}")
            yield f"vec4 {made[-1]} = {bent(net, layer, ' + '.join(terms))};"
        names[:] = made


def bent(net: NetSpec, layer: int, expression: str) -> str:
    """The activation of a layer about an expression of a vec4."""
    if layer < len(net.weights) - 1:
        return f"prt_bend({expression})"
    return f"tanh({expression})" if net.output == "tanh" else expression
