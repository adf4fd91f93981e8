// The scene of this page, out of its data blocks.

import { layersOf, unpack } from "./unpack.js";

// GLSL; the last two of implicit surfaces.
const TEXTS = ["net", "gloss", "surface", "unshadowed"];

// The header of the page, and its arrays as the renderer takes them. Blocks leave the document once they are read.
export async function load(about) {
  if (typeof DecompressionStream === "undefined") {
    throw new Error("This browser is too old for this page: it cannot unpack gzip (DecompressionStream).");
  }
  const blocks = {};
  for (const [name, block] of Object.entries(about.blocks)) {
    const element = document.getElementById(`data-${name}`);
    blocks[name] = await unpack(block, element.textContent);
    element.remove();
  }
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

function mesh(blocks, parts) {
  return {
    positions: widened(blocks.positions),
    normals: blocks.normals,
    uv: blocks.uv,
    netUv: blocks.net_uv,
    albedo: painted(blocks.part, parts),
    faces: blocks.faces,
  };
}

// Vertex attributes stand at multiples of four bytes.
function widened(steps) {
  const out = new Uint16Array((steps.length / 3) * 4);
  for (let i = 0; 3 * i < steps.length; ++i) out.set(steps.subarray(3 * i, 3 * i + 3), 4 * i);
  return out;
}

function painted(part, parts) {
  const out = new Float32Array(3 * part.length);
  part.forEach((own, i) => out.set(parts[own].albedo, 3 * i));
  return out;
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
