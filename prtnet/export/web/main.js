// Starts the page: unpacks, draws what stands beside the network at once and the network as soon as it is compiled, and
// survives the loss of its context. `window.prtnet` is for tests and for whoever opens the console.

import { certify, evaluate } from "./certify.js";
import { Controls } from "./controls.js";
import { contextOf } from "./device.js";
import { load } from "./model.js";
import { breath, guard, refuse, say } from "./notice.js";
import { Renderer } from "./renderer.js";
import { turned } from "./sh.js";
import { Viewer } from "./viewer.js";

const about = JSON.parse(document.getElementById("about").textContent);

function certificate() {
  const found = about.certificate;
  const words = found
    ? `Measured: at ${found.points.toLocaleString("en")} random points the network here differs from NumPy's by at most ` +
      `${found.error_max.toExponential(1)} in a coefficient, ${found.error_mean.toExponential(1)} on average ` +
      `(${found.browser}, ${found.device}).`
    : `Not measured in a browser: ${about.unmeasured}.`;
  document.getElementById("certificate").textContent = words;
}

function checked(renderer) {
  const found = certify(renderer);
  const mean = found.error_mean.toExponential(1);
  return `${found.device}: at most ${found.error_max.toExponential(1)}, ${mean} on average, over ${found.points} points.`;
}

async function start() {
  certificate();
  const canvas = document.getElementById("view");
  const gl = contextOf(canvas);
  const renderer = new Renderer(gl, await load(about));
  const viewer = new Viewer(renderer, about);
  viewer.failed = refuse;
  guard(canvas, viewer);
  // few pixels, so that there is something to look at however slow the device is
  viewer.state.method = about.other;
  viewer.detail = 0.5;
  viewer.draw();
  const first = performance.now();
  say("Compiling the network …", "busy");
  await breath();
  const compiling = performance.now();
  viewer.state.method = "split";
  // one frame to compile, one to see how long the device takes
  viewer.detail = 0.2;
  viewer.draw();
  const compile = performance.now() - compiling;
  viewer.draw();
  say("");
  const controls = new Controls(viewer, { certify: () => checked(renderer) });
  viewer.changed();
  Object.assign(window.prtnet, {
    viewer,
    controls,
    renderer,
    turned: (light, degrees) => turned(light, degrees, about.upright),
    evaluate: (...point) => evaluate(renderer, ...point),
    certify: () => certify(renderer),
    first_ms: first,
    compile_ms: compile,
  });
}

window.prtnet = { about };
window.prtnet.ready = start().catch(refuse);
