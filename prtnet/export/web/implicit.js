// An implicit surface as the points that pixels show, sphere-traced: the uniforms are those of
// prtnet/export/sphere_tracing.py.

import { marched } from "./methods.js";
import { FRAME } from "./shaders.js";

export class Marched {
  constructor(renderer) {
    this.renderer = renderer;
  }

  texts() {
    return [FRAME, marched(this.renderer.model)];
  }

  // With the program of `texts` into the framebuffer that is bound.
  draw(made, { eye, axes, halves }) {
    const { renderer } = this;
    const { gl, canvas, model } = renderer;
    const { across, upwards, backward } = axes;
    const scaled = (axis, factor) => axis.map((value) => factor * value);
    const away = backward.reduce((sum, value, i) => sum + value * eye[i], 0);
    const ahead = Math.max(0, away - model.radius);
    const columns = [...scaled(across, halves[0]), ...scaled(upwards, halves[1]), ...scaled(backward, -1)];
    renderer.put(made, "uniformMatrix3fv", "prt_window", false, columns);
    renderer.put(made, "uniform3fv", "prt_middle", eye.map((value, i) => value - ahead * backward[i]));
    renderer.put(made, "uniform1f", "prt_ahead", ahead);
    renderer.put(made, "uniform1f", "prt_pixel", (2 * halves[1]) / canvas.height);
    renderer.put(made, "uniform2iv", "prt_steps", model.steps);
    renderer.put(made, "uniform2f", "size", canvas.width, canvas.height);
    gl.bindVertexArray(renderer.frame);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}
