// What the forms of pages have in common: the picture under hands and fingers, the bar on it, and keys.

import { listen } from "./pointer.js";

export const byId = (id) => document.getElementById(id);

export class Panel {
  // Heirs know their form: `fill`, `words`, `read`, what moves with the view: `follow`, more keys: `actions`, `timed`.
  // `tags` are what stands on either side of the bar.
  constructor(viewer, { certify, tags }) {
    this.viewer = viewer;
    this.form = byId("controls");
    this.tags = tags;
    viewer.drawn = (took) => this.report(took);
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
    this.moved = () => {
      viewer.changed(true);
      this.follow();
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
    [byId("tag-left").textContent, byId("tag-right").textContent] = this.tags;
  }

  // The bar as the state has it.
  parted() {
    const { state } = this.viewer;
    const split = state.method === "split";
    for (const id of ["bar", "tag-left", "tag-right"]) byId(id).hidden = !split;
    byId("bar").style.left = `${100 * state.split}%`;
    byId("bar").setAttribute("aria-valuenow", Math.round(100 * state.split));
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
    const { state, orbit } = viewer;
    const view = (move) => () => {
      move();
      this.moved();
    };
    const actions = {
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
      ...this.actions(),
    };
    [...viewer.renderer.methods, "split", "error"].forEach((method, i) => (actions[i + 1] = () => this.choose(method)));
    const action = actions[key.length === 1 ? key.toLowerCase() : key];
    if (action) action();
    return Boolean(action);
  }

  choose(method) {
    const radio = [...this.form.elements.method].find(({ value }) => value === method);
    if (!radio.disabled) this.set({ method });
  }
}

export function kilo(bytes) {
  return Math.round(bytes / 1000).toLocaleString("en");
}
