// The coefficients of the basis as bars: the square root of their size, above or below a line, in red, green and blue.

const COLOURS = ["#d1495b", "#3c9d5d", "#3f7cc4"];

export function drawBars(canvas, coefficients, elements, ink) {
  const { width, height } = canvas;
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, width, height);
  const values = coefficients.subarray(0, 3 * elements);
  const most = values.reduce((found, value) => Math.max(found, Math.abs(value)), 1e-12);
  const middle = height / 2;
  const step = width / elements;
  for (let i = 0; i < elements; ++i)
    COLOURS.forEach((colour, rgb) => {
      const value = values[3 * i + rgb];
      const tall = Math.sign(value) * Math.sqrt(Math.abs(value) / most) * (middle - 1);
      context.fillStyle = colour;
      context.fillRect(i * step + (rgb * step) / 3.6, middle, step / 3.6, -tall);
    });
  context.fillStyle = ink;
  context.fillRect(0, middle - 0.5, width, 1);
}
