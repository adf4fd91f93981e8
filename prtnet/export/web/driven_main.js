// Starts the page, and survives the loss of its context. `window.prtnet` is for tests and for whoever opens the console.

import { contextOf } from "./device.js";
import { certify, evaluate } from "./driven_certify.js";
import { DrivenControls } from "./driven_controls.js";
import { load } from "./driven_model.js";
import { DrivenRenderer } from "./driven_renderer.js";
import { DrivenViewer } from "./driven_viewer.js";
import { lampUniforms, shadowMatrices } from "./lamp.js";
import { breath, guard, refuse, say } from "./notice.js";

const about = JSON.parse(document.getElementById("about").textContent);
const percent = (share) => `${(100 * share).toPrecision(2)} %`;
const power = (share) => share.toExponential(1);

function spoken({ lights, texels, errors, device, browser }) {
  return (
    `under ${lights} lights, coefficients differ from NumPy's by at most ${power(errors.coefficients)} of the largest, ` +
    `${texels} texels by ${power(errors.texels)}; direct light by shadow maps is ${percent(errors.direct)} from that of ` +
    `rays at most, which makes ${percent(errors.shown)} of the light between surfaces (${browser ? `${browser}, ` : ""}${device}).`
  );
}

function certificate() {
  const words = about.certificate ? `Measured: ${spoken(about.certificate)}` : `Not measured in a browser: ${about.unmeasured}.`;
  document.getElementById("certificate").textContent = words;
}

function checked(viewer) {
  const found = certify(viewer.renderer);
  viewer.changed();
  return spoken(found);
}

async function start() {
  certificate();
  const canvas = document.getElementById("view");
  const renderer = new DrivenRenderer(contextOf(canvas), await load(about));
  const viewer = new DrivenViewer(renderer, about);
  viewer.failed = refuse;
  guard(canvas, viewer);
  say("Compiling …", "busy");
  await breath();
  const compiling = performance.now();
  // one frame to compile, one to see how long the device takes
  viewer.detail = 0.3;
  viewer.draw();
  const compile = performance.now() - compiling;
  viewer.draw();
  say("");
  const controls = new DrivenControls(viewer, { certify: () => checked(viewer) });
  viewer.changed();
  Object.assign(window.prtnet, {
    viewer,
    controls,
    renderer,
    lampUniforms,
    shadowMatrices: (lamp) => shadowMatrices(lamp, about.casters.box, about.shadows).map((matrix) => [...matrix]),
    evaluate: (given) => evaluate(renderer, given),
    certify: () => certify(renderer),
    first_ms: performance.now(),
    compile_ms: compile,
  });
}

window.prtnet = { about };
window.prtnet.ready = start().catch(refuse);
