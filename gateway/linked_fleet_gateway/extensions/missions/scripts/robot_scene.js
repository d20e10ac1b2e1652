// The robot of a step in 3D beside the outline, as its page draws it, with the path that a rehearsal has found.

import { drawing, ghost } from "../../pages/scripts/src/ghost.js";
import { whenWanted } from "../../pages/scripts/src/lazy_scene.js";
import { playBar } from "../../pages/scripts/src/planned_path.js";
import { button, element } from "../../pages/scripts/src/elements.js";
import { waypointsOf } from "./rehearsal.js";

export class RobotView {
  constructor(/** @type {HTMLElement} */ place) {
    this.place = place;
    this.robot = "";
    /** @type {import("./rehearsal.js").StepRehearsal[]} */
    this.steps = [];
  }

  /** Show a robot, if it has a model. */
  async show(/** @type {string} */ robot) {
    if (robot === this.robot) return;
    this.robot = robot;
    this.clear();
    const page = await fetchPage(robot);
    const found = page?.querySelector("#scene[data-model]");
    if (!found || this.robot !== robot) return;
    const scene = /** @type {HTMLElement} */ (document.importNode(found, true));
    scene.dataset.lazily = "";
    scene.dataset.robot = robot;
    scene.replaceChildren(element("p", { className: "fallback" }, "The robot in 3D."), button("Show the robot in 3D", () => {}, { hidden: true }));
    scene.addEventListener("drawn", () => this.path());
    this.bar = element("div");
    this.place.replaceChildren(scene, this.bar);
    this.place.hidden = false;
    whenWanted(scene, () => import("../../pages/scripts/src/scene.js").then(({ show }) => show(scene)));
  }

  clear() {
    ghost();
    /** @type {any} */ (drawing())?.dispose?.();
    this.place.replaceChildren();
    this.place.hidden = true;
  }

  /** Keep what a rehearsal has found; nothing after a change of the mission. */
  rehearsed(/** @type {import("./rehearsal.js").StepRehearsal[]} */ steps) {
    this.steps = steps;
    ghost();
    this.path();
  }

  /** Offer to play the path of the robot. */
  path() {
    if (!this.bar) return;
    const now = (name) => drawing()?.robot?.joints[name]?.angle;
    const bar = this.steps.length && drawing() && playBar(waypointsOf(this.steps, this.robot, now));
    this.bar.replaceChildren(...(bar ? [bar] : []));
  }

  /** Show where the robot is after a step. */
  after(/** @type {Map<string, number> | undefined} */ joints) {
    ghost(joints && [...joints.keys()].some((iri) => iri.startsWith(this.robot)) ? joints : undefined);
  }
}

async function fetchPage(iri) {
  try {
    const response = await fetch(iri, { headers: { Accept: "text/html" }, cache: "no-cache" });
    return response.ok ? new DOMParser().parseFromString(await response.text(), "text/html") : undefined;
  } catch {
    return undefined; // what is drawn here is not needed to build a mission
  }
}
