// The form of `reach`: it begins with the tip and where that is, and its target can be dragged in the scene.

import { drawing, ghost } from "./ghost.js";
import { targetsIn } from "./motion.js";
import { applyLimits } from "./limits.js";
import { lf } from "./vocabulary.js";

const MATHS = "http://vocab.arvida.de/2015/06/maths/vocab#";
const METRE = "http://qudt.org/vocab/unit/M";
const UNIT_PATH = "http://vocab.arvida.de/2015/06/vom/vocab#unit";
const AXES = ["x", "y", "z"].map((axis) => MATHS + axis);
const DECIMALS = 4;
const ESCAPED = /~([0-9A-F]{2})/g;

export function start() {
  document.addEventListener("included", ({ target }) => {
    const details = target.closest?.("details[data-reach]");
    if (details) new Reach(details, details.querySelector("form.invoke"));
  });
}

class Reach {
  constructor(details, form) {
    this.details = details;
    this.form = form;
    this.link = form.querySelector(`select[data-path="${lf("ofLink")}"]`);
    this.position = form.querySelector(`fieldset[data-path="${lf("position")}"]`);
    this.orientation = form.querySelector(`fieldset[data-path="${lf("orientation")}"]`);
    if (!this.link || !this.position) return;
    this.link.addEventListener("change", () => this.begin());
    this.position.addEventListener("input", () => this.placed());
    this.offer();
    form.addEventListener("rehearsed", ({ detail }) => ghost(targetsIn(detail)));
    form.addEventListener("over", () => {
      ghost();
      this.begin();
    });
    details.addEventListener("toggle", () => (details.open ? this.begin() : this.end()));
    const scene = document.getElementById("scene");
    if (scene?.dataset.phase === "ready") this.choose();
    else scene?.addEventListener("drawn", () => this.choose(), { once: true });
  }

  /** What is dragged: where the link is to be, or how it is to be turned, which is not asked for unless it was. */
  offer() {
    const modes = [["translate", "Drag the position"], ["rotate", "Turn it"], ["free", "As it comes"]];
    const button = ([mode, text]) => {
      const made = Object.assign(document.createElement("button"), { type: "button", className: "quiet", textContent: text });
      made.onclick = () => this.mode(mode);
      made.dataset.mode = mode;
      return made;
    };
    this.modes = modes.slice(0, this.orientation ? 3 : 1).map(button);
    const bar = Object.assign(document.createElement("p"), { className: "buttons gizmo" });
    bar.append(...this.modes);
    this.form.prepend(bar);
    this.mark("translate");
  }

  mark(mode) {
    for (const each of this.modes) {
      if (each.dataset.mode === "free") each.hidden = !this.turned;
      else each.setAttribute("aria-pressed", String(each.dataset.mode === mode));
    }
  }

  mode(mode) {
    this.turned = mode === "rotate" || (mode === "translate" && this.turned);
    if (mode === "free") this.clear();
    else if (this.turned && this.target) this.write(this.target.pose);
    if (this.target) this.target.mode = mode === "rotate" ? "rotate" : "translate";
    this.mark(mode === "free" ? "translate" : mode);
  }

  /** The tip: the last link of the longest chain, unless somebody has chosen. */
  choose() {
    const names = new Map([...this.link.options].map((option) => [nameOf(option.value), option.value]));
    const tip = drawing()?.tips().findLast((name) => names.has(name));
    if (tip && this.form.dataset.touched === undefined) this.link.value = names.get(tip);
    this.begin();
  }

  begin() {
    const scene = drawing();
    const pose = this.details.open && scene?.section.dataset.phase === "ready" ? scene.poseOf(nameOf(this.link.value)) : undefined;
    if (!pose) return;
    this.target ??= scene.target((dragged, done) => this.dragged(dragged, done));
    this.target.pose = pose;
    this.write(pose);
  }

  end() {
    this.target?.dispose();
    this.target = undefined;
    ghost();
  }

  dragged(pose, done) {
    this.form.dataset.touched = "";
    this.write(pose);
    if (done) this.form.querySelector("button[data-prefer=dry-run]")?.click();
  }

  /** Numbers that were typed move the target in the scene. */
  placed() {
    const numbers = AXES.map((axis) => Number(field(this.position, axis)?.value));
    const scale = field(this.position, UNIT_PATH)?.value === METRE ? 1 : 0.001;
    if (this.target && numbers.every(Number.isFinite)) {
      this.target.pose = { ...this.target.pose, position: numbers.map((value) => value * scale) };
    }
  }

  write({ position, orientation }) {
    set(this.position, UNIT_PATH, METRE);
    AXES.forEach((axis, index) => set(this.position, axis, position[index].toFixed(DECIMALS)));
    if (this.turned) [...AXES, lf("w")].forEach((axis, index) => set(this.orientation, axis, orientation[index].toFixed(DECIMALS)));
    applyLimits(this.form);
  }

  clear() {
    for (const axis of [...AXES, lf("w")]) set(this.orientation, axis, "");
  }
}

function field(fieldset, path) {
  return fieldset?.querySelector(`[data-path="${path}"]`);
}

function set(fieldset, path, value) {
  const control = field(fieldset, path);
  if (control && control.value !== value) control.value = value;
}

/** The name of a link, as the last segment of its IRI spells it. */
function nameOf(iri) {
  const known = [...document.querySelectorAll('a[data-part-kind="link"]')].find((each) => each.href === iri);
  return known?.dataset.part ?? decodeURIComponent(iri.slice(iri.lastIndexOf("/") + 1).replace(ESCAPED, "%$1"));
}
