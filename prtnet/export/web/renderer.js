// WebGL2: the mesh by each method, split or compared. Draws when told to, and never by itself.

import { DEPTH, DIFFERENCE, FRAME, SURFACE, method, points } from "./shaders.js";

const UNITS = { transfer_map: 0, first: 1, second: 2, positions: 1, normals: 2 };
const FIRST_GRID = 3;

export class Refused extends Error {}

export function contextOf(canvas) {
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: false, powerPreference: "high-performance" });
  if (!gl) throw new Refused("This page draws with WebGL 2, which this browser does not offer or has turned off.");
  return gl;
}

export class Renderer {
  constructor(gl, model) {
    this.gl = gl;
    this.canvas = gl.canvas;
    this.model = model;
    this.build();
  }

  // Everything that a context holds; again after a lost one is back.
  build() {
    const gl = this.gl;
    this.check();
    // needed to compare and to measure, not to draw
    this.floats = Boolean(gl.getExtension("EXT_color_buffer_float"));
    this.programs = {};
    this.pair = null;
    this.mesh();
    this.pages = this.model.pages.map((page) => this.transferMap(page));
    this.grids = this.model.grids.map((grid) => ({ name: grid.name, texture: this.grid(grid) }));
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
  }

  // Limits that WebGL 2 leaves to the device. Says what is missing.
  check() {
    const gl = this.gl;
    const needed = this.model.needs;
    const most = (name) => gl.getParameter(gl[name]);
    const precision = gl.getShaderPrecisionFormat(gl.FRAGMENT_SHADER, gl.HIGH_FLOAT);
    const lacks = [
      ...Object.entries(needed).map(([name, least]) => [name, most(name), least]),
      ["bits of a float in a shader", precision ? precision.precision : 0, 23],
    ].filter(([, found, least]) => found < least);
    if (lacks.length) {
      const words = lacks.map(([name, found, least]) => `${name} is ${found}, and ${least} is needed`);
      throw new Refused(`This device's WebGL 2 is too small for the scene: ${words.join("; ")}.`);
    }
  }

