// Names of robots over a drawing, with what the cards of the page say of them: links, which a keyboard reaches too.

import { watch } from "./socket.js";
import { lf, localName, taskName } from "./vocabulary.js";

const LONGEST_MS = 3000;

export class Labels {
  /**
   * @param {HTMLElement} frame around the canvas
   * @param {import("./scene_view.js").View} view
   */
  constructor(frame, view) {
    this.view = view;
    this.box = Object.assign(document.createElement("div"), { className: "scene-names" });
    frame.append(this.box);
    /** @type {Map<import("./scene_standing.js").Standing, HTMLElement>} */
    this.of = new Map();
    /** The first message about the fleet, or that none has come: who may read need not be allowed to subscribe. */
    this.first = new Promise((resolve) => {
      this.heard = resolve;
      setTimeout(resolve, LONGEST_MS);
    });
    view.ending.signal.addEventListener("abort", watch(document.body.dataset.root, {}, (graph) => this.tell(graph)));
  }

  add(robot) {
    const link = Object.assign(document.createElement("a"), { href: robot.iri, textContent: robot.name, title: robot.title, hidden: true });
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

  /** Presence and task, as the last message about the fleet says. */
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
    const text = [state, task ? taskName(task) : ""].filter(Boolean).join(" · ");
    label.dataset.state = state;
    robot.presence(state);
    if (label.lastChild.textContent !== text) label.lastChild.textContent = text;
  }

  /** Put each over its robot, as it is seen at present. */
  place() {
    const { clientWidth, clientHeight } = this.view.canvas;
    for (const [robot, label] of this.of) {
      const at = robot.top()?.project(this.view.camera);
      label.hidden = !at || Math.abs(at.x) > 1 || Math.abs(at.y) > 1 || at.z > 1;
      if (!label.hidden) label.style.translate = `${((at.x + 1) / 2) * clientWidth}px ${((1 - at.y) / 2) * clientHeight}px`;
    }
  }
}
