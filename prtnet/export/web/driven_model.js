// The scene of this page, its basis and its operator, out of its data blocks.

import { blocksOf, mesh } from "./scene.js";

// GLSL
const TEXTS = ["lamps", "indirect"];

export async function load(about) {
  const blocks = await blocksOf(about);
  const floats = (name) => new Float32Array(blocks[name].buffer);
  const text = (name) => new TextDecoder().decode(blocks[name]);
  const { side, channels, references } = about;
  const images = (name, count, own) => scattered(blocks.mask, blocks[name], side, count, own);
  return {
    ...about,
    lit: true,
    functions: Object.fromEntries(TEXTS.map((name) => [name, text(name)])),
    ...mesh(blocks, about.parts),
    basis: images("basis", channels, 4),
    references: references ? images("references", 3 * references, 3) : [],
    matrix: floats("matrix"),
    measured: measurement(floats("measured")),
    checks: checks(floats("checks"), about),
  };
}

// Texels of a square image as layers of four channels, halves of floats, bottom row first; each takes `own` of theirs.
// `mask` says which texels there are, eight in a byte.
function scattered(mask, values, side, channels, own) {
  const images = Array.from({ length: channels / own }, () => new Uint16Array(4 * side * side));
  let row = 0;
  for (let at = 0; at < side * side; ++at) {
    if (!((mask[at >> 3] >> (7 - (at & 7))) & 1)) continue;
    const column = at % side;
    const place = (side - 1 - (at - column) / side) * side + column;
    images.forEach((image, layer) => {
      for (let i = 0; i < own; ++i) image[4 * place + i] = values[row * channels + layer * own + i];
    });
    ++row;
  }
  return images;
}

// Positions, normals and geometric normals, four numbers to each point.
function measurement(values) {
  const third = values.length / 3;
  return [0, 1, 2].map((i) => values.subarray(i * third, (i + 1) * third));
}

// Of each light that is checked: its direct vector as rays find it, u, and the light at the checked texels.
function checks(values, { points, elements, checked }) {
  const { lights, texels } = checked;
  let at = 2 * texels;
  const take = (count) => values.subarray(at, (at += count));
  const cases = lights.map((light) => ({
    light,
    direct: take(3 * points),
    coefficients: take(3 * elements),
    indirect: take(3 * texels),
  }));
  return { uv: values.subarray(0, 2 * texels), cases };
}
