// What the lamp sees of the scene, as depths in the layers of one array (prtnet/export/lamps.py): both sides of every
// face cast shadows, as rays see them.

import { lampUniforms, shadowMatrices } from "./lamp.js";
import { CASTERS, NOTHING } from "./driven_shaders.js";

const LAYERS = 6;

export class ShadowMaps {
  constructor(renderer) {
    this.renderer = renderer;
    const { gl, model } = renderer;
    const { size } = model.shadows;
    this.map = renderer.texture(gl.TEXTURE_2D_ARRAY, gl.LINEAR, () => {
      gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.DEPTH_COMPONENT32F, size, size, LAYERS);
      gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
      gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_COMPARE_FUNC, gl.LEQUAL);
    });
    this.frames = Array.from({ length: LAYERS }, (_, layer) => {
      const frame = gl.createFramebuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
      gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, this.map, 0, layer);
      gl.drawBuffers([gl.NONE]);
      gl.readBuffer(gl.NONE);
      return frame;
    });
  }

  texts() {
    return [CASTERS, NOTHING];
  }

  draw(lamp) {
    const { renderer } = this;
    const { gl, model } = renderer;
    const { size, slope, bias } = model.shadows;
    const made = renderer.program("casters");
    this.matrices = shadowMatrices(lamp, model.casters.box, model.shadows);
    gl.useProgram(made.program);
    gl.viewport(0, 0, size, size);
    gl.disable(gl.CULL_FACE);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(slope, bias);
    this.matrices.forEach((matrix, layer) => {
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.frames[layer]);
      gl.clearBufferfv(gl.DEPTH, 0, [1]);
      renderer.shape.cast(made, matrix);
    });
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.disable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LESS);
    gl.enable(gl.CULL_FACE);
  }

  // The lamp and its maps for a program with prt_direct.
  bind(made, lamp) {
    const { renderer } = this;
    renderer.bind(renderer.units.shadow_map, renderer.gl.TEXTURE_2D_ARRAY, [this.map]);
    renderer.put(made, "uniform1i", "lamp_count", 1);
    for (const [name, value] of Object.entries(lampUniforms(lamp))) renderer.put(made, "uniform4fv", name, value);
    const all = new Float32Array(16 * LAYERS);
    this.matrices.forEach((matrix, layer) => all.set(matrix, 16 * layer));
    renderer.put(made, "uniformMatrix4fv", "shadow_matrix", false, all);
  }
}
