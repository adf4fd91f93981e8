// GLSL ES 3.00 of pages: what each pixel shows, and pictures on the page's own colour.

export const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
precision highp sampler2DArrayShadow;
`;

// Positions and normals come in 16 bits: see prtnet/export/packing.py.
export const VERTICES = `${HEAD}
layout(location = 0) in vec3 in_position;
layout(location = 1) in vec2 in_normal;
layout(location = 2) in vec2 in_uv;
layout(location = 3) in vec3 in_albedo;
layout(location = 4) in vec2 in_net_uv;
uniform mat4 camera;
uniform vec3 box_low, box_span;
out vec3 position;
out vec3 normal;
out vec2 atlas_uv;
out vec3 albedo;
out vec2 net_uv;

void main() {
  vec2 place = in_normal * 2.0 - 1.0;
  vec3 found = vec3(place, 1.0 - abs(place.x) - abs(place.y));
  float away = max(-found.z, 0.0);
  found.xy -= vec2(place.x < 0.0 ? -away : away, place.y < 0.0 ? -away : away);
  normal = normalize(found);
  position = in_position * box_span + box_low;
  atlas_uv = in_uv;
  albedo = in_albedo;
  net_uv = in_net_uv;
  gl_Position = camera * vec4(position, 1.0);
}
`;

// What each pixel shows, as bits in integers: every WebGL 2 can draw those, but not floats.
export const WRITTEN = `
layout(location = 0) out uvec4 place;
layout(location = 1) out uvec4 finish;
uint octahedron(vec3 direction) {
  vec3 n = normalize(direction);
  vec2 flat_n = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
  if (n.z < 0.0) flat_n = (1.0 - abs(flat_n.yx)) * vec2(flat_n.x < 0.0 ? -1.0 : 1.0, flat_n.y < 0.0 ? -1.0 : 1.0);
  return packSnorm2x16(flat_n);
}
void write(vec3 position, vec3 normal, vec3 albedo, vec2 atlas_uv, uint page) {
  place = uvec4(floatBitsToUint(position), octahedron(normal));
  uint last = packHalf2x16(vec2(albedo.b, 0.0)) | (page + 1u) << 16;
  finish = uvec4(floatBitsToUint(atlas_uv), packHalf2x16(albedo.rg), last);
}
`;

// Of a mesh. Nets with texels have coordinates of their own, those of the atlas that they were trained with; lamps want
// the side of the triangle that is seen (`lit`), since shading normals may look another way.
export const surface = ({ takes_uv, lit }) => `${HEAD}
uniform uint page;
in vec3 position;
in vec3 normal;
in vec2 atlas_uv;
in vec3 albedo;
in vec2 net_uv;
${takes_uv || lit ? "layout(location = 2) out uvec2 third;" : ""}
${WRITTEN}

void main() {
  write(position, normal, albedo, atlas_uv, page);
  ${takes_uv ? "third = floatBitsToUint(net_uv);" : ""}
  ${lit ? "third = uvec2(octahedron(cross(dFdx(position), dFdy(position))), 0u);" : ""}
}
`;

// The inverse of `write`.
export const PIXEL = `
uniform highp usampler2D places, finishes, thirds;
uint page_of(uvec4 finish) { return finish.w >> 16; }
vec3 albedo_of(uvec4 finish) { return vec3(unpackHalf2x16(finish.z), unpackHalf2x16(finish.w & 0xffffu).x); }
vec3 normal_of(uint bits) {
  vec2 flat_n = unpackSnorm2x16(bits);
  vec3 n = vec3(flat_n, 1.0 - abs(flat_n.x) - abs(flat_n.y));
  float away = max(-n.z, 0.0);
  n.xy -= vec2(n.x < 0.0 ? -away : away, n.y < 0.0 ? -away : away);
  return normalize(n);
}
`;

export const FRAME = `${HEAD}
void main() {
  vec2 corner = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
  gl_Position = vec4(corner * 2.0 - 1.0, 0.0, 1.0);
}
`;

// A picture in 16 bits on the page's own colour.
export const SHOWN = `${HEAD}
uniform highp usampler2D first;
uniform vec3 paper;
out vec4 colour;
void main() {
  uvec4 found = texelFetch(first, ivec2(gl_FragCoord.xy), 0);
  colour = vec4(found.a == 0u ? paper : vec3(found.rgb) / 65535.0, 1.0);
}
`;

// Eight times what two of them differ by; dark where nothing is.
export const DIFFERENCE = `${HEAD}
uniform highp usampler2D first, second;
uniform vec3 paper;
out vec4 colour;
void main() {
  uvec4 a = texelFetch(first, ivec2(gl_FragCoord.xy), 0), b = texelFetch(second, ivec2(gl_FragCoord.xy), 0);
  vec3 apart = abs(vec3(a.rgb) - vec3(b.rgb)) / 65535.0;
  colour = vec4(a.a == 0u ? 0.15 * paper : 8.0 * apart, 1.0);
}
`;

// Exposed radiance as sRGB in 16 bits.
export const CODED = `
uvec4 coded(vec3 exposed) {
  vec3 shown = clamp(exposed, 0.0, 1.0);
  vec3 dark = 12.92 * shown, bright = 1.055 * pow(max(shown, 1e-9), vec3(1.0 / 2.4)) - 0.055;
  return uvec4(65535.0 * vec4(mix(bright, dark, lessThanEqual(shown, vec3(0.0031308))), 1.0) + 0.5);
}
`;
