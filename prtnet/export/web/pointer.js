// Mouse, pen and fingers on the picture: one turns the view, two or Shift move and zoom it.

export function listen(canvas, orbit, { changed, ended }) {
  const fingers = new Map();

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
  });

  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const old = span(fingers);
    const now = [event.clientX, event.clientY];
    fingers.set(event.pointerId, now);
    const [right, down] = [now[0] - before[0], now[1] - before[1]];
    const height = canvas.clientHeight;
    if (fingers.size > 1) {
      const fresh = span(fingers);
      if (fresh.apart > 0) orbit.zoom(old.apart / fresh.apart);
      orbit.pan((fresh.x - old.x) / height, (old.y - fresh.y) / height);
    } else if (event.shiftKey || event.buttons & 6) orbit.pan(right / height, -down / height);
    else orbit.turn((Math.PI * right) / height, (Math.PI * down) / height);
    changed();
  });

  for (const name of ["pointerup", "pointercancel"])
    canvas.addEventListener(name, (event) => {
      fingers.delete(event.pointerId);
      ended();
    });

  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const lines = event.deltaMode === 0 ? 1 : 30;
      orbit.zoom(Math.exp(Math.max(-200, Math.min(200, event.deltaY * lines)) * 0.0015));
      changed();
    },
    { passive: false },
  );
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
}

// Middle and distance of the first two fingers.
function span(fingers) {
  const [a, b = a] = [...fingers.values()];
  return { x: (a[0] + b[0]) / 2, y: (a[1] + b[1]) / 2, apart: Math.hypot(a[0] - b[0], a[1] - b[1]) };
}
