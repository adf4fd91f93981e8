// What pages draw with: programs, textures and targets of a context, and the points of the scene that pixels show, which
// are drawn again only for another view. Pages say which samplers stand where (`units`) and what each program is.

import { Refused, checkLimits } from "./device.js";
import { DIFFERENCE, FRAME, SHOWN } from "./shaders.js";

export class Graphics {
  // `methods`: the two that split and error compare, whose pictures `shade` draws.
  constructor(gl, model, units, methods) {
    this.gl = gl;
    this.canvas = gl.canvas;
    this.model = model;
    this.units = units;
    this.methods = methods;
  }

  // Everything that a context holds; again after a lost one is back.
  begun() {
    const gl = this.gl;
    checkLimits(gl, this.model.needs);
    this.programs = {};
    this.targets = {};
    this.seen = "";
    gl.enable(gl.CULL_FACE);
    this.frame = gl.createVertexArray();
  }

  texture(kind, filter, fill) {
    const gl = this.gl;
    const texture = gl.createTexture();
    gl.bindTexture(kind, texture);
    for (const name of ["MIN_FILTER", "MAG_FILTER"]) gl.texParameteri(kind, gl[`TEXTURE_${name}`], filter);
    for (const name of ["WRAP_S", "WRAP_T"]) gl.texParameteri(kind, gl[`TEXTURE_${name}`], gl.CLAMP_TO_EDGE);
    fill(gl);
    return texture;
  }

  // A program by its name, compiled when it is first asked for.
  program(name) {
    if (this.programs[name]) return this.programs[name];
    const started = performance.now();
    const shown = { surface: () => this.shape.texts(), shown: () => [FRAME, SHOWN], difference: () => [FRAME, DIFFERENCE] };
    const program = this.link(...(shown[name] ? shown[name]() : this.texts(name)));
    const made = { program, places: {}, milliseconds: performance.now() - started };
    this.gl.useProgram(program);
    for (const [sampler, unit] of Object.entries(this.units)) this.put(made, "uniform1i", sampler, unit);
    return (this.programs[name] = made);
  }

  link(vertex, fragment) {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, text] of [
      [gl.VERTEX_SHADER, vertex],
      [gl.FRAGMENT_SHADER, fragment],
    ]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
      throw new Refused(`The shader does not compile here: ${[gl.getProgramInfoLog(program), ...logs].join(" ").trim()}`);
    }
    return program;
  }

  put(made, call, name, ...values) {
    if (!(name in made.places)) made.places[name] = this.gl.getUniformLocation(made.program, name);
    if (made.places[name]) this.gl[call](made.places[name], ...values);
  }

  // One frame. `view`: method, split (0 to 1), camera, eye, exposure, paper, and what `shade` asks for.
  draw(view) {
    const [left, right] = this.methods;
    const { canvas } = this;
    if (this.gl.isContextLost()) return;
    this.surface(view);
    const split = view.method === "split";
    const both = view.method === "error";
    const bar = Math.round(view.split * canvas.width);
    const first = this.picture("first", () => {
      if (split) this.within(0, bar, () => this.shade(left, view));
      else this.shade(both ? left : view.method, view);
      if (split) this.within(bar, canvas.width, () => this.shade(right, view));
    });
    const pictures = both ? [first, this.picture("second", () => this.shade(right, view))] : [first];
    this.show(both ? "difference" : "shown", pictures, view.paper);
  }

  // A texture of what `draw` draws.
  picture(name, draw) {
    const { frame, textures } = this.target(name, [this.gl.RGBA16UI]);
    this.begin(frame);
    draw();
    return textures[0];
  }

  within(left, right, draw) {
    const gl = this.gl;
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(left, 0, right - left, this.canvas.height);
    draw();
    gl.disable(gl.SCISSOR_TEST);
  }

  show(name, pictures, paper) {
    const gl = this.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    const made = this.program(name);
    gl.useProgram(made.program);
    gl.bindVertexArray(this.frame);
    this.bind(this.units.first, gl.TEXTURE_2D, pictures);
    this.put(made, "uniform3fv", "paper", paper);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  begin(frame) {
    const { gl, canvas } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearBufferuiv(gl.COLOR, 0, [0, 0, 0, 0]);
  }

  // Which point of the scene each pixel shows, unless that is known.
  surface(view) {
    const { gl, canvas, model } = this;
    const seen = [canvas.width, canvas.height, ...view.camera].join();
    if (seen === this.seen) return;
    const bits = [gl.RGBA32UI, gl.RGBA32UI, ...(model.takes_uv || model.lit ? [gl.RG32UI] : [])];
    const { frame } = this.target("surface", bits, true);
    this.begin(frame);
    for (let i = 1; i < bits.length; ++i) gl.clearBufferuiv(gl.COLOR, i, [0, 0, 0, 0]);
    gl.clearBufferfi(gl.DEPTH_STENCIL, 0, 1, 0);
    const made = this.program("surface");
    gl.useProgram(made.program);
    this.shape.draw(made, view);
    this.seen = seen;
  }

  bind(first, kind, textures) {
    const gl = this.gl;
    textures.forEach((texture, i) => {
      gl.activeTexture(gl.TEXTURE0 + first + i);
      gl.bindTexture(kind, texture);
    });
  }

  // A framebuffer of the canvas's size with integer textures of these formats.
  target(name, formats, deep = false) {
    const { gl, canvas } = this;
    const { width, height } = canvas;
    const old = this.targets[name];
    if (old && old.width === width && old.height === height) return old;
    if (old) this.drop(old);
    const textures = formats.map((format) =>
      this.texture(gl.TEXTURE_2D, gl.NEAREST, () => gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height)),
    );
    const depth = deep ? gl.createRenderbuffer() : null;
    if (depth) {
      gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
      gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH24_STENCIL8, width, height);
    }
    return (this.targets[name] = { width, height, textures, depth, frame: this.framebuffer(textures, depth) });
  }

  drop({ frame, textures, depth }) {
    const gl = this.gl;
    gl.deleteFramebuffer(frame);
    gl.deleteRenderbuffer(depth);
    for (const texture of textures) gl.deleteTexture(texture);
  }

  framebuffer(textures, depth) {
    const gl = this.gl;
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    const places = textures.map((_, i) => gl.COLOR_ATTACHMENT0 + i);
    textures.forEach((texture, i) => gl.framebufferTexture2D(gl.FRAMEBUFFER, places[i], gl.TEXTURE_2D, texture, 0));
    gl.drawBuffers(places);
    if (depth) gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_STENCIL_ATTACHMENT, gl.RENDERBUFFER, depth);
    return frame;
  }

  // Waits until all that was drawn is there.
  finish() {
    const gl = this.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }
}
