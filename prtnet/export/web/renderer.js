// WebGL 2: the scene as surface points of pixels, then their colours by each method, split or compared. Draws when told
// to, and never by itself.

import { Graphics } from "./graphics.js";
import { Marched } from "./implicit.js";
import { Mesh } from "./mesh.js";
import { method, points } from "./methods.js";
import { FRAME } from "./shaders.js";

const UNITS = {
  transfer_map: 0, places: 1, finishes: 2, thirds: 3, first: 3, second: 4, positions: 1, normals: 2, uvs: 3,
};
const FIRST_IMAGE = 5;

export class Renderer extends Graphics {
  constructor(gl, model) {
    super(gl, model, UNITS, ["net", model.other]);
    this.build();
  }

  // Everything that a context holds; again after a lost one is back.
  build() {
    this.begun();
    this.shape = this.model.functions.surface ? new Marched(this) : new Mesh(this);
    this.pages = this.model.pages.map((page) => this.transferMap(page));
    this.images = this.model.images.map((image) => this.image(image));
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

  // What a net reads, as prtnet/export/grid.py, hash_grid.py, texel_grid.py and weight_texture.py lay it out.
  image({ size, values }) {
    const [width, height, depth] = size;
    const half = values instanceof Uint16Array;
    return this.texture(depth ? this.gl.TEXTURE_3D : this.gl.TEXTURE_2D, this.gl.NEAREST, (gl) => {
      const format = [half ? gl.RGBA16F : gl.RGBA32F, width, height];
      const data = [gl.RGBA, half ? gl.HALF_FLOAT : gl.FLOAT, half ? values : new Float32Array(values.buffer)];
      if (depth) gl.texImage3D(gl.TEXTURE_3D, 0, ...format, depth, 0, ...data);
      else gl.texImage2D(gl.TEXTURE_2D, 0, ...format, 0, ...data);
    });
  }

  texts(name) {
    return [FRAME, name === "points" ? points(this.model) : method(name, this.model)];
  }

  program(name) {
    const known = name in this.programs;
    const made = super.program(name);
    if (!known) this.model.images.forEach(({ name }, i) => this.put(made, "uniform1i", name, FIRST_IMAGE + i));
    return made;
  }

  // The colours of all pixels by one method into what is bound. `view` has light, diffuse, specular, exponent and paint.
  shade(name, view) {
    const { gl, model } = this;
    const made = this.program(name);
    gl.useProgram(made.program);
    gl.bindVertexArray(this.frame);
    this.bind(UNITS.places, gl.TEXTURE_2D, this.targets.surface.textures);
    this.put(made, "uniformMatrix4x3fv", "light", false, view.light);
    this.put(made, "uniform3fv", "eye", view.eye);
    this.put(made, "uniform3fv", "specular", view.specular);
    this.put(made, "uniform4fv", "paint", view.paint);
    for (const key of ["exposure", "diffuse", "exponent"]) this.put(made, "uniform1f", key, view[key]);
    if (name !== "texture") {
      this.bindImages();
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      return;
    }
    model.pages.forEach((page, i) => {
      this.bind(UNITS.transfer_map, gl.TEXTURE_2D_ARRAY, [this.pages[i]]);
      this.put(made, "uniform4fv", "transfer_scale", page.scale);
      this.put(made, "uniform4fv", "transfer_offset", page.offset);
      this.put(made, "uniform1ui", "page", i);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    });
  }

  bindImages() {
    const gl = this.gl;
    this.images.forEach((texture, i) => {
      gl.activeTexture(gl.TEXTURE0 + FIRST_IMAGE + i);
      gl.bindTexture(this.model.images[i].size[2] ? gl.TEXTURE_3D : gl.TEXTURE_2D, texture);
    });
  }
}
