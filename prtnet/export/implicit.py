"""An implicit surface as GLSL functions of a point in unit coordinates.

    float prt_distance(vec3 p)  // below 0 inside; a ray may walk |distance| / lipschitz
    vec3 prt_gradient(vec3 p)   // of the distance, not normalised
    int prt_part(vec3 p)        // index of the material

The text is that of the field's programs, statement by statement: the same operations in the same order as in NumPy,
in float32. It is valid as GLSL 330, 430 and 300 es (where the default precision of float has to be high).
"""

from prtnet.data.implicit.expression import CALLS, INFIX, Program
from prtnet.data.implicit.field import Analytic
from prtnet.export.spelling import number

_GLSL = {
    **INFIX,
    **CALLS,
    "min": "min({}, {})",
    "max": "max({}, {})",
    "select": "{0} < {1} ? {2} : {3}",
}


def emit(field: Analytic) -> str:
    """The three functions, to paste into a shader of any version."""
    return "\n".join([*_distance(field.program), *_gradient(field.slopes), *_part(field.parts), ""])


def _distance(program: Program) -> list[str]:
    lines, (value,) = _statements(program)
    return ["float prt_distance(vec3 p) {", *lines, f"  return {value};", "}"]


def _gradient(program: Program) -> list[str]:
    lines, (_, x, y, z) = _statements(program)
    return ["vec3 prt_gradient(vec3 p) {", *lines, f"  return vec3({x}, {y}, {z});", "}"]


def _part(program: Program) -> list[str]:
    """The first of the least, as NumPy's argmin."""
    lines, values = _statements(program)
    lines += [f"  float least = {values[0]};", "  int part = 0;"]
    for index, value in enumerate(values[1:], start=1):
        lines.append(f"  if ({value} < least) {{ least = {value}; part = {index}; }}")
    return ["int prt_part(vec3 p) {", *lines, "  return part;", "}"]


def _statements(program: Program) -> tuple[list[str], list[str]]:
    lines, results = program.spelled("  float {name} = {value};", _GLSL, number)
    return ["  float x = p.x, y = p.y, z = p.z;", *lines], results
