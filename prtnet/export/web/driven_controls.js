// The form beside the picture, its keys, and the lamp on the picture.

import { srgb } from "./ball.js";
import { drawBars } from "./bars.js";
import { hexOf, hueOf } from "./driven_viewer.js";
import { Handles } from "./handles.js";
import { Panel, byId, kilo } from "./panel.js";

const KINDS_OFFERED = ["point", "spot", "directional"];
const PLACES = ["x", "y", "z"];

export class DrivenControls extends Panel {
  constructor(viewer, { certify }) {
    const { about } = viewer;
    super(viewer, { certify, tags: ["operator", "path-traced"] });
    about.lights.forEach(({ name }, i) => this.form.elements.light.add(new Option(name, i)));
    const own = new Option("moved by hand", -1);
    own.hidden = true;
    this.form.elements.light.add(own);
    byId("kept").textContent = kilo(about.costs.bytes);
    byId("pixel-macs").textContent = about.costs.pixel.toLocaleString("en");
    byId("lamp-macs").textContent = about.costs.lamp.toLocaleString("en");
    byId("parts").hidden = about.quantity !== "irradiance";
    byId("sources").hidden = about.lights.every(({ reference }) => reference === null);
    byId("expose").onclick = () => this.expose();
    this.handles = new Handles(viewer, byId("stage"), (name, point) => this.move({ [name]: point }));
    this.fill();
  }

  // The form as the state has it.
  fill() {
    const { state, comparable } = this.viewer;
    const { elements } = this.form;
    for (const name of ["method", "parts", "kind"])
      for (const radio of elements[name]) radio.checked = radio.value === state[name];
    for (const radio of elements.method) radio.disabled = radio.value !== "learned" && !comparable;
    elements.light.value = state.light;
    PLACES.forEach((axis, i) => {
      elements[axis].value = state.position[i];
      elements[`to_${axis}`].value = state.target[i];
    });
    elements.strength.value = Math.log2(state.strength);
    for (const name of ["ev", "outer"]) elements[name].value = state[name];
    this.viewer.hex = hexOf(state.hue, srgb);
    elements.hue.value = this.viewer.hex;
    byId("aims").hidden = state.kind === "point";
    byId("cone").hidden = state.kind !== "spot";
    this.words();
  }

  words() {
    const { state } = this.viewer;
    const say = (name, text) => (this.form.querySelector(`output[for="${name}"]`).textContent = text);
    PLACES.forEach((axis, i) => {
      say(axis, state.position[i].toFixed(2));
      say(`to_${axis}`, state.target[i].toFixed(2));
    });
    say("ev", `${state.ev > 0 ? "+" : ""}${state.ev.toFixed(1)} EV`);
    say("strength", state.strength.toPrecision(2));
    say("outer", `${Math.round(state.outer)}°`);
    this.parted();
    this.follow();
  }

  follow() {
    this.handles.place();
  }

  report(took) {
    super.report(took);
    const { renderer, about } = this.viewer;
    const ink = getComputedStyle(byId("bars")).color;
    drawBars(byId("bars"), renderer.coefficients, about.elements, ink);
    this.handles.place();
  }

  move(values) {
    this.viewer.set(values, true);
    this.fill();
  }

  read({ target }) {
    const { elements } = this.form;
    const number = (name) => Number(elements[name].value);
    const given = {
      method: () => elements.method.value,
      parts: () => elements.parts.value,
      kind: () => elements.kind.value,
      light: () => number("light"),
      strength: () => 2 ** number("strength"),
      hue: () => hueOf(elements.hue.value),
      ev: () => number("ev"),
      outer: () => number("outer"),
    };
    if (target.name in given) this.move({ [target.name]: given[target.name]() });
    else if (target.name.startsWith("to_")) this.move({ target: PLACES.map((axis) => number(`to_${axis}`)) });
    else this.move({ position: PLACES.map(number) });
  }

  actions() {
    const { state, about } = this.viewer;
    const next = (all, now) => all[(all.indexOf(now) + 1) % all.length];
    return {
      l: () => this.set({ light: (state.light + 1) % about.lights.length }),
      k: () => this.set({ kind: next(KINDS_OFFERED, state.kind) }),
      e: () => this.expose(),
      d: () => this.set({ parts: next(["both", "direct", "indirect"], state.parts) }),
    };
  }

  expose() {
    this.viewer.expose();
    this.fill();
  }

  timed() {
    const found = this.viewer.time();
    byId("direct-ms").textContent = found.direct.toFixed(1);
    byId("both-ms").textContent = found.both.toFixed(1);
    byId("lamp-ms").textContent = found.lamp.toFixed(1);
  }
}
