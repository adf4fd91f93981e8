// GLSL ES 3.00 of the page. `functions` are texts that prtnet wrote: prt_transfer of the net, prt_gloss of any light.

const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
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
const WRITTEN = `
layout(location = 0) out uvec4 place;
layout(location = 1) out uvec4 finish;
void write(vec3 position, vec3 normal, vec3 albedo, vec2 atlas_uv, uint page) {
  vec3 n = normalize(normal);
  vec2 flat_n = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
  if (n.z < 0.0) flat_n = (1.0 - abs(flat_n.yx)) * vec2(flat_n.x < 0.0 ? -1.0 : 1.0, flat_n.y < 0.0 ? -1.0 : 1.0);
  place = uvec4(floatBitsToUint(position), packSnorm2x16(flat_n));
  uint last = packHalf2x16(vec2(albedo.b, 0.0)) | (page + 1u) << 16;
  finish = uvec4(floatBitsToUint(atlas_uv), packHalf2x16(albedo.rg), last);
}
`;

// Of a mesh. Nets with texels have coordinates of their own, those of the atlas that they were trained with.
export const surface = ({ takes_uv }) => `${HEAD}
uniform uint page;
in vec3 position;
in vec3 normal;
in vec2 atlas_uv;
in vec3 albedo;
in vec2 net_uv;
${takes_uv ? "layout(location = 2) out uvec2 net_place;" : ""}
${WRITTEN}

void main() {
  write(position, normal, albedo, atlas_uv, page);
  ${takes_uv ? "net_place = floatBitsToUint(net_uv);" : ""}
}
`;

// Of an implicit surface, whose functions prtnet wrote.
export const marched = ({ functions, parts }) => `${HEAD}
${functions.surface}
uniform vec2 size;
${WRITTEN}
void main() {
  const vec3 albedo[] = vec3[](${parts.map(({ albedo }) => `vec3(${albedo.map((value) => value.toFixed(9))})`).join(", ")});
  vec3 position, normal;
  if (!prt_meet(2.0 * gl_FragCoord.xy / size - 1.0, position, normal)) discard;
  write(position, normal, albedo[prt_part(position)], vec2(0.0), 0u);
}
`;

// The inverse of `write`.
const PIXEL = `
uniform highp usampler2D places, finishes, net_places;
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

const names = (count) => Array.from({ length: count }, (_, i) => `t${i}`);

// sum t_i L_i per colour: of one group of coefficients, or of those in red, green and blue that follow the direct one.
function received(layers, groups) {
  const all = names(groups * layers);
  if (groups === 1) return all.map((name, i) => `light[${i}] * ${name}`).join(" + ");
  const sums = [0, 1, 2].map((rgb) =>
    all
      .slice((rgb + 1) * layers, (rgb + 2) * layers)
      .map((name, i) => `dot(transpose(light[${i}])[${rgb}], ${name})`)
      .join(" + "),
  );
  return `vec3(${sums.join(", ")})`;
}

function textureTransfer(count) {
  const lines = names(count).map(
    (name, i) => `  ${name} = textureLod(transfer_map, vec3(atlas_uv, ${i}.0), 0.0) * transfer_scale[${i}] + transfer_offset[${i}];`,
  );
  return lines.join("\n");
}

// The fragment shader of a method, `net`, `texture` or `unshadowed`: radiance to the eye, exposed, as sRGB in 16 bits.
export function method(name, { layers, groups, functions, takes_uv }) {
  const all = names(layers * groups);
  const computed = name !== "texture";
  const declared = computed
    ? functions[name]
    : `uniform sampler2DArray transfer_map;
uniform vec4 transfer_scale[${all.length}], transfer_offset[${all.length}];
uniform uint page;
`;
  const skipped = computed ? "page_of(finish) == 0u" : "page_of(finish) != page + 1u";
  const point = `position, n${takes_uv ? ", uintBitsToFloat(texelFetch(net_places, ivec2(gl_FragCoord.xy), 0).xy)" : ""}`;
  const transfer = computed ? `  prt_transfer(${point}, ${all.join(", ")});` : textureTransfer(all.length);
  return `${HEAD}
uniform mat4x3 light[${layers}];
uniform vec3 eye, specular;
uniform vec4 paint;
uniform float exposure, diffuse, exponent;
out uvec4 colour;
${PIXEL}
${declared}
${functions.gloss}
void main() {
  uvec4 place = texelFetch(places, ivec2(gl_FragCoord.xy), 0), finish = texelFetch(finishes, ivec2(gl_FragCoord.xy), 0);
  if (${skipped}) discard;
  vec3 position = uintBitsToFloat(place.xyz), n = normal_of(place.w);
  vec2 atlas_uv = uintBitsToFloat(finish.xy);
  vec4 ${all.join(", ")};
${transfer}
  vec3 albedo = mix(albedo_of(finish), paint.rgb, paint.a);
  vec3 radiance = ${(1 / Math.PI).toPrecision(9)} * diffuse * albedo * (${received(layers, groups)});
  if (specular != vec3(0.0)) {
    vec3 mirrored = reflect(normalize(position - eye), n);
    radiance += specular * prt_gloss(mirrored, exponent, ${all.slice(0, layers).join(", ")});
  }
  vec3 shown = clamp(exposure * radiance, 0.0, 1.0);
  vec3 dark = 12.92 * shown, bright = 1.055 * pow(max(shown, 1e-9), vec3(1.0 / 2.4)) - 0.055;
  vec3 coded = mix(bright, dark, lessThanEqual(shown, vec3(0.0031308)));
  colour = uvec4(65535.0 * vec4(coded, 1.0) + 0.5);
}
`;
}

// The net alone at points that textures hold, a pixel each: vector `chosen` of its transfer.
export function points({ layers, groups, functions, takes_uv }) {
  const all = names(layers * groups);
  const picked = all.reduceRight((rest, name, i) => (rest ? `chosen == ${i} ? ${name} : ${rest}` : name), "");
  return `${HEAD}
uniform sampler2D positions, normals, uvs;
uniform int chosen;
out uvec4 colour;
${functions.net}
void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec4 ${all.join(", ")};
  vec3 position = texelFetch(positions, pixel, 0).xyz, normal = texelFetch(normals, pixel, 0).xyz;
  vec2 uv = texelFetch(uvs, pixel, 0).xy;
  prt_transfer(position, normal${takes_uv ? ", uv" : ""}, ${all.join(", ")});
  colour = floatBitsToUint(${picked});
}
`;
}
