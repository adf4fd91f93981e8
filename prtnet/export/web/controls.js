// The form beside the picture, the bar on it, and the keys.

import { drawBall } from "./ball.js";
import { listen } from "./pointer.js";

const byId = (id) => document.getElementById(id);

export class Controls {
  constructor(viewer, { certify }) {
    this.viewer = viewer;
    this.form = byId("controls");
    const { about } = viewer;
    about.lights.forEach(({ name }, i) => this.form.elements.light.add(new Option(name, i)));
    byId("net-bytes").textContent = kilo(about.costs.net.bytes);
    byId("other-bytes").textContent = kilo(about.costs[about.other].bytes);
    viewer.drawn = (took) => this.report(took);
    this.fill();
    this.form.addEventListener("input", (event) => this.read(event));
    this.form.addEventListener("submit", (event) => event.preventDefault());
    byId("reset").onclick = () => this.act("r");
    byId("keys").onclick = () => this.act("?");
    byId("time").onclick = () => this.act("t");
    byId("certify").onclick = () => (byId("checked").textContent = certify());
    this.pointing();
    this.bar();
    document.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => viewer.changed()).observe(byId("stage"));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => viewer.changed());
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
    const split = state.method === "split";
    for (const id of ["bar", "tag-left", "tag-right"]) byId(id).hidden = !split;
    byId("bar").style.left = `${100 * state.split}%`;
    byId("bar").setAttribute("aria-valuenow", Math.round(100 * state.split));
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

  set(values) {
    this.viewer.set(values);
    this.fill();
  }

  report(took) {
    const { width, height } = this.viewer.renderer.canvas;
    byId("frame").textContent = `${width} × ${height} in ${took < 100 ? took.toFixed(1) : Math.round(took)} ms`;
  }

  pointing() {
    const { viewer } = this;
    const ball = () => drawBall(byId("ball"), viewer.light, viewer.orbit.axes(), viewer.exposure);
    this.moved = () => {
      viewer.changed(true);
      ball();
    };
    listen(viewer.renderer.canvas, viewer.orbit, { changed: this.moved, ended: () => viewer.changed() });
  }

  bar() {
    const bar = byId("bar");
    const stage = byId("stage");
    bar.addEventListener("pointerdown", (event) => bar.setPointerCapture(event.pointerId));
    bar.addEventListener("pointermove", (event) => {
      if (!bar.hasPointerCapture(event.pointerId)) return;
      const { left, width } = stage.getBoundingClientRect();
      this.slide((event.clientX - left) / width);
    });
    byId("tag-left").textContent = "network";
    byId("tag-right").textContent = this.viewer.about.other;
  }

  slide(share) {
    this.viewer.set({ split: Math.min(1, Math.max(0, share)) }, true);
    this.words();
  }

  key(event) {
    const own = event.target.closest && event.target.closest("select, input:not([type=checkbox]), dialog");
    if (event.ctrlKey || event.metaKey || event.altKey || (own && event.key !== "?")) return;
    if (event.target.id === "bar" && event.key.startsWith("Arrow")) {
      this.slide(this.viewer.state.split + (event.key === "ArrowRight" ? 0.02 : -0.02));
      event.preventDefault();
    } else if (this.act(event.key)) event.preventDefault();
  }

  // What a key does; whether it does anything.
  act(key) {
    const { viewer } = this;
    const { state, orbit, about } = viewer;
    const view = (move) => () => {
      move();
      this.moved();
    };
    const actions = {
      l: () => this.set({ light: (state.light + 1) % about.lights.length }),
      "[": () => this.set({ turn: (state.turn + 350) % 360 }),
      "]": () => this.set({ turn: (state.turn + 10) % 360 }),
      g: () => this.set({ specular: state.specular > 0 ? 0 : 0.5 }),
      ",": () => this.slide(state.split - 0.02),
      ".": () => this.slide(state.split + 0.02),
      r: view(() => orbit.reset()),
      "+": view(() => orbit.zoom(0.9)),
      "=": view(() => orbit.zoom(0.9)),
      "-": view(() => orbit.zoom(1 / 0.9)),
      ArrowLeft: view(() => orbit.turn(-0.08, 0)),
      ArrowRight: view(() => orbit.turn(0.08, 0)),
      ArrowUp: view(() => orbit.turn(0, 0.06)),
      ArrowDown: view(() => orbit.turn(0, -0.06)),
      t: () => this.timed(),
      h: () => byId("help").showModal(),
      "?": () => byId("help").showModal(),
    };
    ["net", about.other, "split", "error"].forEach((method, i) => (actions[i + 1] = () => this.choose(method)));
    const action = actions[key.length === 1 ? key.toLowerCase() : key];
    if (action) action();
    return Boolean(action);
  }

  choose(method) {
    const radio = [...this.form.elements.method].find(({ value }) => value === method);
    if (!radio.disabled) this.set({ method });
  }

  timed() {
    const found = this.viewer.time();
    byId("net-ms").textContent = found.net.toFixed(1);
    byId("other-ms").textContent = found[this.viewer.about.other].toFixed(1);
  }
}

function kilo(bytes) {
  return Math.round(bytes / 1000).toLocaleString("en");
}
