"""Sphere tracing (Hart 1996) as a GLSL function, on top of those of `prtnet.export.implicit`.

    uniform mat3 prt_window;  // columns: half a frame to the right, half a frame upwards, forward, at a distance of 1
    uniform vec3 prt_middle;  // what the middle of the frame shows `prt_ahead` of the eye, before the cube: so numbers
    uniform float prt_ahead;  // stay small however far the eye is
    uniform float prt_pixel;  // what the middle pixel covers at a distance of 1
    uniform ivec2 prt_steps;  // at most, and refinements
    bool prt_meet(vec2 across, out vec3 position, out vec3 normal)

`across` is -1 to 1 from the left to the right and from the lower to the upper edge. A ray is followed inside the unit
cube grown by a margin, and walks distance / lipschitz at a time. It has met the surface when the distance is below NEAR
of what its pixel covers there, so that outlines grow by no more than that; a ray that runs out of steps has, when it is
within a pixel; one that begins inside never has. Steps of Newton along the ray then take the point to the surface, and
the last one goes along the gradient, for rays that only come near. The plain twin is `prtnet.render.sphere_tracing`.
"""

from prtnet import PrtnetError
from prtnet.data.implicit.field import Analytic, Field
from prtnet.data.implicit.neural import Neural
from prtnet.export import implicit, neural_field
from prtnet.export.spelling import number

BOX = 1.01  # half the side of the cube
NEAR = 0.05  # pixels
LEAST = 1e-5  # the least distance that float32 tells from 0
GRAZING = 0.1  # the least slope of the distance along a ray that Newton's method is told
STEPS, REFINEMENTS = 256, 3

_UNIFORMS = """\
uniform mat3 prt_window;
uniform vec3 prt_middle;
uniform float prt_ahead, prt_pixel;
uniform ivec2 prt_steps;
"""
# the second loop has no bound that compilers know: unrolled, it would hold the functions four times
_FUNCTION = """\
bool prt_meet(vec2 across, out vec3 position, out vec3 normal) {{
  vec3 through = prt_window * vec3(across, 1.0), ray = normalize(through);
  vec3 begin = prt_middle + prt_ahead * (prt_window * vec3(across, 0.0));
  vec3 apart = mix(ray, vec3(1e-20), lessThan(abs(ray), vec3(1e-20)));
  vec3 low = (-{box} - begin) / apart, high = ({box} - begin) / apart;
  vec3 first = min(low, high), last = max(low, high);
  float enter = max(max(first.x, first.y), max(first.z, 0.0));
  float leave = min(last.x, min(last.y, last.z)) - enter;
  float before = prt_ahead * length(through) + enter;
  position = begin + enter * ray;
  normal = vec3(0.0, 1.0, 0.0);
  float t = 0.0, near = 0.0, found = 1.0;
  for (int i = 0; i < prt_steps.x && t <= leave && found > near; ++i) {{
    t += i == 0 ? 0.0 : found / {lipschitz};
    found = prt_distance(position + t * ray);
    near = max({near} * prt_pixel * (before + t), {least});
  }}
  bool inside = t == 0.0 && found < -{least};
  if (inside || t > leave || !(found <= max(prt_pixel * (before + t), {least}))) return false;
  position += t * ray;
  vec3 slope = normal;
  for (int i = 0; i <= prt_steps.y; ++i) {{
    slope = prt_gradient(position);
    vec3 along = ray / min(dot(slope, ray), -{grazing}), steepest = slope / max(dot(slope, slope), 1e-12);
    position -= prt_distance(position) * (i < prt_steps.y ? along : steepest);
  }}
  float steepness = length(slope);
  if (steepness > 1e-12) normal = slope / steepness;
  return true;
}}
"""


def emit(field: Field) -> str:
    """The text of the field's functions, the uniforms and `prt_meet`, for shaders of any version.

    Raises PrtnetError for a field that has no GLSL form.
    """
    if isinstance(field, Analytic):
        functions = implicit.emit(field)
    elif isinstance(field, Neural):
        functions = neural_field.emit(field)
    else:
        raise PrtnetError(f"implicit surface: found a {type(field).__name__} field, expected one with a GLSL form")
    numbers = {"box": BOX, "near": NEAR, "least": LEAST, "grazing": GRAZING, "lipschitz": field.lipschitz}
    meet = _FUNCTION.format(**{name: number(value) for name, value in numbers.items()})
    return functions + _UNIFORMS + meet
