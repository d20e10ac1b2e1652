// Labels above the robots of a drawing, with data from the cards of the page; they are links, usable by keyboard.

import { say } from "../../pages/scripts/src/say.js";
import { watch } from "../../pages/scripts/src/socket.js";
import { lf, localName, taskName } from "../../pages/scripts/src/vocabulary.js";

const LONGEST_MS = 3000;
const GAP_PX = 2;

export class Labels {
  /**
   * @param {HTMLElement} frame around the canvas
   * @param {import("../../pages/scripts/src/scene_view.js").View} view
   * @param {(iri: string) => void} follow has the camera follow a robot
   */
  constructor(frame, view, follow) {
    this.view = view;
    this.follow = follow;
    /** @type {WeakMap<HTMLElement, {text: string, width: number, height: number}>} */
    this.sizes = new WeakMap();
    this.box = Object.assign(document.createElement("div"), { className: "scene-names" });
    frame.append(this.box);
    /** @type {Map<import("./scene_standing.js").Standing, HTMLElement>} */
    this.of = new Map();
    /** The first message about the fleet, or its absence: a reader may not be allowed to subscribe. */
    this.first = new Promise((resolve) => {
      this.heard = resolve;
      setTimeout(resolve, LONGEST_MS);
    });
    view.ending.signal.addEventListener("abort", watch(document.body.dataset.root, {}, (graph) => this.tell(graph)));
  }

  add(robot) {
    const link = Object.assign(document.createElement("a"), { href: robot.iri, textContent: robot.name, title: say("{title} (F: follow it)", { title: robot.title }), hidden: true });
    link.setAttribute("aria-keyshortcuts", "f");
    link.addEventListener("keydown", (event) => {
      if (event.key !== "f" || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      this.follow(robot.iri);
    });
    const said = Object.assign(document.createElement("small"), { className: "said" });
    link.append(said);
    this.of.set(robot, link);
    this.box.append(link);
    for (const graph of this.known ?? []) this.write(robot, graph);
  }

  remove(robot) {
    this.of.get(robot)?.remove();
    this.of.delete(robot);
  }

  /** Show presence and task from the last message about the fleet. */
  tell(graph) {
    this.known = [graph];
    for (const robot of this.of.keys()) this.write(robot, graph);
    this.heard();
  }

  write(robot, graph) {
    const presence = graph.value(robot.iri, lf("presence"))?.value;
    if (!presence) return;
    const label = this.of.get(robot);
    const task = graph.value(robot.iri, lf("currentTask"))?.value;
    const state = localName(presence);
    const text = [say(state), task ? taskName(task) : ""].filter(Boolean).join(" · ");
    label.dataset.state = state;
    robot.presence(state);
    if (label.lastChild.textContent !== text) label.lastChild.textContent = text;
  }

  /** Place each label above its robot in the present view: the nearest first, others above labels that they would cover. */
  place() {
    const { clientWidth, clientHeight } = this.view.canvas;
    const seen = [...this.of].map(([robot, label]) => ({ label, at: robot.top()?.project(this.view.camera) }));
    const taken = [];
    for (const { label, at } of seen.sort((one, other) => (one.at?.z ?? 2) - (other.at?.z ?? 2))) {
      const outside = !at || Math.abs(at.x) > 1 || Math.abs(at.y) > 1 || at.z > 1;
      label.hidden = outside;
      if (outside) continue;
      const { width, height } = this.size(label);
      const x = Math.min(Math.max(((at.x + 1) / 2) * clientWidth, width / 2), clientWidth - width / 2);
      // A robot that fills the view has its label at the upper edge.
      const above = Math.max(((1 - at.y) / 2) * clientHeight, height);
      const bottom = free({ left: x - width / 2, right: x + width / 2, bottom: above, height }, taken);
      label.hidden = bottom < height;
      if (label.hidden) continue;
      taken.push({ left: x - width / 2, right: x + width / 2, top: bottom - height, bottom });
      label.style.translate = `${x}px ${bottom}px`;
    }
  }

  /** Return the size of a label in pixels. It is measured only when the text has changed, because that lays out the page. */
  size(label) {
    const known = this.sizes.get(label);
    if (known?.text === label.textContent && known.width) return known;
    const size = { text: label.textContent, width: label.offsetWidth, height: label.offsetHeight };
    this.sizes.set(label, size);
    return size;
  }
}

/** @returns {number} the lowest bottom edge, at or above that of the box, with which it overlaps no taken box */
function free({ left, right, bottom, height }, taken) {
  const beside = taken.filter((each) => left < each.right && each.left < right);
  for (const each of beside.sort((one, other) => other.bottom - one.bottom)) {
    if (bottom > each.top && bottom - height < each.bottom) bottom = each.top - GAP_PX;
  }
  return bottom;
}
