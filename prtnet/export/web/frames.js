// When frames are drawn: once after each change, coarser while a slow device is being moved about.

import { Orbit } from "./camera.js";

const MOVING = 50; // milliseconds that a frame may take while something moves; fewer pixels are drawn where it takes more
const RESTING = 1500; // and when nothing does
const SMOOTH = 40; // and with four times the pixels, which smooth the edges
const SETTLE = 180; // milliseconds of rest until the frame is drawn again as those at rest are
const COARSEST = 0.2;

export class Frames {
  // Heirs say what is shown: `view`, what of it is timed: `timed`, and what to do before a frame: `prepare`.
  constructor(renderer, about, state) {
    this.renderer = renderer;
    this.about = about;
    this.orbit = new Orbit(about.camera);
    this.state = state;
    this.frames = 0;
    this.taken = {}; // milliseconds of a whole frame by each method, as the last one went
    this.detail = 1;
    this.moving = false;
    this.full = false; // all pixels, however long it takes
    this.drawn = () => {};
    this.failed = () => {};
    this.pending = 0;
    this.rest = 0;
  }

  prepare() {}

  // What every view has.
  seen() {
    const { state, orbit, renderer } = this;
    const { width, height } = renderer.canvas;
    return {
      method: state.method,
      split: state.split,
      camera: orbit.matrix(width / height),
      eye: orbit.eye(),
      axes: orbit.axes(),
      halves: orbit.halves(width / height),
      exposure: this.exposure,
      paper: this.paper(),
    };
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
    const view = this.view();
    this.prepare(view);
    const started = performance.now();
    this.renderer.draw(view);
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

  // The colour behind the scene is that of the page.
  paper() {
    const words = getComputedStyle(this.renderer.canvas.parentElement).backgroundColor.match(/[\d.]+/g) || [0, 0, 0];
    return words.slice(0, 3).map((value) => value / 255);
  }

  // Median milliseconds of a frame of each kind that `timed` names, drawn in turns.
  time(repeats = 5) {
    const views = this.timed();
    const taken = Object.fromEntries(Object.keys(views).map((name) => [name, []]));
    this.fit();
    for (let i = 0; i <= repeats; ++i)
      for (const [name, changes] of Object.entries(views)) {
        const started = performance.now();
        this.renderer.draw({ ...this.view(), ...changes });
        this.renderer.finish();
        // the first of each warms up
        if (i) taken[name].push(performance.now() - started);
      }
    this.changed();
    return Object.fromEntries(Object.entries(taken).map(([name, values]) => [name, median(values)]));
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

export const median = (values) => values.sort((a, b) => a - b)[Math.floor(values.length / 2)];
