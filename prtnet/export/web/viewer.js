// What is shown, and when it is drawn: once after each change, coarser while a slow device is being moved about.

import { toLinear } from "./ball.js";
import { Orbit } from "./camera.js";
import { turned } from "./sh.js";

const MOVING = 50; // milliseconds that a frame may take while something moves; fewer pixels are drawn where it takes more
const RESTING = 1500; // and when nothing does
const SMOOTH = 40; // and with four times the pixels, which smooth the edges
const SETTLE = 180; // milliseconds of rest until the frame is drawn again as those at rest are
const COARSEST = 0.2;

export class Viewer {
  constructor(renderer, about) {
    this.renderer = renderer;
    this.about = about;
    this.orbit = new Orbit(about.camera);
    this.state = { ...about.start, method: "split", split: 0.5, light: 0, turn: 0, ev: 0, own: true, colour: "#d8d4cc" };
    this.frames = 0;
    this.taken = {}; // milliseconds of a whole frame by each method, as the last one went
    this.detail = 1;
    this.moving = false;
    this.full = false; // all pixels, however long it takes
    this.drawn = () => {};
    this.failed = () => {};
    this.pending = 0;
    this.rest = 0;
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

  // A frame is due. `moving`: more will follow.
  changed(moving = false) {
    clearTimeout(this.rest);
    this.detail = moving ? this.affordable(MOVING) : this.resting();
    this.moving = moving;
    if (moving) this.rest = setTimeout(() => this.changed(), SETTLE);
    if (!this.pending) this.pending = requestAnimationFrame(() => this.frame());
  }

  resting() {
    return this.affordable(SMOOTH / 4) === 1 && !this.full ? 2 : this.affordable(RESTING);
  }

  // The share of the pixels along each side that a frame of so many milliseconds has.
  affordable(milliseconds) {
    if (this.full) return 1;
    const known = Object.values(this.taken);
    const due = this.taken[this.state.method] || 2 * Math.max(0, ...known);
    return due > milliseconds ? Math.max(COARSEST, Math.sqrt(milliseconds / due)) : 1;
  }

  frame() {
    this.pending = 0;
    try {
      this.draw();
    } catch (error) {
      this.failed(error);
    }
  }

  draw() {
    if (this.renderer.gl.isContextLost()) return;
    this.fit();
    const started = performance.now();
    this.renderer.draw(this.view());
    this.renderer.finish();
    const took = performance.now() - started;
    this.taken[this.state.method] = took / this.detail ** 2;
    this.frames += 1;
    this.drawn(took);
    // a coarse frame says more than it takes: what does not depend on the pixels looks as if it did
    if (!this.moving && this.resting() > 1.2 * this.detail) this.changed();
  }

  // The canvas in the screen's own pixels.
  fit() {
    const { canvas, gl } = this.renderer;
    const most = gl.getParameter(gl.MAX_RENDERBUFFER_SIZE);
    const dense = Math.min((window.devicePixelRatio || 1) * this.detail, 2);
    const size = (length) => Math.max(1, Math.min(most, Math.round(length * dense)));
    const [width, height] = [size(canvas.clientWidth), size(canvas.clientHeight)];
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  }

  view() {
    const { state, orbit, renderer, about } = this;
    const { width, height } = renderer.canvas;
    const hex = [1, 3, 5].map((at) => toLinear(parseInt(state.colour.slice(at, at + 2), 16) / 255));
    return {
      method: state.method,
      split: state.split,
      camera: orbit.matrix(width / height),
      eye: orbit.eye(),
      axes: orbit.axes(),
      halves: orbit.halves(width / height),
      light: this.packed,
      exposure: this.exposure,
      diffuse: state.diffuse,
      specular: about.tint.map((value) => value * state.specular),
      exponent: state.exponent,
      paint: [...hex, state.own ? 0 : 1],
      paper: this.paper(),
    };
  }

  // The colour behind the scene is that of the page.
  paper() {
    const words = getComputedStyle(this.renderer.canvas.parentElement).backgroundColor.match(/[\d.]+/g) || [0, 0, 0];
    return words.slice(0, 3).map((value) => value / 255);
  }

  // Median milliseconds of a frame by each method, drawn in turns.
  time(repeats = 5) {
    const taken = { net: [], [this.about.other]: [] };
    this.fit();
    for (let i = 0; i <= repeats; ++i)
      for (const method of Object.keys(taken)) {
        const started = performance.now();
        this.renderer.draw({ ...this.view(), method });
        this.renderer.finish();
        // the first of each warms up
        if (i) taken[method].push(performance.now() - started);
      }
    this.changed();
    const median = (values) => values.sort((a, b) => a - b)[Math.floor(values.length / 2)];
    return Object.fromEntries(Object.entries(taken).map(([method, values]) => [method, median(values)]));
  }

  // The frame as it is now: RGBA bytes, bottom row first.
  pixels() {
    const { gl, canvas } = this.renderer;
    this.draw();
    this.renderer.draw(this.view());
    const out = new Uint8Array(4 * canvas.width * canvas.height);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, out);
    return { width: canvas.width, height: canvas.height, data: out };
  }
}
