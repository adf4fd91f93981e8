// GLSL ES 3.00 of data-driven transfer. `functions` are texts that prtnet wrote: prt_direct of the lamp, with shadow maps,
// and prt_indirect of basis textures. Targets are integers that hold the bits of floats: every WebGL 2 can draw those.

import { CODED, HEAD, PIXEL } from "./shaders.js";

export const CASTERS = `${HEAD}
layout(location = 0) in vec3 in_position;
uniform mat4 shadow;
uniform vec3 box_low, box_span;
void main() {
  gl_Position = shadow * vec4(in_position * box_span + box_low, 1.0);
}
`;

export const NOTHING = `${HEAD}
void main() {}
`;

// The direct vector: a pixel for each measurement point, the mean of albedo / pi times direct irradiance at its surface
// points, which are a column of the textures; albedo / pi is their fourth channel.
export const measured = ({ functions }) => `${HEAD}
uniform sampler2D measured_positions, measured_normals, measured_geometric;
out uvec4 bits;
${functions.lamps}
void main() {
  int column = int(gl_FragCoord.x), count = textureSize(measured_positions, 0).y;
  vec3 sum = vec3(0.0);
  for (int row = 0; row < count; ++row) {
    ivec2 at = ivec2(column, row);
    vec4 position = texelFetch(measured_positions, at, 0), normal = texelFetch(measured_normals, at, 0);
    vec4 geometric = texelFetch(measured_geometric, at, 0);
    sum += vec3(position.w, normal.w, geometric.w) * prt_direct(position.xyz, normal.xyz, geometric.xyz);
  }
  bits = floatBitsToUint(vec4(sum / float(count), 1.0));
}
`;

// The operator: pixel i is u_i = sum_j M_ij x_j^(1/gamma). prt_matrix is `matrix_texels` of prtnet/export/data_driven.py.
export const reduced = ({ banks, points, width, gamma }) => `${HEAD}
uniform highp usampler2D prt_direct_vector;
uniform sampler2D prt_matrix;
out uvec4 bits;
vec3 light(int j) {
  if (j >= ${points}) return vec3(0.0);
  vec3 found = uintBitsToFloat(texelFetch(prt_direct_vector, ivec2(j, 0), 0).rgb);
  return ${gamma === 1 ? "found" : `pow(max(found, 0.0), vec3(${(1 / gamma).toPrecision(9)}))`};
}
void main() {
  int element = int(gl_FragCoord.x);
  vec3 sum = vec3(0.0);
  for (int q = 0; q < ${Math.ceil(points / 4)}; ++q) {
    mat4x3 x = mat4x3(light(4 * q), light(4 * q + 1), light(4 * q + 2), light(4 * q + 3));
${
  banks === 1
    ? "    sum += x * texelFetch(prt_matrix, ivec2(q, element), 0);"
    : `    mat3x4 rows = transpose(x);
    for (int bank = 0; bank < 3; ++bank)
      sum[bank] += dot(rows[bank], texelFetch(prt_matrix, ivec2(q, element + bank * ${width}), 0));`
}
  }
  bits = floatBitsToUint(vec4(sum, 1.0));
}
`;

// What a surface gives off: irradiance is reflected, all other light is shown as it is.
const shown = (quantity, found) => (quantity === "irradiance" ? `reflected * ${found}` : found);

// The light between surfaces `learned`, or as a lightmap holds it: the `reference` of a light of the database.
export const lit = (name, { functions, quantity }) => `${HEAD}
uniform float exposure;
uniform vec2 parts;
uniform sampler2DArray reference_map;
uniform float reference;
out uvec4 colour;
${PIXEL}
${CODED}
${functions.lamps}
${functions.indirect}
void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  uvec4 place = texelFetch(places, pixel, 0), finish = texelFetch(finishes, pixel, 0);
  if (page_of(finish) == 0u) discard;
  vec3 position = uintBitsToFloat(place.xyz), geometric = normal_of(texelFetch(thirds, pixel, 0).x);
  vec2 uv = uintBitsToFloat(finish.xy);
  vec3 reflected = albedo_of(finish) / ${Math.PI.toPrecision(9)}, radiance = vec3(0.0);
  if (parts.x > 0.0) radiance += parts.x * reflected * prt_direct(position, normal_of(place.w), geometric);
  if (parts.y > 0.0) {
    vec3 found = ${name === "learned" ? "prt_indirect(uv)" : "textureLod(reference_map, vec3(uv, reference), 0.0).rgb"};
    radiance += parts.y * ${shown(quantity, "found")};
  }
  colour = coded(exposure * radiance);
}
`;

// prt_indirect at given places in the atlas, a pixel each.
export const indirectAt = ({ functions }) => `${HEAD}
uniform sampler2D checked_uv;
out uvec4 bits;
${functions.indirect}
void main() {
  bits = floatBitsToUint(vec4(prt_indirect(texelFetch(checked_uv, ivec2(gl_FragCoord.xy), 0).xy), 1.0));
}
`;
