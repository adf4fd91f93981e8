// The lamp, and what it points at, as handles on the picture: dragged along it, with Shift nearer and farther.

const EDGE = 15; // CSS pixels

export class Handles {
  // `moved(name, point)`: a handle is somewhere else.
  constructor(viewer, stage, moved) {
    this.viewer = viewer;
    this.moved = moved;
    this.all = { position: this.handle("lamp", "The lamp"), target: this.handle("aim", "What the lamp points at") };
    for (const [name, handle] of Object.entries(this.all)) {
      stage.append(handle);
      this.listen(handle, name);
    }
  }

  handle(id, words) {
    const handle = document.createElement("button");
    Object.assign(handle, { type: "button", id, className: "handle", title: `${words}: drag, with Shift nearer and farther` });
    handle.setAttribute("aria-label", handle.title);
    return handle;
  }

  listen(handle, name) {
    let last = null;
    const by = (right, down, deep) => this.moved(name, this.viewer.dragged(this.viewer.state[name], right, down, deep));
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      last = [event.clientX, event.clientY];
    });
    handle.addEventListener("pointermove", (event) => {
      if (!last || !handle.hasPointerCapture(event.pointerId)) return;
      const now = [event.clientX, event.clientY];
      by(now[0] - last[0], now[1] - last[1], event.shiftKey);
      last = now;
    });
    for (const end of ["pointerup", "pointercancel"])
      handle.addEventListener(end, () => {
        last = null;
        this.viewer.changed();
      });
    handle.addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: [-8, 0], ArrowRight: [8, 0], ArrowUp: [0, -8], ArrowDown: [0, 8] }[event.key];
      if (!steps) return;
      by(...steps, event.shiftKey);
      event.preventDefault();
      event.stopPropagation();
    });
  }

  // Where the state has them; at the edge of the picture where they are beyond it.
  place() {
    const { state, renderer } = this.viewer;
    const { clientWidth, clientHeight } = renderer.canvas;
    const within = (value, length) => Math.min(length - EDGE, Math.max(EDGE, value)).toFixed(1);
    for (const [name, handle] of Object.entries(this.all)) {
      const found = this.viewer.placed(state[name]);
      handle.hidden = !found || (name === "target" && state.kind === "point");
      if (found) handle.style.transform = `translate(${within(found.x, clientWidth)}px, ${within(found.y, clientHeight)}px)`;
    }
    this.all.position.style.setProperty("--hue", this.viewer.hex);
  }
}
