// A lamp as prtnet/data/lighting/lamp.py has it, and the numbers of it that prtnet/export/lamps.py asks for: the twins of
// its `uniforms` and `shadow_matrices`. `shadows` are that module's constants. Matrices stand column by column.

const KINDS = { directional: 0, point: 1, spot: 2 };
const AXES = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const minus = (a, b) => a.map((value, i) => value - b[i]);
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const unit = (a) => a.map((value) => value / Math.hypot(...a));
const cosineOf = (degrees) => Math.cos((degrees * Math.PI) / 180);

export function lampUniforms(lamp) {
  return {
    lamp_position: [...lamp.position, KINDS[lamp.kind]],
    lamp_aim: [...lamp.aim, cosineOf(lamp.outer)],
    lamp_colour: [...lamp.colour, cosineOf(lamp.inner)],
  };
}

// Unit coordinates to clip coordinates of each map; `box`: [low, high] of what casts shadows.
export function shadowMatrices(lamp, box, shadows) {
  if (lamp.kind === "directional") return [parallel(lamp.aim, box, shadows)];
  const { position, outer } = lamp;
  const [low, high] = box;
  const outside = position.map((value, i) => Math.max(low[i] - value, value - high[i], 0));
  const across = position.map((value, i) => Math.max(value - low[i], high[i] - value));
  const near = Math.max(shadows.near, 0.45 * Math.hypot(...outside));
  const far = Math.max(shadows.margin * Math.hypot(...across), 2 * shadows.near);
  if (lamp.kind === "spot" && cosineOf(outer) >= shadows.wide) {
    const wide = shadows.margin * Math.tan((outer * Math.PI) / 180);
    return [columns(lens(wide, near, far), looking(position, lamp.aim))];
  }
  return AXES.map((axis) => columns(lens(shadows.margin, near, far), looking(position, axis)));
}

// To coordinates about a point: x right, y up, looking down -z. Rows.
function looking(position, forward) {
  const right = unit(cross(forward, Math.abs(forward[1]) > 0.9 ? [0, 0, 1] : [0, 1, 0]));
  const rows = [right, cross(right, forward), forward.map((value) => -value)];
  return [...rows.map((row) => [...row, -dot(row, position)]), [0, 0, 0, 1]];
}

function lens(wide, near, far) {
  const depth = [0, 0, (near + far) / (near - far), (2 * near * far) / (near - far)];
  return [[1 / wide, 0, 0, 0], [0, 1 / wide, 0, 0], depth, [0, 0, -1, 0]];
}

// All of the box, as wide as it is high.
function parallel(aim, [low, high], { margin, near }) {
  const view = looking([0, 0, 0], aim);
  const middle = low.map((value, i) => (value + high[i]) / 2);
  const half = minus(high, low).map((value) => value / 2);
  const centre = view.slice(0, 3).map((row) => dot(row, middle));
  const reach = view.slice(0, 3).map((row) => dot(row.map(Math.abs), half));
  const wide = margin * Math.max(reach[0], reach[1], near);
  const deep = margin * Math.max(reach[2], near);
  const rows = [
    [1 / wide, 0, 0, -centre[0] / wide],
    [0, 1 / wide, 0, -centre[1] / wide],
    [0, 0, -1 / deep, centre[2] / deep],
    [0, 0, 0, 1],
  ];
  return columns(rows, view);
}

// Of two matrices in rows, column by column.
function columns(a, b) {
  const entry = (row, column) => a[row].reduce((sum, value, i) => sum + value * b[i][column], 0);
  return new Float32Array(Array.from({ length: 16 }, (_, at) => entry(at % 4, at >> 2)));
}
