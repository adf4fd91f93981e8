"""Light of lamps with shadow maps as GLSL text, for desktop 330 and WebGL's 300 es, and the numbers it takes.

    vec3 prt_direct(vec3 position, vec3 normal, vec3 geometric)   // irradiance, linear RGB, unit coordinates

`normal` is the unit shading normal, which the cosine takes; `geometric` that of the triangle: from behind it nothing
arrives. What lies in the way is found in one array of depth textures, layer 6 l + face for lamp l (Williams 1978,
*Casting Curved Shadows on Curved Surfaces*). Points, and spots wider than `WIDE`, have six faces, others one.

The taps of a 2 x 2 filter lie up to a texel away in u and v. On a plane whose normal is n, in the axes of the map,
with texels t wide there, its depth changes by up to t (|n_u| + |n_v|) / |n_w| that way, and a step h off the plane
along n changes it by h / |n_w|. So what looks up a map is moved by `LIFT_SLOPE` t (|n_u| + |n_v|) and a little, which
stays bounded at every angle. The rest of what is needed is pushed on the casters (polygon offset, `SLOPE_BIAS`
max(|n_u|, |n_v|) t / |n_w|): in corners the taps meet other planes. No plane shadows itself where the slope bias and
twice `LIFT_SLOPE` are 2 together.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from prtnet import PrtnetError
from prtnet.data.lighting.lamp import Lamp, Lighting
from prtnet.export.spelling import number

Array = np.ndarray

LAMPS = 4
FACES = 6
KINDS = {"directional": 0, "point": 1, "spot": 2}
# spots whose half angle has a smaller cosine are drawn like points
WIDE = 0.5
# factor and units of glPolygonOffset while casters are drawn
SLOPE_BIAS, DEPTH_BIAS = 1.5, 1.0
# steps off the surface in texels: always, and times |n_u| + |n_v|
LIFT, LIFT_SLOPE = 0.1, 0.25
# maps are this much wider than what is looked up in them, so that filters and steps stay inside; with at least
# `LEAST_SIZE` texels along a side the border of a directional lamp's map is free of casters
MARGIN, LEAST_SIZE = 1.02, 64
# shortest distance to the plane that cuts off what is too near a lamp, in unit coordinates
NEAR = 0.005

# of faces 0 to 5; `_view` gives each its other axes
_AXES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)

_FUNCTIONS = """
uniform int lamp_count;
uniform highp vec4 lamp_position[LAMPS];  // w: 0 directional, 1 point, 2 spot
uniform highp vec4 lamp_aim[LAMPS];       // w: cosine of the half angle from which on a spot gives nothing
uniform highp vec4 lamp_colour[LAMPS];    // w: cosine of the half angle up to which it gives all
uniform highp mat4 shadow_matrix[LAMPS * 6];
uniform highp sampler2DArrayShadow shadow_map;

int prt_face(vec3 away) {
  vec3 span = abs(away);
  if (span.x >= max(span.y, span.z)) return away.x > 0.0 ? 0 : 1;
  if (span.y >= span.z) return away.y > 0.0 ? 2 : 3;
  return away.z > 0.0 ? 4 : 5;
}

// share of the light that reaches a point
float prt_lit(int face, vec3 position, vec3 geometric) {
  mat4 map = shadow_matrix[face];
  float away = dot(vec4(map[0].w, map[1].w, map[2].w, map[3].w), vec4(position, 1.0));
  vec3 right = vec3(map[0].x, map[1].x, map[2].x), up = vec3(map[0].y, map[1].y, map[2].y);
  float scale = 1.0 / length(right);
  float slant = scale * (abs(dot(right, geometric)) + abs(dot(up, geometric)));
  float texel = 2.0 * away * scale / float(textureSize(shadow_map, 0).x);
  vec4 clip = map * vec4(position + texel * (LIFT + LIFT_SLOPE * slant) * geometric, 1.0);
  vec3 place = 0.5 * clip.xyz / clip.w + 0.5;
  // behind the map of a directional lamp is what its last depth sees; beside it nothing, and its border sees nothing
  return texture(shadow_map, vec4(place.xy, float(face), min(place.z, 1.0)));
}

