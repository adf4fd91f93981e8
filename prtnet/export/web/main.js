// Starts the page: unpacks, draws what stands beside the network at once and the network as soon as it is compiled, and
// survives the loss of its context. `window.prtnet` is for tests and for whoever opens the console.

import { certify, evaluate } from "./certify.js";
import { Controls } from "./controls.js";
import { Refused, contextOf } from "./device.js";
import { load } from "./model.js";
import { Renderer } from "./renderer.js";
import { turned } from "./sh.js";
import { Viewer } from "./viewer.js";

const about = JSON.parse(document.getElementById("about").textContent);
const message = document.getElementById("message");
const breath = () => new Promise((resume) => setTimeout(resume, 30));

function say(text, kind = "") {
  message.textContent = text;
  message.className = kind;
  message.hidden = !text;
}

function refuse(error) {
  const words = error instanceof Refused ? error.message : `Something went wrong: ${error.message}`;
  say(words, "refusal");
  for (const control of document.querySelectorAll("#controls input, #controls select, #controls button, header button, #certify"))
    control.disabled = true;
  if (!(error instanceof Refused)) console.error(error);
}

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

// Loses and wins back: the browser takes a context away when a driver restarts or a laptop changes graphics cards.
function guard(canvas, viewer) {
  canvas.addEventListener("webglcontextlost", (event) => {
    event.preventDefault();
    say("The graphics context was lost; waiting for it …", "busy");
  });
  canvas.addEventListener("webglcontextrestored", () => {
    try {
      viewer.renderer.build();
      say("");
      viewer.changed();
    } catch (error) {
      refuse(error);
    }
  });
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
