// Operator, basis and shadow maps of this page run on this device, and held against what NumPy and rays got.

import { device } from "./device.js";

// What the lamp throws on the measurement points, u and the light at places in the atlas, in red, green and blue, one
// after the other. `direct` stands in place of what the page measures of the lamp.
export function evaluate(renderer, { lamp, direct, uv }) {
  const { gl, model } = renderer;
  if (lamp) renderer.relight(lamp, true);
  if (direct) {
    const image = new Uint32Array(4 * model.points);
    const floats = new Float32Array(image.buffer);
    for (let j = 0; j < model.points; ++j) floats.set(direct.subarray(3 * j, 3 * j + 3), 4 * j);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, renderer.direct.texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, model.points, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, image);
    renderer.reduce();
    renderer.lamp = "";
  }
  return {
    direct: renderer.read(renderer.direct, model.points),
    coefficients: renderer.coefficients.subarray(0, 3 * model.elements).map((value) => value * model.scale),
    indirect: uv ? indirectOf(renderer, uv) : null,
  };
}

function indirectOf(renderer, uv) {
  const { gl } = renderer;
  const count = uv.length / 2;
  const image = new Float32Array(4 * count);
  for (let i = 0; i < count; ++i) image.set(uv.subarray(2 * i, 2 * i + 2), 4 * i);
  gl.activeTexture(gl.TEXTURE0 + renderer.units.checked_uv);
  const places = renderer.floats(count, 1, image);
  const target = renderer.row(count);
  renderer.fill(target, "indirectAt", (made) => {
    renderer.bind(renderer.units.checked_uv, gl.TEXTURE_2D, [places]);
    renderer.bindBasis(made);
  });
  const found = renderer.read(target, count);
  gl.deleteFramebuffer(target.frame);
  for (const texture of [places, target.texture]) gl.deleteTexture(texture);
  return found;
}

// Over the page's own lights: the largest error of u and of texels for the direct vector of rays, as shares of the largest
// of theirs; how far the direct vector by shadow maps is from that of rays, and the texels that follow from it, as
// root mean squares over those of what they should be.
export function certify(renderer) {
  const { uv, cases } = renderer.model.checks;
  const found = { coefficients: 0, texels: 0, direct: 0, shown: 0 };
  // the greater of a number and NaN is NaN
  const worst = (name, error) => (found[name] = Math.max(found[name], error));
  for (const { light, direct, coefficients, indirect } of cases) {
    const given = evaluate(renderer, { direct, uv });
    worst("coefficients", largest(given.coefficients, coefficients));
    worst("texels", largest(given.indirect, indirect));
    const own = evaluate(renderer, { lamp: renderer.model.lights[light].lamp, uv });
    worst("direct", apart(own.direct, direct));
    worst("shown", apart(own.indirect, indirect));
  }
  renderer.lamp = "";
  return { lights: cases.length, texels: uv.length / 2, errors: found, device: device(renderer.gl) };
}

function largest(found, expected) {
  let [most, scale] = [0, 1e-12];
  expected.forEach((value, i) => {
    most = Math.max(most, Math.abs(found[i] - value));
    scale = Math.max(scale, Math.abs(value));
  });
  return most / scale;
}

function apart(found, expected) {
  let [sum, whole] = [0, 1e-24];
  expected.forEach((value, i) => {
    sum += (found[i] - value) ** 2;
    whole += value ** 2;
  });
  return Math.sqrt(sum / whole);
}
