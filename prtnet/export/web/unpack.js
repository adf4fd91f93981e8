// The inverse of prtnet/export/packing.py: base64 and gzip of columns of byte planes, differences undone.

const TYPES = { uint8: Uint8Array, uint16: Uint16Array, uint32: Uint32Array };

async function gunzip(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
  const plain = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(plain).arrayBuffer());
}

// The array of a block, row by row.
export async function unpack(about, base64) {
  const bytes = await gunzip(base64);
  const [rows, columns] = about.shape;
  const out = new TYPES[about.kind](rows * columns);
  const size = out.BYTES_PER_ELEMENT;
  if (bytes.length !== rows * columns * size) throw new Error("the data of this page is cut short");
  for (let column = 0; column < columns; ++column) {
    let last = 0;
    for (let row = 0; row < rows; ++row) {
      let value = 0;
      for (let byte = 0; byte < size; ++byte) value |= bytes[(column * size + byte) * rows + row] << (8 * byte);
      out[row * columns + column] = last = about.delta ? last + value : value;
    }
  }
  return out;
}

// Texels of a square texture as layers of four coefficients, bottom row first, as textures are uploaded.
// `mask` says which texels are used, eight in a byte; `rest` is what is left of each after the mean of its neighbours
// to the left and above; `slots` are the channels of the layers that the coefficients fill.
export function layersOf(mask, rest, side, slots, layers) {
  const used = (at) => (mask[at >> 3] >> (7 - (at & 7))) & 1;
  const count = slots.length;
  const places = [];
  for (let at = 0; at < side * side; ++at) if (used(at)) places.push(at);
  const border = ring(places, used, side);
  const images = Array.from({ length: layers }, () => new Uint8Array(4 * side * side));
  const plane = new Uint8Array(side * side);
  for (let k = 0; k < count; ++k) {
    places.forEach((at, i) => {
      const left = at % side > 0 && used(at - 1);
      const above = at >= side && used(at - side);
      const sum = (left ? plane[at - 1] : 0) + (above ? plane[at - side] : 0);
      plane[at] = rest[i * count + k] + (left || above ? Math.floor(sum / (left + above)) : 128);
    });
    const image = images[slots[k] >> 2];
    const channel = slots[k] & 3;
    for (const at of places) image[4 * flipped(at, side) + channel] = plane[at];
    for (const [at, near] of border) {
      let sum = 0;
      for (const other of near) sum += plane[other];
      image[4 * flipped(at, side) + channel] = Math.round(sum / near.length);
    }
  }
  return images;
}

function flipped(at, side) {
  const column = at % side;
  return (side - 1 - (at - column) / side) * side + column;
}

// Texels around the used ones, each with its used neighbours: bilinear look-ups reach that far and no farther.
function ring(places, used, side) {
  const found = new Map();
  for (const at of places) {
    const column = at % side;
    const row = (at - column) / side;
    for (let r = Math.max(row - 1, 0); r <= Math.min(row + 1, side - 1); ++r)
      for (let c = Math.max(column - 1, 0); c <= Math.min(column + 1, side - 1); ++c) {
        const near = r * side + c;
        if (used(near)) continue;
        if (found.has(near)) found.get(near).push(at);
        else found.set(near, [at]);
      }
  }
  return found;
}
