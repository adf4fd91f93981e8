// WebGL 2: one lamp, the light that it throws on the measurement points, and what the operator makes of that. All of it is
// drawn again only for a lamp that changed; frames blend what is known. Draws when told to, and never by itself.

import { indirectAt, lit, measured, reduced } from "./driven_shaders.js";
import { Graphics } from "./graphics.js";
import { Mesh } from "./mesh.js";
import { FRAME } from "./shaders.js";
import { ShadowMaps } from "./shadows.js";

const UNITS = {
  prt_basis: 0, places: 1, finishes: 2, thirds: 3, first: 3, second: 4, shadow_map: 5, reference_map: 6,
  measured_positions: 1, measured_normals: 2, measured_geometric: 3, prt_direct_vector: 1, prt_matrix: 2, checked_uv: 1,
};

export class DrivenRenderer extends Graphics {
  constructor(gl, model) {
    super(gl, model, UNITS, ["learned", "reference"]);
    this.build();
  }

  // Everything that a context holds; again after a lost one is back.
  build() {
    this.begun();
    const { gl, model } = this;
    this.shape = new Mesh(this);
    this.shadows = new ShadowMaps(this);
    this.basis = this.halves(model.basis);
    this.references = model.references.length ? this.halves(model.references) : null;
    this.measured = model.measured.map((values) => this.floats(model.points, model.samples, values));
    this.matrix = this.floats(Math.ceil(model.points / 4), model.banks * model.width, model.matrix);
    this.direct = this.row(model.points);
    this.reduced = this.row(model.width);
    this.lamp = "";
  }

  // Layers of RGBA halves, which every WebGL 2 can blend.
  halves(images) {
    const { side } = this.model;
    return this.texture(this.gl.TEXTURE_2D_ARRAY, this.gl.LINEAR, (gl) => {
      gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA16F, side, side, images.length);
      images.forEach((image, layer) => {
        gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, layer, side, side, 1, gl.RGBA, gl.HALF_FLOAT, image);
      });
    });
  }

  floats(width, height, values) {
    return this.texture(this.gl.TEXTURE_2D, this.gl.NEAREST, (gl) =>
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, width, height, 0, gl.RGBA, gl.FLOAT, values),
    );
  }

  // A target of so many pixels in a row, four floats each as their bits.
  row(width) {
    const { gl } = this;
    const texture = this.texture(gl.TEXTURE_2D, gl.NEAREST, () =>
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32UI, width, 1),
    );
    return { width, texture, frame: this.framebuffer([texture], null) };
  }

  texts(name) {
    const { model } = this;
    if (name === "casters") return this.shadows.texts();
    const others = { measured, reduced, indirectAt };
    return [FRAME, others[name] ? others[name](model) : lit(name, model)];
  }

  // Draws a program into a row of pixels.
  fill({ width, frame }, name, place) {
    const { gl } = this;
    const made = this.program(name);
    gl.useProgram(made.program);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.viewport(0, 0, width, 1);
    gl.bindVertexArray(this.frame);
    place(made);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  // What a row holds: red, green and blue of the first `count` pixels, one after the other.
  read({ width, frame }, count) {
    const { gl } = this;
    const bits = new Uint32Array(4 * width);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.readPixels(0, 0, width, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, bits);
    const values = new Float32Array(bits.buffer);
    return Float32Array.from({ length: 3 * count }, (_, i) => values[4 * Math.floor(i / 3) + (i % 3)]);
  }

  // Maps, direct vector and coefficients of a lamp, where it is not the one that they are of.
  relight(lamp, again = false) {
    const wanted = JSON.stringify(lamp);
    if (wanted === this.lamp && !again) return;
    this.shadows.draw(lamp);
    this.fill(this.direct, "measured", (made) => {
      this.bind(UNITS.measured_positions, this.gl.TEXTURE_2D, this.measured);
      this.shadows.bind(made, lamp);
    });
    this.reduce();
    this.lamp = wanted;
  }

  // u of the direct vector as it stands, on the graphics card and here.
  reduce() {
    this.fill(this.reduced, "reduced", () =>
      this.bind(UNITS.prt_direct_vector, this.gl.TEXTURE_2D, [this.direct.texture, this.matrix]),
    );
    this.coefficients = this.read(this.reduced, this.model.width);
  }

  draw(view) {
    if (this.gl.isContextLost()) return;
    this.relight(view.lamp);
    super.draw(view);
  }

  // The colours of all pixels by one method into what is bound.
  shade(name, view) {
    const { gl } = this;
    const made = this.program(name);
    gl.useProgram(made.program);
    gl.bindVertexArray(this.frame);
    this.bind(UNITS.places, gl.TEXTURE_2D, this.targets.surface.textures);
    this.shadows.bind(made, view.lamp);
    this.bindBasis(made);
    this.bind(UNITS.reference_map, gl.TEXTURE_2D_ARRAY, [this.references]);
    this.put(made, "uniform1f", "reference", view.reference);
    this.put(made, "uniform1f", "exposure", view.exposure);
    this.put(made, "uniform2fv", "parts", view.parts);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  bindBasis(made) {
    this.bind(UNITS.prt_basis, this.gl.TEXTURE_2D_ARRAY, [this.basis]);
    this.put(made, "uniformMatrix4x3fv", "prt_coefficients", false, this.coefficients);
  }
}
