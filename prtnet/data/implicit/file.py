"""A user's own implicit surface: a short Python file, or YAML. docs/implicit.md has the format of both."""

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from prtnet import PrtnetError
from prtnet.data.implicit import expression
from prtnet.data.implicit.arguments import JOINS, OPERATORS, SHAPES
from prtnet.data.implicit.expression import Node
from prtnet.data.implicit.shapes import Shape
from prtnet.data.implicit.surface import Described, described
from prtnet.data.implicit.text import parse
from prtnet.data.part import GREY

SUFFIXES = (".py", ".yaml", ".yml")
BOX = ((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))

# beside shapes and operators, what a Python file finds defined
_FUNCTIONS = {
    name: getattr(expression, name)
    for name in ("minimum", "maximum", "clamp", "sqrt", "floor", "sin", "cos", "select", "dot", "length")
}
_KEYS = ("name", "parts", "bounds", "smooth", "joined", "lipschitz", "camera")


def read(path: str | Path) -> Described:
    """The surface that a file describes, .py or .yaml, in its own units. A Python file is run.

    Raises PrtnetError, with the place in the file, for whatever does not make one.
    """
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise PrtnetError(f"{path}: found the suffix {path.suffix!r}, expected {', '.join(SUFFIXES)}")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise PrtnetError(f"{path}: could not be read as text: {error}") from None
    found = parse(text, str(path)) if path.suffix != ".py" else _run(text, path)
    return _built(found, path)


def _run(text: str, path: Path) -> dict[str, Any]:
    """The names that a Python file defines."""
    names = {**SHAPES, **JOINS, **OPERATORS, **_FUNCTIONS, "__name__": "prtnet_surface", "__file__": str(path)}
    given = dict(names)
    try:
        exec(compile(text, str(path), "exec"), names)
    except SyntaxError as error:
        raise PrtnetError(f"{path}:{error.lineno}: {error.msg}, expected Python") from None
    except (Exception, SystemExit) as error:
        raise _at_line(error, path) from None
    found = {key: value for key, value in names.items() if given.get(key) is not value}
    distance, surface = found.get("distance"), found.get("surface")
    if callable(distance) and "parts" not in found:
        found["parts"] = {"surface": (lambda p: distance(*p), (GREY, GREY, GREY))}
    elif surface is not None and "parts" not in found:
        found["parts"] = {"surface": (surface, (GREY, GREY, GREY))}
    return {key: found[key] for key in _KEYS if key in found}


def _built(found: dict[str, Any], path: Path) -> Described:
    """From what a file says, which is checked here, the same for both kinds."""
    parts, (low, high) = _parts(found, path), _bounds(found.get("bounds", BOX), path)
    smooth = _number(found, "smooth", 0.0, path, least=0.0)
    lipschitz = _number(found, "lipschitz", 1.0, path, least=1e-3)
    camera = found.get("camera", "orbit")
    if camera not in ("orbit", "inside", "auto"):
        raise PrtnetError(f"{path}: camera: found {camera!r}, expected orbit, inside or auto")
    if "joined" in found and not callable(found["joined"]):
        raise PrtnetError(f"{path}: joined: found {found['joined']!r}, expected a shape")
    name, joined = str(found.get("name", path.stem)), found.get("joined")
    made = described(name, parts, low, high, smooth=smooth, joined=joined, lipschitz=lipschitz, camera=camera)
    # shapes are functions: what is wrong inside shows when they are called
    try:
        for program in (made.field.parts, made.field.program, made.field.slopes):
            assert len(program)
    except Exception as error:
        raise _at_line(error, path) from None
    return made


def _parts(found: dict[str, Any], path: Path) -> dict[str, tuple[Shape, tuple[float, float, float]]]:
    given: Any = found.get("parts")
    if not isinstance(given, dict) or not given:
        expected = "parts = {name: (shape, (red, green, blue)), ...}, surface = shape, or a function distance(x, y, z)"
        raise PrtnetError(f"{path}: found no parts, expected {expected}")
    made = {}
    for name, part in given.items():
        shape, albedo = part if isinstance(part, tuple) and len(part) == 2 else (part, (GREY, GREY, GREY))
        if not callable(shape):
            expected = "a shape, or (shape, (red, green, blue))"
            raise PrtnetError(f"{path}: parts: {name}: found {part!r}, expected {expected}")
        made[str(name)] = (_checked(shape, str(name), path), _colour(albedo, f"{path}: parts: {name}: albedo"))
    return made


def _checked(shape: Callable[..., Any], name: str, path: Path) -> Shape:
    """The same, which refuses what is no number: a user's function may return anything."""

    def at(p: expression.Point) -> Node:
        value = shape(p)
        if isinstance(value, int | float):
            return expression.constant(value)
        if not isinstance(value, Node):
            raise PrtnetError(f"{path}: parts: {name}: the distance is {value!r}, expected arithmetic on x, y and z")
        return value

    return at


def _colour(value: Any, place: str) -> tuple[float, float, float]:
    triple = _triple(value)
    if triple is None or not 0 <= min(triple) <= max(triple) <= 1:
        raise PrtnetError(f"{place}: found {value!r}, expected three numbers from 0 to 1, linear red, green, blue")
    return triple


def _bounds(value: Any, path: Path) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    corners = [_triple(corner) for corner in value] if isinstance(value, list | tuple) else []
    if len(corners) == 2 and corners[0] and corners[1]:
        low, high = corners[0], corners[1]
        if all(a < b for a, b in zip(low, high, strict=True)):
            return low, high
    raise PrtnetError(f"{path}: bounds: found {value!r}, expected [[x, y, z], [x, y, z]], the lower corner first")


def _triple(value: Any) -> tuple[float, float, float] | None:
    try:
        x, y, z = (float(each) for each in value)
    except (TypeError, ValueError):
        return None
    return (x, y, z) if max(abs(x), abs(y), abs(z)) < float("inf") else None


def _number(found: dict[str, Any], key: str, default: float, path: Path, *, least: float) -> float:
    value = found.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value < float("inf"):
        raise PrtnetError(f"{path}: {key}: found {value!r}, expected a number of at least {least:g}")
    return float(value)


def _at_line(error: BaseException, path: Path) -> PrtnetError:
    """What went wrong in the user's file, with the last line of it on the way there."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    place = f"{path}:{lines[-1]}" if lines else str(path)
    if isinstance(error, PrtnetError):
        return PrtnetError(str(error) if str(error).startswith(str(path)) else f"{place}: {error}")
    hint = ""
    if isinstance(error, TypeError) and "Node" in str(error):
        hint = "; of a point's x, y, z only sqrt, minimum, select ... of this file's own names can be taken, not math's"
    return PrtnetError(f"{place}: {type(error).__name__}: {error}{hint}")
