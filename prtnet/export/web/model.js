// The scene of this page, out of its data blocks.

import { blocksOf, mesh } from "./scene.js";
import { layersOf } from "./unpack.js";

// GLSL; the last two of implicit surfaces.
const TEXTS = ["net", "gloss", "surface", "unshadowed"];

// The header of the page, and its arrays as the renderer takes them.
export async function load(about) {
  const blocks = await blocksOf(about);
  const text = (name) => new TextDecoder().decode(blocks[name]);
  return {
    ...about,
    functions: Object.fromEntries(TEXTS.filter((name) => blocks[name]).map((name) => [name, text(name)])),
    ...(blocks.faces ? mesh(blocks, about.parts) : {}),
    pages: about.pages.map((page, i) => ({
      ...page,
      images: layersOf(blocks[`mask${i}`], blocks[`texels${i}`], page.side, about.slots, about.layers * about.groups),
    })),
    images: about.images.map((image, i) => ({ ...image, values: blocks[`image${i}`] })),
    checks: checks(blocks.checks, about),
  };
}

function checks(bits, { slots }) {
  const values = new Float32Array(bits.buffer);
  const count = values.length / (8 + slots.length);
  return {
    positions: values.subarray(0, 3 * count),
    normals: values.subarray(3 * count, 6 * count),
    uv: values.subarray(6 * count, 8 * count),
    expected: values.subarray(8 * count),
    slots,
  };
}
