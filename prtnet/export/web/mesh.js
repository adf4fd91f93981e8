// The triangles of a scene as the points that pixels show.

import { VERTICES, surface } from "./shaders.js";

export class Mesh {
  constructor(renderer) {
    this.renderer = renderer;
    const { gl, model } = renderer;
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
    if (model.takes_uv) attribute(4, model.netUv, 2, gl.UNSIGNED_SHORT);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, model.faces, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
  }

  texts() {
    return [VERTICES, surface(this.renderer.model)];
  }

  // With the program of `texts` into the framebuffer that is bound.
  draw(made, view) {
    const { renderer } = this;
    const { gl, model } = renderer;
    gl.enable(gl.DEPTH_TEST);
    gl.bindVertexArray(this.vertices);
    renderer.put(made, "uniformMatrix4fv", "camera", false, view.camera);
    renderer.put(made, "uniform3fv", "box_low", model.box.low);
    renderer.put(made, "uniform3fv", "box_span", model.box.span);
    model.pages.forEach((page, i) => {
      renderer.put(made, "uniform1ui", "page", i);
      gl.drawElements(gl.TRIANGLES, 3 * page.count, gl.UNSIGNED_INT, 12 * page.first);
    });
    gl.disable(gl.DEPTH_TEST);
  }

  // The triangles that cast shadows, as a lamp's matrix has them, into the depths that are bound.
  cast(made, shadow) {
    const { renderer } = this;
    const { gl, model } = renderer;
    gl.bindVertexArray(this.vertices);
    renderer.put(made, "uniformMatrix4fv", "shadow", false, shadow);
    renderer.put(made, "uniform3fv", "box_low", model.box.low);
    renderer.put(made, "uniform3fv", "box_span", model.box.span);
    gl.drawElements(gl.TRIANGLES, 3 * model.casters.count, gl.UNSIGNED_INT, 0);
  }
}