  mesh() {
    const { gl, model } = this;
    this.vertices = gl.createVertexArray();
    gl.bindVertexArray(this.vertices);
    const attribute = (place, values, size, kind) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, kind, kind !== gl.FLOAT, 0, 0);
    };
    attribute(0, model.positions, 4, gl.UNSIGNED_SHORT);
    attribute(1, model.normals, 2, gl.UNSIGNED_SHORT);
    attribute(2, model.uv, 2, gl.UNSIGNED_SHORT);
    attribute(3, model.albedo, 3, gl.FLOAT);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, model.faces, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
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

  transferMap({ side, images }) {
    return this.texture(this.gl.TEXTURE_2D_ARRAY, this.gl.LINEAR, (gl) => {
      gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8, side, side, images.length);
      images.forEach((image, layer) => {
        const place = [0, 0, layer, side, side, 1];
        gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, ...place, gl.RGBA, gl.UNSIGNED_BYTE, image);
      });
    });
  }

  // The features of a net, as prtnet/export/grid.py and hash_grid.py lay them out.
  grid({ size, values }) {
    const [width, height, depth] = size;
    const half = values instanceof Uint16Array;
    return this.texture(depth ? this.gl.TEXTURE_3D : this.gl.TEXTURE_2D, this.gl.NEAREST, (gl) => {
      const format = [half ? gl.RGBA16F : gl.RGBA32F, width, height];
      const data = [gl.RGBA, half ? gl.HALF_FLOAT : gl.FLOAT, half ? values : new Float32Array(values.buffer)];
      if (depth) gl.texImage3D(gl.TEXTURE_3D, 0, ...format, depth, 0, ...data);
      else gl.texImage2D(gl.TEXTURE_2D, 0, ...format, 0, ...data);
    });
  }

  // A program by its name, compiled when it is first asked for.
  program(name) {
    if (this.programs[name]) return this.programs[name];
    const texts = {
      depth: () => [SURFACE, DEPTH],
      difference: () => [FRAME, DIFFERENCE],
      points: () => [FRAME, points(this.model)],
      net: () => [SURFACE, method("net", this.model)],
      texture: () => [SURFACE, method("texture", this.model)],
    };
    const started = performance.now();
    const program = this.link(...texts[name]());
    const made = { program, places: {}, milliseconds: performance.now() - started };
    this.gl.useProgram(program);
    for (const [sampler, unit] of Object.entries(UNITS)) this.put(made, "uniform1i", sampler, unit);
    this.grids.forEach((grid, i) => this.put(made, "uniform1i", grid.name, FIRST_GRID + i));
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

  // One frame. `view`: method, split (0 to 1), camera, eye, light, exposure, diffuse, specular, exponent, paint, paper.
  draw(view) {
    const { gl, canvas } = this;
    if (gl.isContextLost()) return;
    if (view.method === "error") {
      this.compare(view);
      return;
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.begin(view, canvas.width, canvas.height, [...view.paper, 1]);
    if (view.method === "split") {
      const bar = Math.round(view.split * canvas.width);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(0, 0, bar, canvas.height);
      this.shade("net", view);
      gl.scissor(bar, 0, canvas.width - bar, canvas.height);
      this.shade("texture", view);
      gl.disable(gl.SCISSOR_TEST);
    } else this.shade(view.method, view);
  }

  // Clears, and leaves the nearest depth of each pixel: what is hidden is then never shaded.
  begin(view, width, height, colour) {
    const gl = this.gl;
    gl.viewport(0, 0, width, height);
    gl.depthMask(true);
    gl.colorMask(true, true, true, true);
    gl.clearColor(...colour);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.bindVertexArray(this.vertices);
    const made = this.program("depth");
    gl.useProgram(made.program);
    this.place(made, view);
    gl.colorMask(false, false, false, false);
    gl.depthFunc(gl.LESS);
    gl.drawElements(gl.TRIANGLES, this.model.faces.length, gl.UNSIGNED_INT, 0);
    gl.colorMask(true, true, true, true);
    gl.depthMask(false);
    gl.depthFunc(gl.LEQUAL);
  }

  place(made, view) {
    this.put(made, "uniformMatrix4fv", "camera", false, view.camera);
    this.put(made, "uniform3fv", "box_low", this.model.box.low);
    this.put(made, "uniform3fv", "box_span", this.model.box.span);
  }

  shade(name, view) {
    const gl = this.gl;
    const made = this.program(name);
    gl.useProgram(made.program);
    gl.bindVertexArray(this.vertices);
    this.place(made, view);
    this.put(made, "uniformMatrix4x3fv", "light", false, view.light);
    this.put(made, "uniform3fv", "eye", view.eye);
    this.put(made, "uniform3fv", "specular", view.specular);
    this.put(made, "uniform4fv", "paint", view.paint);
    for (const key of ["exposure", "diffuse", "exponent"]) this.put(made, "uniform1f", key, view[key]);
    if (name === "net") {
      this.bindGrids();
      gl.drawElements(gl.TRIANGLES, this.model.faces.length, gl.UNSIGNED_INT, 0);
      return;
    }
    this.model.pages.forEach((page, i) => {
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.pages[i]);
      this.put(made, "uniform4fv", "transfer_scale", page.scale);
      this.put(made, "uniform4fv", "transfer_offset", page.offset);
      gl.drawElements(gl.TRIANGLES, 3 * page.count, gl.UNSIGNED_INT, 12 * page.first);
    });
  }

  bindGrids() {
    const gl = this.gl;
    this.grids.forEach(({ texture }, i) => {
      gl.activeTexture(gl.TEXTURE0 + FIRST_GRID + i);
      gl.bindTexture(this.model.grids[i].size[2] ? gl.TEXTURE_3D : gl.TEXTURE_2D, texture);
    });
  }

  // Both methods into float textures, then eight times their difference.
  compare(view) {
    const { gl, canvas } = this;
    const { width, height } = canvas;
    this.targets(width, height);
    ["net", "texture"].forEach((name, i) => {
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.pair.frames[i]);
      this.begin(view, width, height, [...view.paper, 0]);
      this.shade(name, view);
    });
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.DEPTH_TEST);
    const made = this.program("difference");
    gl.useProgram(made.program);
    this.pair.textures.forEach((texture, i) => {
      gl.activeTexture(gl.TEXTURE1 + i);
      gl.bindTexture(gl.TEXTURE_2D, texture);
    });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
  }

  targets(width, height) {
    const gl = this.gl;
    if (this.pair && this.pair.width === width && this.pair.height === height) return;
    if (this.pair) {
      for (const texture of this.pair.textures) gl.deleteTexture(texture);
      for (const frame of this.pair.frames) gl.deleteFramebuffer(frame);
    }
    const depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, width, height);
    const textures = [0, 1].map(() =>
      this.texture(gl.TEXTURE_2D, gl.NEAREST, () => gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA16F, width, height)),
    );
    this.pair = { width, height, textures, frames: textures.map((texture) => this.framebuffer(texture, depth)) };
  }

  framebuffer(texture, depth) {
    const gl = this.gl;
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    if (depth) gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
    return frame;
  }

  // Waits until all that was drawn is there.
  finish() {
    const gl = this.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }
}
