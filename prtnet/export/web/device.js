// What the page asks of a browser, and what it says where that is not there.

export class Refused extends Error {}

export function contextOf(canvas) {
  const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, depth: false, powerPreference: "high-performance" });
  if (!gl) throw new Refused("This page draws with WebGL 2, which this browser does not offer or has turned off.");
  return gl;
}

// Limits that WebGL 2 leaves to the device. Says what is missing.
export function checkLimits(gl, needs) {
  const precision = gl.getShaderPrecisionFormat(gl.FRAGMENT_SHADER, gl.HIGH_FLOAT);
  const lacks = [
    ...Object.entries(needs).map(([name, least]) => [name, gl.getParameter(gl[name]), least]),
    ["bits of a float in a shader", precision ? precision.precision : 0, 23],
  ].filter(([, found, least]) => found < least);
  if (lacks.length) {
    const words = lacks.map(([name, found, least]) => `${name} is ${found}, and ${least} is needed`);
    throw new Refused(`This device's WebGL 2 is too small for the scene: ${words.join("; ")}.`);
  }
}

// The graphics card in the words of its driver.
export function device(gl) {
  const words = gl.getExtension("WEBGL_debug_renderer_info");
  return String(gl.getParameter(words ? words.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
}
