// A pinhole camera that goes round a point. y is up; the scene lies in [-1, 1]^3.

const STEEPEST = 1.5; // radians above and below the horizon

export class Orbit {
  constructor({ eye, target, fov }) {
    this.home = { eye, target, fov };
    this.reset();
  }

  reset() {
    const { eye, target, fov } = this.home;
    const away = eye.map((value, i) => value - target[i]);
    this.target = [...target];
    this.fov = fov;
    this.distance = Math.hypot(...away);
    this.azimuth = Math.atan2(away[0], away[2]);
    this.elevation = Math.asin(away[1] / this.distance);
  }

  turn(right, up) {
    this.azimuth -= right;
    this.elevation = Math.min(STEEPEST, Math.max(-STEEPEST, this.elevation + up));
  }

  zoom(factor) {
    this.distance = Math.min(12, Math.max(0.05, this.distance * factor));
  }

  // Moves what is looked at, by shares of the frame's height.
  pan(right, up) {
    const { across, upwards } = this.axes();
    const step = 2 * this.distance * Math.tan((this.fov * Math.PI) / 360);
    this.target = this.target.map((value, i) => {
      const moved = value - step * (right * across[i] + up * upwards[i]);
      return Math.min(1, Math.max(-1, moved));
    });
  }

  axes() {
    const [sa, ca] = [Math.sin(this.azimuth), Math.cos(this.azimuth)];
    const [se, ce] = [Math.sin(this.elevation), Math.cos(this.elevation)];
    return { backward: [sa * ce, se, ca * ce], across: [ca, 0, -sa], upwards: [-sa * se, ce, -ca * se] };
  }

  eye() {
    const { backward } = this.axes();
    return this.target.map((value, i) => value + this.distance * backward[i]);
  }

  // Half the frame's width and height, seen from a distance of 1. The field of view is that of the shorter side.
  halves(aspect) {
    const half = Math.tan((this.fov * Math.PI) / 360);
    return aspect > 1 ? [half * aspect, half] : [half, half / aspect];
  }

  // Unit coordinates to clip coordinates, column by column.
  matrix(aspect) {
    const { backward, across, upwards } = this.axes();
    const eye = this.eye();
    const far = Math.hypot(...eye) + 2;
    const near = Math.max(0.01, 0.02 * this.distance);
    const [sx, sy] = this.halves(aspect).map((half) => 1 / half);
    const depth = [(near + far) / (near - far), (2 * near * far) / (near - far)];
    const dot = (axis) => -axis.reduce((sum, value, i) => sum + value * eye[i], 0);
    const rows = [
      [...across.map((value) => sx * value), sx * dot(across)],
      [...upwards.map((value) => sy * value), sy * dot(upwards)],
      [...backward.map((value) => depth[0] * value), depth[0] * dot(backward) + depth[1]],
      [...backward.map((value) => -value), -dot(backward)],
    ];
    return new Float32Array([0, 1, 2, 3].flatMap((column) => rows.map((row) => row[column])));
  }
}
