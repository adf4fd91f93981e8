// What the page says over the picture: that it works, that it cannot, and that a lost context is back.

import { Refused } from "./device.js";

const message = document.getElementById("message");
export const breath = () => new Promise((resume) => setTimeout(resume, 30));

export function say(text, kind = "") {
  message.textContent = text;
  message.className = kind;
  message.hidden = !text;
}

export function refuse(error) {
  const words = error instanceof Refused ? error.message : `Something went wrong: ${error.message}`;
  say(words, "refusal");
  for (const control of document.querySelectorAll("#controls input, #controls select, #controls button, header button, #certify"))
    control.disabled = true;
  if (!(error instanceof Refused)) console.error(error);
}

// Loses and wins back: the browser takes a context away when a driver restarts or a laptop changes graphics cards.
export function guard(canvas, viewer) {
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
