// What is shown: a lamp, which of its light, and where the light between surfaces comes from.

import { toLinear } from "./ball.js";
import { Frames, median } from "./frames.js";
import { dot, minus, unit } from "./lamp.js";

const PARTS = { both: [1, 1], direct: [1, 0], indirect: [0, 1] };
const FAR = 2; // how far from the middle of the scene a lamp can stand, along each axis

export class DrivenViewer extends Frames {
  constructor(renderer, about) {
    super(renderer, about, { method: "learned", split: 0.5, ev: 0, parts: "both" });
    this.lit_ms = 0;
    this.choose(0);
  }

  // Changes some of the state and draws; `moving`: as in `changed`. A lamp that changes is none of the database any more.
  set(values, moving = false) {
    const { light, ...others } = values;
    const before = "kind" in others && others.kind !== this.state.kind ? this.level() : null;
    if (light !== undefined && light >= 0) this.choose(light);
    const lamp = ["kind", "position", "target", "hue", "strength", "outer"].some(
      (name) => name in others && JSON.stringify(others[name]) !== JSON.stringify(this.state[name]),
    );
    if ("outer" in others) this.state.inner *= others.outer / this.state.outer;
    Object.assign(this.state, others);
    if (lamp) this.state.light = -1;
    if (before !== null) this.level(before);
    if (!this.comparable) this.state.method = "learned";
    this.changed(moving);
  }

  // A light of the database.
  choose(light) {
    const { lamp } = this.about.lights[light];
    const strength = Math.max(...lamp.colour, 1e-6);
    const middle = minus([0, 0, 0], lamp.position);
    const along = lamp.kind === "directional" ? 0 : Math.max(0.3, dot(middle, lamp.aim));
    const position = lamp.kind === "directional" ? lamp.aim.map((value) => -1.2 * value) : lamp.position;
    const target = lamp.kind === "directional" ? [0, 0, 0] : lamp.position.map((value, i) => value + along * lamp.aim[i]);
    Object.assign(this.state, {
      light,
      kind: lamp.kind,
      position: [...position],
      target,
      strength,
      hue: lamp.colour.map((value) => value / strength),
      inner: lamp.inner,
      outer: lamp.outer,
    });
    this.chosen = light;
  }

  // As the shaders have it.
  get lamp() {
    const { state, about } = this;
    if (state.light >= 0) return about.lights[state.light].lamp;
    const { kind, position, target, inner, outer } = state;
    const away = minus(target, position);
    const aim = Math.hypot(...away) > 1e-6 ? unit(away) : [0, -1, 0];
    const colour = state.hue.map((value) => value * state.strength);
    return { kind, position, aim, colour, inner, outer };
  }

  // Whether there is a lightmap of this very light.
  get comparable() {
    const { light } = this.state;
    return light >= 0 && this.about.lights[light].reference !== null;
  }

  // How bright the measurement points are by direct light: the mean of the brightest tenth. `wanted`: the lamp is made so
  // strong that they are this bright, where it reaches them.
  level(wanted = null) {
    const { renderer, about, state } = this;
    renderer.relight(this.lamp);
    const direct = renderer.read(renderer.direct, about.points);
    const each = Float32Array.from({ length: about.points }, (_, j) => Math.max(...direct.subarray(3 * j, 3 * j + 3)));
    const few = Math.ceil(about.points / 10);
    const found = each.sort().subarray(-few).reduce((sum, value) => sum + value / few, 0);
    if (wanted > 0 && found > 0) state.strength *= wanted / found;
    return found;
  }

  // Exposes so that these points are just not white.
  expose() {
    const found = this.level();
    if (found > 0) this.set({ ev: Math.min(6, Math.max(-6, Math.log2(0.6 / found / this.about.lights[this.chosen].exposure))) });
  }

  get exposure() {
    return this.about.lights[this.chosen].exposure * 2 ** this.state.ev;
  }

  prepare(view) {
    const { renderer } = this;
    const started = performance.now();
    renderer.relight(view.lamp);
    renderer.finish();
    this.lit_ms = performance.now() - started;
  }

  view() {
    const { state, about } = this;
    const radiance = about.quantity === "radiance" && state.parts === "both";
    const { reference } = about.lights[Math.max(0, state.light)];
    return {
      ...this.seen(),
      lamp: this.lamp,
      parts: radiance ? PARTS.indirect : PARTS[state.parts],
      reference: reference === null ? 0 : reference,
    };
  }

  timed() {
    const method = "learned";
    return {
      direct: { method, parts: PARTS.direct },
      both: { method, parts: PARTS.both },
    };
  }

  // And of a lamp that moved, before any pixel is drawn.
  time(repeats = 5) {
    const { renderer } = this;
    const taken = Array.from({ length: repeats }, () => {
      const started = performance.now();
      renderer.relight(this.lamp, true);
      renderer.finish();
      return performance.now() - started;
    });
    return { ...super.time(repeats), lamp: median(taken) };
  }

  // Where on the picture a point stands, in CSS pixels, and how far in front of the eye; null behind it.
  placed(point) {
    const { canvas } = this.renderer;
    const { clientWidth, clientHeight } = canvas;
    const { across, upwards, backward } = this.orbit.axes();
    const away = minus(point, this.orbit.eye());
    const depth = -dot(away, backward);
    const [wide, high] = this.orbit.halves(clientWidth / clientHeight);
    if (depth < 0.02) return null;
    const [x, y] = [dot(away, across) / (depth * wide), dot(away, upwards) / (depth * high)];
    return { x: ((1 + x) / 2) * clientWidth, y: ((1 - y) / 2) * clientHeight, depth };
  }

  // A point moved by so many CSS pixels in the plane of the picture, or, `deep`, away from the eye.
  dragged(point, right, down, deep) {
    const { clientWidth, clientHeight } = this.renderer.canvas;
    const found = this.placed(point);
    if (!found) return point;
    const { across, upwards, backward } = this.orbit.axes();
    const step = (2 * found.depth * this.orbit.halves(clientWidth / clientHeight)[1]) / clientHeight;
    const moved = deep
      ? point.map((value, i) => value + step * down * backward[i])
      : point.map((value, i) => value + step * (right * across[i] - down * upwards[i]));
    return moved.map((value) => Math.min(FAR, Math.max(-FAR, value)));
  }
}

export const hexOf = (hue, srgb) =>
  `#${hue.map((value) => Math.round(255 * srgb(value)).toString(16).padStart(2, "0")).join("")}`;

export const hueOf = (hex) => {
  const found = [1, 3, 5].map((at) => toLinear(parseInt(hex.slice(at, at + 2), 16) / 255));
  const most = Math.max(...found, 1e-6);
  return found.map((value) => value / most);
};
