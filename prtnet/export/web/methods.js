// GLSL ES 3.00 of the methods. `functions` are texts that prtnet wrote: prt_transfer of the net, prt_gloss of any light.

import { CODED, HEAD, PIXEL, WRITTEN } from "./shaders.js";

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
  const point = `position, n${takes_uv ? ", uintBitsToFloat(texelFetch(thirds, ivec2(gl_FragCoord.xy), 0).xy)" : ""}`;
  const transfer = computed ? `  prt_transfer(${point}, ${all.join(", ")});` : textureTransfer(all.length);
  return `${HEAD}
uniform mat4x3 light[${layers}];
uniform vec3 eye, specular;
uniform vec4 paint;
uniform float exposure, diffuse, exponent;
out uvec4 colour;
${PIXEL}
${CODED}
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
  colour = coded(exposure * radiance);
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
