"""Shapes and operators by name, called with what a text file says: the values are checked against their signatures."""

import inspect
import types
from collections.abc import Callable, Sequence
from typing import Any, Union, get_args, get_origin

from prtnet import PrtnetError
from prtnet.data.implicit import operators, shapes
from prtnet.data.implicit.shapes import Shape

SHAPES: dict[str, Callable[..., Shape]] = {
    made.__name__: made
    for made in (
        shapes.sphere,
        shapes.ellipsoid,
        shapes.box,
        shapes.cylinder,
        shapes.cone,
        shapes.torus,
        shapes.capsule,
        shapes.chain,
        shapes.plane,
    )
}
# of several shapes
JOINS: dict[str, Callable[..., Shape]] = {
    made.__name__: made for made in (operators.union, operators.intersection, operators.difference)
}
# of one
OPERATORS: dict[str, Callable[..., Shape]] = {
    made.__name__: made
    for made in (
        operators.moved,
        operators.turned,
        operators.scaled,
        operators.stretched,
        operators.elongated,
        operators.mirrored,
        operators.repeated,
        operators.around,
        operators.rounded,
        operators.shell,
    )
}


def call(function: Callable[..., Shape], given: Any, before: Sequence[Shape], place: str) -> Shape:
    """The shape that a function makes of shapes and of what a file gives: a value, a list of them, or a mapping.

    Raises PrtnetError with the place for missing, unknown and unfit arguments.
    """
    signature = inspect.signature(function)
    keywords = given if isinstance(given, dict) else {}
    values = [] if isinstance(given, dict) or given is None else given if isinstance(given, list) else [given]
    try:
        bound = signature.bind(*before, *values, **{str(key): value for key, value in keywords.items()})
    except TypeError as error:
        raise PrtnetError(f"{place}: found {given!r}: {error}; expected {_usage(function, len(before))}") from None
    for key, value in bound.arguments.items():
        parameter = signature.parameters[key]
        if parameter.annotation is Shape:
            continue
        if not _fits(value, parameter.annotation):
            raise PrtnetError(f"{place}: {key}: found {value!r}, expected {_usage(function, len(before))}")
        bound.arguments[key] = _as_tuples(value)
    try:
        return function(*bound.args, **bound.kwargs)
    except PrtnetError as error:
        raise PrtnetError(f"{place}: {error}") from None


def _usage(function: Callable[..., Shape], shapes_before: int) -> str:
    """As in the documentation: the name with its arguments."""
    parameters = list(inspect.signature(function).parameters.values())
    if parameters and parameters[0].annotation is Shape:
        parameters = [each for each in parameters if each.annotation is not Shape]
    return f"{function.__name__}({', '.join(map(_word, parameters))})"


def _word(parameter: inspect.Parameter) -> str:
    kinds = {shapes.Triple: "[x, y, z]", Sequence[shapes.Triple]: "[[x, y, z], ...]", Sequence[float]: "[number, ...]"}
    kind = kinds.get(parameter.annotation)
    word = parameter.name if kind is None else f"{parameter.name}: {kind}"
    return word if parameter.default is inspect.Parameter.empty else f"{word} = {parameter.default}"


def _fits(value: Any, kind: Any) -> bool:
    """Whether a value of a file is of an annotated type: a number, a word, a list of numbers."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return any(_fits(value, each) for each in inner)
    if origin is tuple:
        return isinstance(value, list) and len(value) == len(inner) and all(map(_fits, value, inner))
    if origin is Sequence or getattr(origin, "__name__", "") == "Sequence":
        return isinstance(value, list) and all(_fits(each, inner[0]) for each in value)
    if kind is type(None):
        return value is None
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")
    return isinstance(value, kind) and not isinstance(value, bool)


def _as_tuples(value: Any) -> Any:
    return tuple(map(_as_tuples, value)) if isinstance(value, list) else value
