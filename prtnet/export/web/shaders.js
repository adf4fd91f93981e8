// GLSL ES 3.00 of the page. `functions` are texts that prtnet wrote: prt_transfer of the net, prt_gloss of any light.

const HEAD = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler2DArray;
`;

// Positions and normals come in 16 bits: see prtnet/export/packing.py.
export const SURFACE = `${HEAD}
layout(location = 0) in vec3 in_position;
layout(location = 1) in vec2 in_normal;
layout(location = 2) in vec2 in_uv;
layout(location = 3) in vec3 in_albedo;
uniform mat4 camera;
uniform vec3 box_low, box_span;
centroid out vec3 position;
centroid out vec3 normal;
centroid out vec2 atlas_uv;
centroid out vec3 own_albedo;
invariant gl_Position;

void main() {
  vec2 place = in_normal * 2.0 - 1.0;
  vec3 found = vec3(place, 1.0 - abs(place.x) - abs(place.y));
  float away = max(-found.z, 0.0);
  found.xy -= vec2(place.x < 0.0 ? -away : away, place.y < 0.0 ? -away : away);
  normal = normalize(found);
  position = in_position * box_span + box_low;
  atlas_uv = in_uv;
  own_albedo = in_albedo;
  gl_Position = camera * vec4(position, 1.0);
}
`;

export const DEPTH = `${HEAD}
void main() {}
`;

export const FRAME = `${HEAD}
void main() {
  vec2 corner = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2);
  gl_Position = vec4(corner * 2.0 - 1.0, 0.0, 1.0);
}
`;

// Eight times what two pictures differ by, as they are shown; dark where nothing is.
export const DIFFERENCE = `${HEAD}
uniform sampler2D first, second;
out vec4 colour;
void main() {
  vec4 a = texelFetch(first, ivec2(gl_FragCoord.xy), 0), b = texelFetch(second, ivec2(gl_FragCoord.xy), 0);
  colour = vec4(8.0 * abs(a.rgb - b.rgb) + (a.a < 0.5 ? 0.15 * a.rgb : vec3(0.0)), 1.0);
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
    (name, i) => `  ${name} = texture(transfer_map, vec3(atlas_uv, ${i}.0)) * transfer_scale[${i}] + transfer_offset[${i}];`,
  );
  return lines.join("\n");
}

// The fragment shader of a method, `net` or `texture`: radiance to the eye, exposed, as sRGB.
export function method(name, { layers, groups, functions }) {
  const all = names(layers * groups);
  const net = name === "net";
  const declared = net
    ? functions.net
    : `uniform sampler2DArray transfer_map;
uniform vec4 transfer_scale[${all.length}], transfer_offset[${all.length}];
`;
  const transfer = net ? `  prt_transfer(position, n, ${all.join(", ")});` : textureTransfer(all.length);
  return `${HEAD}
uniform mat4x3 light[${layers}];
uniform vec3 eye, specular;
uniform vec4 paint;
uniform float exposure, diffuse, exponent;
centroid in vec3 position;
centroid in vec3 normal;
centroid in vec2 atlas_uv;
centroid in vec3 own_albedo;
out vec4 colour;
${declared}
${functions.gloss}
void main() {
  vec3 n = normalize(normal);
  vec4 ${all.join(", ")};
${transfer}
  vec3 albedo = mix(own_albedo, paint.rgb, paint.a);
  vec3 radiance = ${(1 / Math.PI).toPrecision(9)} * diffuse * albedo * (${received(layers, groups)});
  if (specular != vec3(0.0)) {
    vec3 mirrored = reflect(normalize(position - eye), n);
    radiance += specular * prt_gloss(mirrored, exponent, ${all.slice(0, layers).join(", ")});
  }
  vec3 shown = clamp(exposure * radiance, 0.0, 1.0);
  vec3 dark = 12.92 * shown, bright = 1.055 * pow(max(shown, 1e-9), vec3(1.0 / 2.4)) - 0.055;
  colour = vec4(mix(bright, dark, lessThanEqual(shown, vec3(0.0031308))), 1.0);
}
`;
}

// The net alone at points that textures hold, a pixel each: vector `chosen` of its transfer.
export function points({ layers, groups, functions }) {
  const all = names(layers * groups);
  const picked = all.reduceRight((rest, name, i) => (rest ? `chosen == ${i} ? ${name} : ${rest}` : name), "");
  return `${HEAD}
uniform sampler2D positions, normals;
uniform int chosen;
out vec4 colour;
${functions.net}
void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec4 ${all.join(", ")};
  prt_transfer(texelFetch(positions, pixel, 0).xyz, texelFetch(normals, pixel, 0).xyz, ${all.join(", ")});
  colour = ${picked};
}
`;
}
