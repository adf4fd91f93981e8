// A grey ball under the light, as the page's key to where that comes from.

import { cosineZonal, harmonics } from "./sh.js";

const ALBEDO = 0.35;

// Draws it as the camera sees it; `axes` are that of camera.js, `light` coefficients per colour.
export function drawBall(canvas, light, axes, exposure) {
  const size = canvas.width;
  const context = canvas.getContext("2d");
  const image = context.createImageData(size, size);
  const bands = Math.sqrt(light.length);
  const zonal = cosineZonal(bands);
  const weighted = light.map((row, i) => row.map((value) => (value * zonal[Math.floor(Math.sqrt(i))] * exposure * ALBEDO) / Math.PI));
  for (let row = 0; row < size; ++row)
    for (let column = 0; column < size; ++column) {
      const x = ((column + 0.5) / size) * 2 - 1;
      const y = 1 - ((row + 0.5) / size) * 2;
      const radius = Math.hypot(x, y);
      const cover = Math.min(1, Math.max(0, ((1 - radius) * size) / 2 + 0.5));
      if (cover === 0) continue;
      const z = Math.sqrt(Math.max(0, 1 - radius * radius));
      const normal = [0, 1, 2].map((i) => x * axes.across[i] + y * axes.upwards[i] + z * axes.backward[i]);
      const length = Math.hypot(...normal);
      const basis = harmonics(normal.map((value) => value / length), bands);
      const at = 4 * (row * size + column);
      for (let rgb = 0; rgb < 3; ++rgb) {
        let sum = 0;
        for (let i = 0; i < basis.length; ++i) sum += basis[i] * weighted[i][rgb];
        image.data[at + rgb] = 255 * srgb(sum);
      }
      image.data[at + 3] = 255 * cover;
    }
  context.putImageData(image, 0, 0);
}

export function srgb(linear) {
  const value = Math.min(1, Math.max(0, linear));
  return value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;
}

export function toLinear(value) {
  return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
}