vec3 prt_of_lamp(int lamp, vec3 position, vec3 normal, vec3 geometric) {
  vec4 source = lamp_position[lamp], aim = lamp_aim[lamp], colour = lamp_colour[lamp];
  vec3 towards = -aim.xyz;
  float strength = 1.0;
  int face = 6 * lamp;
  if (source.w > 0.5) {
    towards = source.xyz - position;
    strength = 1.0 / max(dot(towards, towards), 1e-18);
    bool whole = source.w < 1.5;
    if (whole || aim.w < WIDE) face += prt_face(-towards);
    towards *= sqrt(strength);
    if (!whole) strength *= smoothstep(aim.w, colour.w, -dot(towards, aim.xyz));
  }
  float facing = dot(geometric, towards);
  strength *= max(dot(normal, towards), 0.0);
  // written so that what is no number is dark as well
  if (!(facing > 0.0 && strength > 0.0)) return vec3(0.0);
  return colour.rgb * strength * prt_lit(face, position, geometric);
}

vec3 prt_direct(vec3 position, vec3 normal, vec3 geometric) {
  vec3 sum = vec3(0.0);
  int lamp = 0;
  // a test at the end: processors that run several pixels at once run the whole body before they heed one on top
  if (lamp_count > 0) {
    do {
      sum += prt_of_lamp(lamp, position, normal, geometric);
      ++lamp;
    } while (lamp < lamp_count);
  }
  return sum;
}
"""

# of a fake G-buffer of s rows, one column for each of m points; w of each texture: albedo / pi in red, green and blue
_MEASURED = """
uniform highp sampler2D measured_positions, measured_normals, measured_geometric;
out highp vec4 colour;

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec4 position = texelFetch(measured_positions, pixel, 0), normal = texelFetch(measured_normals, pixel, 0);
  vec4 geometric = texelFetch(measured_geometric, pixel, 0);
  vec3 received = prt_direct(position.xyz, normal.xyz, geometric.xyz);
  colour = vec4(vec3(position.w, normal.w, geometric.w) * received, 1.0);
}
"""

# the direct vector, m pixels in one row
AVERAGED = """
uniform highp sampler2D measured;  // what `measured` draws
uniform highp sampler2D distant;   // m x 1: what light from far away adds
out highp vec4 direct;

void main() {
  int column = int(gl_FragCoord.x), count = textureSize(measured, 0).y;
  vec3 sum = vec3(0.0);
  for (int row = 0; row < count; ++row) sum += texelFetch(measured, ivec2(column, row), 0).rgb;
  direct = vec4(sum / float(count) + texelFetch(distant, ivec2(column, 0), 0).rgb, 1.0);
}
"""


def functions(lamps: int = LAMPS) -> str:
    """The uniforms and `prt_direct` for at most so many lamps, without a version or precision line."""
    words = {"LAMPS": str(lamps), "LIFT_SLOPE": number(LIFT_SLOPE), "LIFT": number(LIFT), "WIDE": number(WIDE)}
    text = _FUNCTIONS
    for word, value in words.items():
        text = text.replace(word, value)
    return text


def measured(lamps: int = LAMPS) -> str:
    """Fragment shader of the measurement points' surface points: albedo / pi times direct irradiance at each."""
    return functions(lamps) + _MEASURED


