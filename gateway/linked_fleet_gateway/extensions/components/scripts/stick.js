// A stick: a pad for touch and mouse, the keys W A S D (and Q E sideways), arrows, and gamepads.

const DEAD = 0.12; // of a gamepad's axes at rest
const KEYS = {
  KeyW: ["linear", 1], ArrowUp: ["linear", 1], KeyS: ["linear", -1], ArrowDown: ["linear", -1],
  KeyA: ["angular", 1], ArrowLeft: ["angular", 1], KeyD: ["angular", -1], ArrowRight: ["angular", -1],
  KeyQ: ["lateral", 1], KeyE: ["lateral", -1],
};

export class Stick {
  /** @param {HTMLElement} pad @param {HTMLElement} section whose keys are heard */
  constructor(pad, section) {
    this.pad = pad;
    this.knob = /** @type {HTMLElement} */ (pad.querySelector(".knob"));
    this.pressed = new Set();
    this.active = false;
    pad.addEventListener("pointerdown", (event) => this.grip(event));
    pad.addEventListener("pointermove", (event) => this.pointer === event.pointerId && this.follow(event));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) pad.addEventListener(end, () => this.release());
    section.addEventListener("keydown", (event) => this.key(event, true));
    section.addEventListener("keyup", (event) => this.key(event, false));
    for (const away of ["blur", "visibilitychange"]) addEventListener(away, () => this.release());
    section.addEventListener("focusout", ({ relatedTarget }) => section.contains(/** @type {Node | null} */ (relatedTarget)) || this.pressed.clear());
  }

  enable() {
    this.active = true;
    this.pad.focus();
  }

  disable() {
    this.active = false;
    this.release();
  }

  /** @returns {{linear: number, lateral: number, angular: number}} from -1 to 1: forward, to the left, counterclockwise */
  value() {
    if (!this.active) return { linear: 0, lateral: 0, angular: 0 };
    const found = { ...(this.held ?? { linear: 0, lateral: 0, angular: 0 }) };
    for (const code of this.pressed) found[KEYS[code][0]] += KEYS[code][1];
    for (const pad of navigator.getGamepads?.() ?? []) {
      if (!pad?.connected) continue;
      found.linear -= alive(pad.axes[1]);
      found.angular -= alive(pad.axes[0]);
      found.lateral -= alive(pad.axes[2]);
    }
    for (const name of Object.keys(found)) found[name] = Math.max(-1, Math.min(1, found[name]));
    if (!this.held) this.place(-found.angular, -found.linear);
    return found;
  }

  grip(event) {
    if (!this.active || this.pointer !== undefined) return;
    event.preventDefault();
    this.pointer = event.pointerId;
    this.pad.setPointerCapture(event.pointerId);
    this.pad.focus();
    this.follow(event);
  }

  follow({ clientX, clientY }) {
    const box = this.pad.getBoundingClientRect();
    const [x, y] = [(2 * (clientX - box.left)) / box.width - 1, (2 * (clientY - box.top)) / box.height - 1];
    const far = Math.max(1, Math.hypot(x, y));
    this.held = { linear: -y / far, lateral: 0, angular: -x / far };
    this.place(x / far, y / far);
  }

  release() {
    this.pointer = this.held = undefined;
    this.pressed.clear();
    this.place(0, 0);
  }

  key(event, down) {
    if (!this.active || !(event.code in KEYS) || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.target.matches?.("input") && event.code.startsWith("Arrow")) return; // of the speed
    event.preventDefault();
    if (down) this.pressed.add(event.code);
    else this.pressed.delete(event.code);
  }

  place(x, y) {
    this.knob.style.setProperty("--x", String(x));
    this.knob.style.setProperty("--y", String(y));
  }
}

function alive(axis = 0) {
  return Math.abs(axis) < DEAD ? 0 : axis;
}
