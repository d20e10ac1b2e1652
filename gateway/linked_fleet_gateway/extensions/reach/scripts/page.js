// The form of `reach`: it follows the pose of the tip until a target is set, which can be dragged in the scene.

import { say } from "../../pages/scripts/src/say.js";
import { drawing, ghost } from "../../pages/scripts/src/ghost.js";
import { targetsIn } from "../../pages/scripts/src/motion.js";
import { applyLimits } from "../../pages/scripts/src/limits.js";
import { PoseFields } from "../../pages/scripts/src/pose_fields.js";
import { onJoints } from "../../pages/scripts/src/robot_state.js";
import { lf } from "../../pages/scripts/src/vocabulary.js";

const ESCAPED = /~([0-9A-F]{2})/g;
const FOLLOW_MS = 200;

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
    this.fields = new PoseFields(form);
    if (!this.link || !this.fields.position) return;
    this.link.addEventListener("change", () => this.begin());
    this.fields.position.addEventListener("input", () => this.placed());
    this.offer();
    form.addEventListener("rehearsed", ({ detail }) => ghost(targetsIn(detail)));
    form.addEventListener("submit", ({ submitter }) => (this.sent = submitter?.dataset.prefer !== "dry-run"));
    form.addEventListener("over", () => {
      ghost();
      this.begin();
    });
    const forget = onJoints((_, values) => {
      this.values = values;
      if (!form.isConnected) forget?.();
      else this.measured();
    });
    details.addEventListener("toggle", () => (details.open ? this.begin() : this.end()));
    const scene = document.getElementById("scene");
    if (scene?.dataset.phase === "ready") this.choose();
    else scene?.addEventListener("drawn", () => this.choose(), { once: true });
  }

  /** Buttons for dragging the position or the orientation, which is only requested if it was changed. */
  offer() {
    const modes = [["translate", say("Drag the position")], ["rotate", say("Turn it")], ["free", say("As it comes")]];
    const button = ([mode, text]) => {
      const made = Object.assign(document.createElement("button"), { type: "button", className: "quiet", textContent: text });
      made.onclick = () => this.mode(mode);
      made.dataset.mode = mode;
      return made;
    };
    this.modes = modes.slice(0, this.fields.orientation ? 3 : 1).map(button);
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
    if (mode === "free") this.fields.clearOrientation();
    else if (this.turned && this.target) this.write(this.target.pose);
    if (this.target) this.target.mode = mode === "rotate" ? "rotate" : "translate";
    this.mark(mode === "free" ? "translate" : mode);
  }

  /** The tip: the last link of the longest chain, unless another one was chosen. */
  choose() {
    const names = new Map([...this.link.options].map((option) => [nameOf(option.value), option.value]));
    const tip = drawing()?.tips().findLast((name) => names.has(name));
    if (tip && this.form.dataset.touched === undefined) this.link.value = names.get(tip);
    this.begin();
  }

  /** Show where the robot is, unless a target is set or is being reached, or a field is being edited. */
  measured() {
    const now = performance.now();
    const edited = this.form.contains(document.activeElement) && document.activeElement.matches("input, select, textarea");
    if (this.sent || edited || this.target?.busy || this.form.dataset.touched !== undefined) return;
    if (now - (this.shownMs ?? -Infinity) < FOLLOW_MS) return;
    this.shownMs = now;
    this.begin();
  }

  /** Show the present pose of the link, as measured. */
  begin() {
    this.sent = false;
    const scene = drawing();
    const ready = this.details.open && scene?.section.dataset.phase === "ready";
    const pose = ready ? scene.poseOf(nameOf(this.link.value), this.values) : undefined;
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

  /** Move the target in the scene after numbers were typed. */
  placed() {
    const position = this.fields.readPosition();
    if (this.target && position) this.target.pose = { ...this.target.pose, position };
  }

  write({ position, orientation }) {
    this.fields.writePosition(position);
    if (this.turned) this.fields.writeOrientation(orientation);
    applyLimits(this.form);
  }
}

/** Return the name of a link, as in the last segment of its IRI. */
function nameOf(iri) {
  const known = [...document.querySelectorAll('a[data-part-kind="link"]')].find((each) => each.href === iri);
  return known?.dataset.part ?? decodeURIComponent(iri.slice(iri.lastIndexOf("/") + 1).replace(ESCAPED, "%$1"));
}
