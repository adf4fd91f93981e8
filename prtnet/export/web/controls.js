// The form beside the picture, and its keys.

import { drawBall } from "./ball.js";
import { Panel, byId, kilo } from "./panel.js";

export class Controls extends Panel {
  constructor(viewer, { certify }) {
    const { about } = viewer;
    super(viewer, { certify, tags: ["network", about.other] });
    about.lights.forEach(({ name }, i) => this.form.elements.light.add(new Option(name, i)));
    byId("net-bytes").textContent = kilo(about.costs.net.bytes);
    byId("other-bytes").textContent = kilo(about.costs[about.other].bytes);
    this.fill();
  }

  // The form as the state has it.
  fill() {
    const { state } = this.viewer;
    const { elements } = this.form;
    for (const radio of elements.method) radio.checked = radio.value === state.method;
    for (const name of ["light", "turn", "ev", "diffuse", "specular", "colour"]) elements[name].value = state[name];
    elements.exponent.value = Math.log10(state.exponent);
    elements.own.checked = state.own;
    this.words();
  }

  words() {
    const { viewer, form } = this;
    const { state, about } = viewer;
    const say = (name, text) => (form.querySelector(`output[for="${name}"]`).textContent = text);
    say("turn", `${state.turn}°`);
    say("ev", `${state.ev > 0 ? "+" : ""}${state.ev.toFixed(1)} EV`);
    say("diffuse", state.diffuse.toFixed(2));
    say("specular", state.specular.toFixed(2));
    say("exponent", state.exponent.toPrecision(3));
    const shading = about.costs.diffuse + (state.specular > 0 ? about.costs.gloss : 0);
    const macs = (name) => (about.costs[name].macs + shading).toLocaleString("en");
    byId("net-macs").textContent = macs("net");
    byId("other-macs").textContent = macs(about.other);
    this.parted();
    this.follow();
  }

  // The ball is seen as the scene is.
  follow() {
    const { viewer } = this;
    drawBall(byId("ball"), viewer.light, viewer.orbit.axes(), viewer.exposure);
  }

  read({ target }) {
    const { elements } = this.form;
    const number = (name) => Number(elements[name].value);
    const values = {
      method: elements.method.value,
      light: number("light"),
      turn: number("turn"),
      ev: number("ev"),
      diffuse: number("diffuse"),
      specular: number("specular"),
      exponent: 10 ** number("exponent"),
      own: target.name === "colour" ? false : elements.own.checked,
      colour: elements.colour.value,
    };
    this.viewer.set(values, true);
    this.fill();
  }

  actions() {
    const { state, about } = this.viewer;
    return {
      l: () => this.set({ light: (state.light + 1) % about.lights.length }),
      "[": () => this.set({ turn: (state.turn + 350) % 360 }),
      "]": () => this.set({ turn: (state.turn + 10) % 360 }),
      g: () => this.set({ specular: state.specular > 0 ? 0 : 0.5 }),
    };
  }

  timed() {
    const found = this.viewer.time();
    byId("net-ms").textContent = found.net.toFixed(1);
    byId("other-ms").textContent = found[this.viewer.about.other].toFixed(1);
  }
}
