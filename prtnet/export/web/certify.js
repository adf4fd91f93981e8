// The net of this page run on this device at given points, and held against what NumPy got for them.

import { device } from "./device.js";

// Coefficients of `n` points, one after the other, padded to whole vectors: positions, normals and, for nets that take
// them, coordinates in the atlas are Float32Arrays.
export function evaluate(renderer, positions, normals, uv) {
  const { gl, model } = renderer;
  const count = positions.length / 3;
  const side = Math.ceil(Math.sqrt(count));
  const vectors = model.layers * model.groups;
  const textures = [positions, normals, ...(model.takes_uv ? [uv] : [])].map((values, unit) => {
    gl.activeTexture(gl.TEXTURE1 + unit);
    const image = new Float32Array(4 * side * side);
    const width = values.length / count;
    for (let i = 0; i < count; ++i) image.set(values.subarray(width * i, width * (i + 1)), 4 * i);
    return renderer.texture(gl.TEXTURE_2D, gl.NEAREST, () =>
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, side, side, 0, gl.RGBA, gl.FLOAT, image),
    );
  });
  gl.activeTexture(gl.TEXTURE0);
  const target = renderer.texture(gl.TEXTURE_2D, gl.NEAREST, () =>
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32UI, side, side),
  );
  const frame = renderer.framebuffer([target], null);
  const made = renderer.program("points");
  gl.useProgram(made.program);
  renderer.bindImages();
  gl.viewport(0, 0, side, side);
  gl.bindVertexArray(renderer.frame);
  const out = new Float32Array(count * 4 * vectors);
  const bits = new Uint32Array(4 * side * side);
  const pixels = new Float32Array(bits.buffer);
  for (let vector = 0; vector < vectors; ++vector) {
    renderer.put(made, "uniform1i", "chosen", vector);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.readPixels(0, 0, side, side, gl.RGBA_INTEGER, gl.UNSIGNED_INT, bits);
    for (let i = 0; i < count; ++i) out.set(pixels.subarray(4 * i, 4 * i + 4), 4 * (vectors * i + vector));
  }
  gl.deleteFramebuffer(frame);
  for (const texture of [...textures, target]) gl.deleteTexture(texture);
  return out;
}

// The largest and the mean absolute error over the page's own points.
export function certify(renderer) {
  const { positions, normals, uv, expected, slots } = renderer.model.checks;
  const found = evaluate(renderer, positions, normals, uv);
  const [count, coefficients] = [positions.length / 3, slots.length];
  const stride = found.length / count;
  let [most, sum] = [0, 0];
  for (let i = 0; i < count; ++i)
    for (let k = 0; k < coefficients; ++k) {
      const error = Math.abs(found[i * stride + slots[k]] - expected[i * coefficients + k]);
      // the greater of a number and NaN is NaN
      most = Math.max(most, error);
      sum += error;
    }
  return { points: count, error_max: most, error_mean: sum / (count * coefficients), device: device(renderer.gl) };
}
