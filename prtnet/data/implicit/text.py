"""Implicit surfaces in YAML: names of shapes and operators with their arguments, nested.

A shape is a mapping. Its first key names the shape, or a boolean operator over a list of shapes; the keys after it name
operators of that one shape, in the order in which they are applied.
"""

from typing import Any

import yaml

from prtnet import PrtnetError
from prtnet.data.implicit.arguments import JOINS, OPERATORS, SHAPES, call
from prtnet.data.implicit.shapes import Shape
from prtnet.data.part import GREY

KEYS = ("name", "bounds", "smooth", "joined", "lipschitz", "camera", "parts")


class _Loader(yaml.SafeLoader):
    """One that refuses a key that stands twice, of which YAML would keep the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if key.value in seen:
                raise PrtnetError(
                    f"line {key.start_mark.line + 1}: found {key.value} twice, expected it once; to apply an operator "
                    "again, put the shape into a union of its own"
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def parse(text: str, source: str) -> dict[str, Any]:
    """What a YAML file says, with shapes in place of their descriptions; `source` names it in messages.

    Raises PrtnetError with the place of what is wrong.
    """
    try:
        found = yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise PrtnetError(f"{source}:{line}: {error.problem}, expected YAML") from None
    except yaml.YAMLError as error:
        raise PrtnetError(f"{source}: {error}, expected YAML") from None
    except PrtnetError as error:
        raise PrtnetError(f"{source}: {error}") from None
    if not isinstance(found, dict):
        raise PrtnetError(f"{source}: found {type(found).__name__}, expected the keys {', '.join(KEYS)}")
    for key in found:
        if key not in KEYS:
            raise PrtnetError(f"{source}: found the key {key!r}, expected {', '.join(KEYS)}")
    parts = found.get("parts")
    if not isinstance(parts, dict):
        raise PrtnetError(f"{source}: parts: found {parts!r}, expected {{name: {{albedo: [...], sphere: ...}}, ...}}")
    try:
        found["parts"] = {str(name): _part(part, f"{source}: parts.{name}") for name, part in parts.items()}
        if "joined" in found:
            found["joined"] = shape(found["joined"], f"{source}: joined")
    except RecursionError:
        raise PrtnetError(f"{source}: found a shape that contains itself, expected an end of its aliases") from None
    return found


def _part(found: Any, place: str) -> tuple[Shape, Any]:
    if not isinstance(found, dict):
        raise PrtnetError(f"{place}: found {found!r}, expected {{albedo: [red, green, blue], sphere: ...}}")
    rest = {key: value for key, value in found.items() if key != "albedo"}
    return shape(rest, place), found.get("albedo", [GREY, GREY, GREY])


def shape(found: Any, place: str) -> Shape:
    """The shape that a mapping describes."""
    if not isinstance(found, dict) or not found:
        raise PrtnetError(f"{place}: found {found!r}, expected a shape, like {{sphere: 0.5, moved: [0, 1, 0]}}")
    (first, given), *operators = found.items()
    if first in JOINS:
        made = _joined(first, given, f"{place}.{first}")
    elif first in SHAPES:
        made = call(SHAPES[first], given, (), f"{place}.{first}")
    else:
        known = ", ".join([*SHAPES, *JOINS])
        after = f"; {first} comes after the shape it is applied to" if first in OPERATORS else ""
        raise PrtnetError(f"{place}: found {first!r}, expected one of {known}{after}")
    for name, value in operators:
        if name not in OPERATORS:
            known = ", ".join(OPERATORS)
            more = "; several shapes stand in a union" if name in SHAPES or name in JOINS else ""
            raise PrtnetError(f"{place}: found {name!r} after {first}, expected one of {known}{more}")
        made = call(OPERATORS[name], value, (made,), f"{place}.{name}")
    return made


def _joined(name: str, given: Any, place: str) -> Shape:
    """A boolean operator of a list of shapes, or of {of: list, smooth: distance}."""
    of, keywords = given, {}
    if isinstance(given, dict):
        of, keywords = given.get("of"), {key: value for key, value in given.items() if key != "of"}
    if not isinstance(of, list) or not of:
        raise PrtnetError(f"{place}: found {given!r}, expected a list of shapes, or {{of: [...], smooth: distance}}")
    return call(JOINS[name], keywords, [shape(each, f"{place}[{index}]") for index, each in enumerate(of)], place)
