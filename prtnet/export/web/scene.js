// The arrays of a page, and the triangles among them.

import { unpack } from "./unpack.js";

// Blocks leave the document once they are read.
export async function blocksOf(about) {
  if (typeof DecompressionStream === "undefined") {
    throw new Error("This browser is too old for this page: it cannot unpack gzip (DecompressionStream).");
  }
  const blocks = {};
  for (const [name, block] of Object.entries(about.blocks)) {
    const element = document.getElementById(`data-${name}`);
    blocks[name] = await unpack(block, element.textContent);
    element.remove();
  }
  return blocks;
}

// Vertices and faces as the renderer takes them.
export function mesh(blocks, parts) {
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
