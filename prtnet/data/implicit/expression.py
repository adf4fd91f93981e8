"""Arithmetic on a point as straight-line code: written once, evaluated anywhere.

A `Node` is a number that depends on x, y and z. Python's operators join nodes; equal nodes are one node, and what is
known at once is folded. A `Program` puts the nodes of some results in an order in which each needs only those before
it. It runs on arrays (`evaluate`), becomes text for other languages (`spelled`), and `with_gradient` gives the program
of its derivatives by reverse accumulation (Griewank and Walther 2008, *Evaluating Derivatives*, chapter 3).
"""

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

# of each operation its number of arguments; select(a, b, u, v) is u where a < b, else v
ARGUMENTS = {
    "add": 2,
    "sub": 2,
    "mul": 2,
    "div": 2,
    "min": 2,
    "max": 2,
    "neg": 1,
    "abs": 1,
    "sqrt": 1,
    "floor": 1,
    "sin": 1,
    "cos": 1,
    "select": 4,
}
# as C and Python spell them
INFIX = {"add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "div": "{} / {}", "neg": "-{}"}
CALLS = {name: f"{name}({{}})" for name in ("abs", "sqrt", "floor", "sin", "cos")}
LEAVES = ("x", "y", "z", "constant")

NUMPY: Mapping[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "min": np.minimum,
    "max": np.maximum,
    "neg": np.negative,
    "abs": np.abs,
    "sqrt": np.sqrt,
    "floor": np.floor,
    "sin": np.sin,
    "cos": np.cos,
    "select": lambda a, b, u, v: np.where(a < b, u, v),
}


@dataclass(frozen=True, eq=False)
class Node:
    """A number that depends on the point. Made by the functions below and by operators, never directly."""

    operation: str
    arguments: tuple["Node", ...] = ()
    value: float = 0.0

    def __add__(self, other: "Number") -> "Node":
        return apply("add", self, other)

    def __radd__(self, other: float) -> "Node":
        return apply("add", other, self)

    def __sub__(self, other: "Number") -> "Node":
        return apply("sub", self, other)

    def __rsub__(self, other: float) -> "Node":
        return apply("sub", other, self)

    def __mul__(self, other: "Number") -> "Node":
        return apply("mul", self, other)

    def __rmul__(self, other: float) -> "Node":
        return apply("mul", other, self)

    def __truediv__(self, other: "Number") -> "Node":
        return apply("div", self, other)

    def __rtruediv__(self, other: float) -> "Node":
        return apply("div", other, self)

    def __pow__(self, exponent: int) -> "Node":
        """By a whole number above 0."""
        if not isinstance(exponent, int) or exponent < 1:
            return NotImplemented
        half = self ** (exponent // 2) if exponent > 1 else self
        return half if exponent == 1 else half * half * self if exponent % 2 else half * half

    def __neg__(self) -> "Node":
        return apply("neg", self)

    def __abs__(self) -> "Node":
        return apply("abs", self)


Number = Node | float
Point = tuple[Node, Node, Node]

X, Y, Z = (Node(axis) for axis in "xyz")
POINT: Point = (X, Y, Z)


def constant(value: float) -> Node:
    """A number that is the same everywhere."""
    return Node("constant", value=float(value))


def apply(operation: str, *arguments: Number) -> Node:
    """The node of an operation; a simpler one where the arguments tell its value."""
    nodes = tuple(each if isinstance(each, Node) else constant(each) for each in arguments)
    assert len(nodes) == ARGUMENTS[operation], operation
    return _folded(operation, nodes) or Node(operation, nodes)


def _folded(operation: str, nodes: tuple[Node, ...]) -> Node | None:
    known = [node.value if node.operation == "constant" else None for node in nodes]
    if None not in known:
        with np.errstate(all="ignore"):
            return constant(float(NUMPY[operation](*(np.float64(value) for value in known if value is not None))))
    first, second = nodes[0], nodes[-1]
    if operation == "add":
        return second if known[0] == 0 else first if known[1] == 0 else None
    if operation == "sub":
        return first if known[1] == 0 else apply("neg", second) if known[0] == 0 else None
    if operation == "mul":
        if 0 in known:
            return constant(0)
        if -1 in known:
            return apply("neg", nodes[1 - known.index(-1)])
        return second if known[0] == 1 else first if known[1] == 1 else None
    if operation == "div" and known[1]:
        return apply("mul", first, 1 / known[1])
    if operation == "neg" and first.operation == "neg":
        return first.arguments[0]
    if operation in ("min", "max", "select") and nodes[-1] is nodes[-2]:
        return second
    return None


def minimum(first: Number, *others: Number) -> Node:
    """The least of some numbers."""
    return _reduced("min", first, *others)


def maximum(first: Number, *others: Number) -> Node:
    """The greatest of some numbers."""
    return _reduced("max", first, *others)


def _reduced(operation: str, *numbers: Number) -> Node:
    """As a balanced tree: short chains of dependence run in parallel on a processor."""
    if len(numbers) == 1:
        return numbers[0] if isinstance(numbers[0], Node) else constant(numbers[0])
    half = len(numbers) // 2
    return apply(operation, _reduced(operation, *numbers[:half]), _reduced(operation, *numbers[half:]))


def clamp(value: Number, low: float, high: float) -> Node:
    """The value, or the nearer bound outside of them."""
    return minimum(maximum(value, low), high)


def sqrt(value: Number) -> Node:
    return apply("sqrt", value)


def floor(value: Number) -> Node:
    return apply("floor", value)


def sin(value: Number) -> Node:
    """Of radians."""
    return apply("sin", value)


def cos(value: Number) -> Node:
    """Of radians."""
    return apply("cos", value)


def select(first: Number, second: Number, smaller: Number, otherwise: Number) -> Node:
    """`smaller` where first < second, else `otherwise`."""
    return apply("select", first, second, smaller, otherwise)


def dot(a: Sequence[Number], b: Sequence[Number]) -> Node:
    """Sum of products."""
    total: Node = constant(0)
    for first, second in zip(a, b, strict=True):
        total = total + apply("mul", first, second)
    return total


def length(*coordinates: Number) -> Node:
    """Euclidean length of a vector."""
    return abs(apply("add", coordinates[0], 0.0)) if len(coordinates) == 1 else sqrt(dot(coordinates, coordinates))


class Program:
    """The code of some results. `steps`: (operation, numbers of earlier steps, value); `results`: numbers of steps."""

    def __init__(self, results: Iterable[Node]):
        self.steps: list[tuple[str, tuple[int, ...], float]] = []
        self._number: dict[tuple[str, tuple[int, ...], float], int] = {}
        seen: dict[int, int] = {}
        self._roots = tuple(results)  # kept: numbers by identity hold only as long as the nodes live
        self.results = tuple(self._place(node, seen) for node in self._roots)

    def _place(self, root: Node, seen: dict[int, int]) -> int:
        """The number of a node's step, after those it needs. Without recursion: scenes are deep."""
        stack = [root]
        while stack:
            node = stack[-1]
            missing = [each for each in node.arguments if id(each) not in seen]
            if missing:
                stack += missing
                continue
            stack.pop()
            if id(node) not in seen:
                step = (node.operation, tuple(seen[id(each)] for each in node.arguments), node.value)
                if step not in self._number:
                    self._number[step] = len(self.steps)
                    self.steps.append(step)
                seen[id(node)] = self._number[step]
        return seen[id(root)]

    @cached_property
    def _spent(self) -> list[list[int]]:
        """Per step the values that no later one needs: let go, the few that are alive stay in the cache."""
        last = {each: index for index, (_, arguments, _) in enumerate(self.steps) for each in arguments}
        spent: list[list[int]] = [[] for _ in self.steps]
        for each, index in last.items():
            if each not in self.results:
                spent[index].append(each)
        return spent

    def evaluate(self, x: Any, y: Any, z: Any, functions: Mapping[str, Callable[..., Any]] = NUMPY) -> tuple[Any, ...]:
        """The results at arrays of coordinates, by functions that have the names of `ARGUMENTS` (and `constant`, if a
        number is not to be one of Python's)."""
        given, values = {"x": x, "y": y, "z": z}, []
        number = functions.get("constant", float)
        for (operation, arguments, value), spent in zip(self.steps, self._spent, strict=True):
            if operation in given:
                values.append(given[operation])
            elif operation == "constant":
                values.append(number(value))
            else:
                values.append(functions[operation](*(values[each] for each in arguments)))
            for each in spent:
                values[each] = None
        return tuple(values[each] for each in self.results)

    def spelled(
        self, statement: str, forms: Mapping[str, str], number: Callable[[float], str]
    ) -> tuple[list[str], list[str]]:
        """Lines of text, and the words of the results. `statement` and `forms` are format strings: of {name} and
        {value}, and per operation of its arguments; constants stand where they are used."""
        words, lines = [], []
        for index, (operation, arguments, value) in enumerate(self.steps):
            if operation == "constant":
                words.append(number(value))
            elif operation in LEAVES:
                words.append(operation)
            else:
                name = f"v{index}"
                text = forms[operation].format(*(words[each] for each in arguments))
                lines.append(statement.format(name=name, value=text))
                words.append(name)
        return lines, [words[each] for each in self.results]

    def digest(self) -> str:
        """sha256 of the code."""
        return hashlib.sha256(repr((self.steps, self.results)).encode()).hexdigest()

    def __len__(self) -> int:
        return len(self.steps)
