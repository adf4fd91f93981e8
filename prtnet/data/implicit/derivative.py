"""Derivatives of expressions, as expressions.

Reverse accumulation (Griewank and Walther 2008, *Evaluating Derivatives*, chapter 3): one pass from the result back to
the point gives all three for a small multiple of the result's own cost.
"""

from prtnet.data.implicit.expression import Node, Program, constant, cos, maximum, select, sin

# keeps the slope of a square root finite where the root is 0
LEAST_ROOT = 1e-10
AXES = ("x", "y", "z")


def with_gradient(result: Node) -> Program:
    """The program of a node's value and its derivatives along x, y and z."""
    order = _ordered(result)
    slopes: dict[int, Node] = {id(result): constant(1)}
    for node in reversed(order):
        slope = slopes.get(id(node))
        if slope is None:
            continue
        for argument, part in zip(node.arguments, _chain(node, slope), strict=True):
            if part is not None and not (part.operation == "constant" and part.value == 0):
                before = slopes.get(id(argument))
                slopes[id(argument)] = part if before is None else before + part
    zero = constant(0)
    found: dict[str, Node] = {}
    for node in order:
        # an axis may stand in several nodes
        if node.operation in AXES and id(node) in slopes:
            found[node.operation] = slopes[id(node)] + found.get(node.operation, zero)
    return Program([result, *(found.get(axis, zero) for axis in AXES)])


def _ordered(root: Node) -> list[Node]:
    seen: set[int] = set()
    order, stack = [], [(root, False)]
    while stack:
        node, done = stack.pop()
        if done:
            order.append(node)
        elif id(node) not in seen:
            seen.add(id(node))
            stack += [(node, True), *((each, False) for each in node.arguments)]
    return order


def _chain(node: Node, slope: Node) -> tuple[Node | None, ...]:
    """What reaches each argument of a node whose result has that slope."""
    operation, at = node.operation, node.arguments
    if operation in ("add", "sub"):
        return slope, slope if operation == "add" else -slope
    if operation == "mul":
        return slope * at[1], slope * at[0]
    if operation == "div":
        share = slope / at[1]
        return share, -share * node
    if operation in ("min", "max"):
        first, second = (at[0], at[1]) if operation == "min" else (at[1], at[0])
        return select(first, second, slope, 0), select(first, second, 0, slope)
    if operation == "neg":
        return (-slope,)
    if operation == "abs":
        return (select(at[0], 0, -slope, slope),)
    if operation == "sqrt":
        return (0.5 * slope / maximum(node, LEAST_ROOT),)
    if operation == "sin":
        return (slope * cos(at[0]),)
    if operation == "cos":
        return (-(slope * sin(at[0])),)
    if operation == "select":
        return None, None, select(at[0], at[1], slope, 0), select(at[0], at[1], 0, slope)
    return (None,) * len(at)
