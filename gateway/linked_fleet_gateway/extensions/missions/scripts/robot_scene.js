// The robot of a step in 3D beside the outline, as its page draws it, with the path that a rehearsal has found.

import { say } from "../../pages/scripts/src/say.js";
import { drawing, ghost } from "../../pages/scripts/src/ghost.js";
import { drawScene, sceneOf } from "../../pages/scripts/src/other_scene.js";
import { playBar } from "../../pages/scripts/src/planned_path.js";
import { element } from "../../pages/scripts/src/elements.js";
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
    const scene = await sceneOf(robot);
    if (!scene || this.robot !== robot) return;
    scene.addEventListener("drawn", () => this.path());
    this.bar = element("div");
    this.place.replaceChildren(scene, this.bar);
    this.place.hidden = false;
    drawScene(scene);
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
