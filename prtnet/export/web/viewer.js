// What is shown: a light, a material, a method.

import { toLinear } from "./ball.js";
import { Frames } from "./frames.js";
import { turned } from "./sh.js";

export class Viewer extends Frames {
  constructor(renderer, about) {
    const state = { method: "split", split: 0.5, light: 0, turn: 0, ev: 0, own: true, colour: "#d8d4cc" };
    super(renderer, about, { ...about.start, ...state });
    this.relight();
  }

  // Changes some of the state and draws; `moving`: as in `changed`.
  set(values, moving = false) {
    Object.assign(this.state, values);
    if ("light" in values || "turn" in values) this.relight();
    this.changed(moving);
  }

  relight() {
    const { coefficients } = this.about.lights[this.state.light];
    this.light = turned(coefficients, this.state.turn, this.about.upright);
    this.packed = new Float32Array(12 * this.about.layers);
    this.light.forEach((row, i) => this.packed.set(row, 3 * i));
  }

  get exposure() {
    return this.about.lights[this.state.light].exposure * 2 ** this.state.ev;
  }

  view() {
    const { state, about } = this;
    const hex = [1, 3, 5].map((at) => toLinear(parseInt(state.colour.slice(at, at + 2), 16) / 255));
    return {
      ...this.seen(),
      light: this.packed,
      diffuse: state.diffuse,
      specular: about.tint.map((value) => value * state.specular),
      exponent: state.exponent,
      paint: [...hex, state.own ? 0 : 1],
    };
  }

  timed() {
    return { net: { method: "net" }, [this.about.other]: { method: this.about.other } };
  }
}
