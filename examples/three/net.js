// The exported function prt_transfer as a three.js material: its text, and as textures its features, and its weights
// where these are no literals.
import * as THREE from "three";

async function fetched(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url}: ${response.status} ${response.statusText}; see README.md`);
  return response;
}

// A safetensors file: 8 bytes with the length of a JSON header, the header, and the values it points into.
async function tensors(url) {
  const buffer = await (await fetched(url)).arrayBuffer();
  const length = Number(new DataView(buffer).getBigUint64(0, true));
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  const kinds = { F16: Uint16Array, F32: Float32Array }; // three.js takes the bits of half floats
  const entries = Object.entries(header).filter(([name]) => name !== "__metadata__");
  return Object.fromEntries(entries.map(([name, { dtype, shape, data_offsets: [from, to] }]) => {
    return [name, { shape, data: new kinds[dtype](buffer.slice(8 + length + from, 8 + length + to)) }];
  }));
}

// RGBA, read texel by texel: the function blends in full precision itself, as filters of graphics cards do not.
function ready(texture, data) {
  texture.format = THREE.RGBAFormat;
  texture.type = data instanceof Uint16Array ? THREE.HalfFloatType : THREE.FloatType;
  texture.minFilter = texture.magFilter = THREE.NearestFilter;
  texture.needsUpdate = true;
  return texture;
}

// A dense grid "z y x channels": channels 4 q to 4 q + 3 of slice i go into slice q z + i (docs/net-format.md).
function volume({ shape: [z, y, x, channels], data }) {
  const texels = new data.constructor(data.length), cells = z * y * x;
  for (let cell = 0; cell < cells; cell++) {
    for (let c = 0; c < channels; c++) texels[4 * ((c >> 2) * cells + cell) + (c & 3)] = data[cell * channels + c];
  }
  return ready(new THREE.Data3DTexture(texels, x, y, (z * channels) / 4), data);
}

// A hashed grid "entries channels": entry after entry in rows of 256 texels, as it is.
const table = ({ data }) => ready(new THREE.DataTexture(data, 256, data.length / 1024), data);

// Features over the atlas "y x channels", row 0 at v = 1: texture rows begin at v = 0, a place has channels / 4 texels.
function image({ shape: [y, x, channels], data }) {
  const texels = new data.constructor(data.length), row = x * channels;
  for (let v = 0; v < y; v++) texels.set(data.subarray((y - 1 - v) * row, (y - v) * row), v * row);
  return ready(new THREE.DataTexture(texels, row / 4, y), data);
}

// With export.storage=texture: the file has the texels as they are uploaded, the comment in the text their number.
async function weights(folder, source) {
  const [, width, height, bits] = source.match(/weights: (\d+) x (\d+) texels, RGBA(\d+)F/);
  const buffer = await (await fetched(`${folder}/transfer_weights.bin`)).arrayBuffer();
  const data = bits === "16" ? new Uint16Array(buffer) : new Float32Array(buffer);
  return ready(new THREE.DataTexture(data, Number(width), Number(height)), data);
}

// { source, outputs, takesUv, textures } of the run in a folder: transfer.glsl, net.safetensors, transfer_weights.bin.
export async function loadNet(folder) {
  const source = await (await fetched(`${folder}/transfer.glsl`)).text();
  const parameters = source.match(/void prt_transfer\(([^)]*)\)/)[1];
  const outputs = parameters.split("out vec4").length - 1, takesUv = parameters.includes("vec2 uv");
  if (/uniform\s+prt_block/.test(source)) {
    throw new Error("transfer.glsl has uniform blocks, which this page does not fill: export with export.storage=auto");
  }
  const textures = source.includes("sampler2D prt_weights;") ? { prt_weights: await weights(folder, source) } : {};
  for (const [name, tensor] of Object.entries(await tensors(`${folder}/net.safetensors`))) {
    const [kind, index] = name.split(".");
    if (kind === "grid") textures[`prt_grid${index}`] = volume(tensor);
    if (kind === "hash") textures[`prt_hash${index}`] = table(tensor);
    if (kind === "texels") textures[`prt_texels${index}`] = image(tensor);
  }
  for (const [, name] of source.matchAll(/uniform\s+(?:\w+\s+)?\w*sampler\w*\s+(\w+)/g)) {
    if (!textures[name]) throw new Error(`transfer.glsl reads ${name}, which net.safetensors has not: export again`);
  }
  return { source, outputs, takesUv, textures };
}

const VERTEX = `
uniform float scale;
in vec2 uv1; // TEXCOORD_1, the atlas
out vec3 place, facing;
out vec2 mapped, atlas;
invariant gl_Position; // the same in both programs that share this text
void main() {
  // prt_transfer takes the centred position, and the light is the model's: no model matrix here. Whoever turns the
  // model turns the light the other way instead.
  place = position * scale;
  facing = normal;
  mapped = uv;
  atlas = vec2(uv1.x, 1.0 - uv1.y); // v is down in glTF, up in prt_transfer
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

// Depth alone, to be drawn before the network: of what is hidden by something nearer no pixel is computed then.
export function depthMaterial() {
  const uniforms = { scale: { value: 1 } };
  return new THREE.ShaderMaterial({
    glslVersion: THREE.GLSL3, vertexShader: VERTEX, fragmentShader: "void main() {}", uniforms, colorWrite: false,
  });
}

// sum_i t_i L_i per colour. Four groups of vectors are direct transfer, for gloss, and those of red, green and blue.
function received(outputs, groups) {
  const each = outputs / groups;
  const terms = (colour, first) => Array.from({ length: each }, (_, i) => `dot(${colour}[${i}], t${first + i})`);
  const sum = (colour, first) => terms(colour, first).join(" + ");
  return ["red", "green", "blue"].map((colour, c) => sum(colour, groups === 4 ? (c + 1) * each : 0)).join(",\n    ");
}

// `light` and `exposure` are uniforms that all materials share; `standard` has the part's colour and texture.
export function netMaterial(net, about, standard, light, exposure) {
  const names = Array.from({ length: net.outputs }, (_, i) => `t${i}`).join(", ");
  const each = net.outputs / about.groups;
  const fragment = `
${net.source}
uniform vec4 red[${each}], green[${each}], blue[${each}];
uniform vec3 albedo;
uniform sampler2D albedo_map;
uniform float exposure;
in vec3 place, facing;
in vec2 mapped, atlas;
out vec4 colour;
void main() {
  vec4 ${names};
  prt_transfer(place, normalize(facing), ${net.takesUv ? "atlas, " : ""}${names});
  vec3 received = vec3(
    ${received(net.outputs, about.groups)});
  vec3 radiance = albedo * texture(albedo_map, mapped).rgb / ${Math.PI} * max(received, 0.0);
  colour = linearToOutputTexel(vec4(exposure * radiance, 1.0)); // three.js' own, sRGB here
}`;
  const white = ready(new THREE.DataTexture(new Float32Array([1, 1, 1, 1]), 1, 1), new Float32Array());
  const own = { scale: about.scale, albedo: standard.color, albedo_map: standard.map ?? white, ...net.textures };
  const uniforms = Object.fromEntries(Object.entries(own).map(([name, value]) => [name, { value }]));
  const shared = { ...light, exposure };
  return new THREE.ShaderMaterial({
    glslVersion: THREE.GLSL3, vertexShader: VERTEX, fragmentShader: fragment, uniforms: { ...uniforms, ...shared },
  });
}

// Uniforms red, green, blue for coefficients [[r, g, b], ...], four to a vector, the last one padded with 0.
export function lightUniforms(outputs, groups) {
  const empty = () => ({ value: new Float32Array((4 * outputs) / groups) });
  return { red: empty(), green: empty(), blue: empty() };
}

export function setLight(light, coefficients) {
  [light.red, light.green, light.blue].forEach((uniform, c) => {
    coefficients.forEach((rgb, i) => { if (i < uniform.value.length) uniform.value[i] = rgb[c]; });
  });
}
