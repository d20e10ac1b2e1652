// Buttons that mean something for as long as they are held: by touch, mouse, or the space bar and enter.

const KEYS = ["Space", "Enter"];

export class HeldButtons {
  /** @param {HTMLElement} section whose elements with the attribute ``data-hold`` these are */
  constructor(section) {
    this.held = new Map();
    this.section = section;
    for (const begin of ["pointerdown", "keydown"]) section.addEventListener(begin, (event) => this.begin(event));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) section.addEventListener(end, (/** @type {any} */ event) => this.end(`pointer ${event.pointerId}`));
    section.addEventListener("keyup", (event) => this.end(event.code));
    section.addEventListener("contextmenu", (event) => event.target.closest("[data-hold]") && event.preventDefault());
    for (const away of ["blur", "visibilitychange"]) addEventListener(away, () => this.release());
    section.addEventListener("focusout", () => KEYS.forEach((code) => this.end(code)));
    this.disable();
  }

  enable() {
    this.able(true);
  }

  disable() {
    this.able(false);
    this.release();
  }

  /** @returns {string[]} what is held */
  value() {
    return [...this.held.values()].map((button) => button.dataset.hold);
  }

  able(active) {
    for (const button of this.section.querySelectorAll("[data-hold]")) /** @type {HTMLButtonElement} */ (button).disabled = !active;
  }

  begin(event) {
    const button = event.target.closest("[data-hold]");
    const isKey = event.type === "keydown";
    if (!button || button.disabled || (isKey ? !KEYS.includes(event.code) : event.button !== 0)) return;
    event.preventDefault();
    button.focus();
    if (!isKey) button.setPointerCapture(event.pointerId);
    this.end(isKey ? event.code : `pointer ${event.pointerId}`);
    this.held.set(isKey ? event.code : `pointer ${event.pointerId}`, button);
    button.classList.add("held");
  }

  end(what) {
    this.held.get(what)?.classList.remove("held");
    this.held.delete(what);
  }

  release() {
    for (const what of [...this.held.keys()]) this.end(what);
  }
}