def uniforms(lighting: Lighting, matrices: Sequence[Float[Array, "_ 4 4"]], lamps: int = LAMPS) -> dict[str, Any]:
    """What `functions` takes but for the maps, as `gl.put` does. `matrices`: `shadow_matrices` of each lamp.

    Raises PrtnetError for more lamps than the shader has room for.
    """
    check(lighting, lamps)
    values = {name: np.zeros((lamps, 4), np.float32) for name in ("lamp_position", "lamp_aim", "lamp_colour")}
    placed = np.zeros((lamps * FACES, 4, 4), np.float32)
    for index, (lamp, found) in enumerate(zip(lighting.lamps, matrices, strict=True)):
        outer, inner = np.cos(np.radians([lamp.outer, lamp.inner]))
        values["lamp_position"][index] = *lamp.position, KINDS[lamp.kind]
        values["lamp_aim"][index] = *lamp.aim, outer
        values["lamp_colour"][index] = *lamp.colour, inner
        # column by column
        placed[FACES * index : FACES * index + len(found)] = np.swapaxes(found, 1, 2)
    return values | {"shadow_matrix": placed, "lamp_count": len(lighting.lamps)}


def check(lighting: Lighting, lamps: int = LAMPS) -> None:
    """Raises PrtnetError for more lamps than a shader has room for."""
    if len(lighting.lamps) > lamps:
        raise PrtnetError(f"lighting: found {len(lighting.lamps)} lamps, expected at most {lamps} to be drawn at once")


def shadow_matrices(lamp: Lamp, box: Float[Array, "2 3"]) -> Float64[Array, "faces 4 4"]:
    """Unit coordinates to the clip coordinates of each of a lamp's maps, z in [-1, 1].

    `box`: least and greatest corner of what casts shadows, in unit coordinates.
    """
    if lamp.kind == "directional":
        return _parallel(np.asarray(lamp.aim, np.float64), np.asarray(box, np.float64))[None]
    position = np.asarray(lamp.position, np.float64)
    low, high = np.asarray(box, np.float64)
    nearest = float(np.linalg.norm(np.maximum(np.maximum(low - position, position - high), 0)))
    farthest = float(np.linalg.norm(np.maximum(position - low, high - position)))
    # what is looked up has directions less than 60 degrees off the axis of its face
    near, far = max(NEAR, 0.45 * nearest), max(MARGIN * farthest, 2 * NEAR)
    cosine = math.cos(math.radians(lamp.outer))
    if lamp.kind == "spot" and cosine >= WIDE:
        wide = MARGIN * math.tan(math.radians(lamp.outer))
        return (_lens(wide, near, far) @ _view(position, np.asarray(lamp.aim, np.float64)))[None]
    return np.stack([_lens(MARGIN, near, far) @ _view(position, axis) for axis in _AXES])


def _view(position: Float64[Array, " 3"], forward: Float64[Array, " 3"]) -> Float64[Array, "4 4"]:
    """To coordinates about a point: x right, y up, looking down -z."""
    up = np.array([0.0, 0.0, 1.0]) if abs(forward[1]) > 0.9 else np.array([0.0, 1.0, 0.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(right, forward), -forward
    matrix[:3, 3] = -matrix[:3, :3] @ position
    return matrix


def _lens(wide: float, near: float, far: float) -> Float64[Array, "4 4"]:
    """`wide`: tangent of half the angle of view."""
    matrix = np.diag([1 / wide, 1 / wide, (near + far) / (near - far), 0.0])
    matrix[2, 3], matrix[3, 2] = 2 * near * far / (near - far), -1.0
    return matrix


def _parallel(aim: Float64[Array, " 3"], box: Float64[Array, "2 3"]) -> Float64[Array, "4 4"]:
    """All of the box, as wide as it is high."""
    view = _view(np.zeros(3), aim)
    centre, half = view[:3, :3] @ box.mean(axis=0), np.abs(view[:3, :3]) @ (box[1] - box[0]) / 2
    span = MARGIN * np.maximum([max(half[:2]), max(half[:2]), half[2]], NEAR)
    matrix = np.diag([1 / span[0], 1 / span[1], -1 / span[2], 1.0])
    matrix[:3, 3] = [-centre[0] / span[0], -centre[1] / span[1], centre[2] / span[2]]
    return matrix @ view
