// The robot of a step in 3D beside the outline, as its page draws it, with the path that a rehearsal has found.

import { say } from "../../pages/scripts/src/say.js";
import { drawing, ghost } from "../../pages/scripts/src/ghost.js";
import { drawScene, sceneOf } from "../../pages/scripts/src/other_scene.js";
import { playBar } from "../../pages/scripts/src/planned_path.js";
import { element } from "../../pages/scripts/src/elements.js";
import { pathOf } from "./rehearsal.js";

export class RobotView {
  constructor(/** @type {HTMLElement} */ place) {
    this.place = place;
    this.robot = "";
    /** @type {import("./rehearsal.js").StepRehearsal[]} */
    this.steps = [];
    /** @type {ReturnType<typeof pathOf>} */
    this.waypoints = [];
  }

  /** Show a robot, if it has a model. */
  async show(/** @type {string} */ robot) {
    if (robot === this.robot) return;
    this.robot = robot;
    this.clear();
    const scene = await sceneOf(robot);
    if (!scene || this.robot !== robot) return;
    scene.addEventListener("drawn", () => this.path());
    this.controls = element("div");
    this.place.replaceChildren(scene, this.controls);
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
    this.step = undefined;
    this.path();
  }

  /** Offer to play the path of the robot. */
  path() {
    if (!this.controls) return;
    const { robot, section } = drawing() ?? {};
    const isDrawn = section?.dataset.phase === "ready"; // before that its joints are not where those of the robot are
    this.waypoints = isDrawn && this.steps.length ? pathOf(this.steps, this.robot, (name) => robot.joints[name]?.angle) : [];
    this.bar = playBar(this.waypoints);
    this.controls.replaceChildren(...(this.bar ? [this.bar] : []));
    this.after(this.step);
  }

  /** Show where the robot is after a step, if that moves it. */
  after(/** @type {string | undefined} */ step) {
    this.step = step;
    const end = step === undefined ? undefined : this.waypoints.findLast((each) => each.step === step);
    if (end && this.bar) this.bar.show(end.atTime);
    else ghost();
  }
}
