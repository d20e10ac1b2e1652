// The outline of a mission: nested lists of steps, which are moved by pointer and by keys.

import { say } from "../../pages/scripts/src/say.js";
import { button, element } from "../../pages/scripts/src/elements.js";
import { KINDS, find, holdsSteps, placeFor, walk } from "./mission_tree.js";
import { summary } from "./summary.js";

const WAYS = { ArrowUp: "up", ArrowDown: "down", ArrowLeft: "out", ArrowRight: "in" };
const EDGE = 70; // pixels from the edge of the window, where it scrolls while a step is dragged

export class Outline {
  /**
   * @param {HTMLElement} place
   * @param {import("./builder.js").Builder} builder
   */
  constructor(place, builder) {
    this.place = place;
    this.builder = builder;
    place.addEventListener("keydown", (event) => this.key(event));
    place.addEventListener("pointerdown", (event) => this.grab(event));
  }

  render() {
    const { mission } = this.builder;
    this.place.replaceChildren(element("ol", { className: "steps", "aria-label": say("Steps") }, this.item(mission.root, "0")));
  }

  item(node, path) {
    const { selected, marks } = this.builder;
    const { errors = [], note = "" } = marks.get(node.id) ?? {};
    const isRoot = path === "0";
    const press = button("", () => this.builder.select(node.id), { className: "quiet step", "aria-pressed": String(selected === node.id) });
    press.append(element("span", { className: "kind" }, KINDS[node.type]), " ", element("bdi", {}, summary(node)));
    const row = element("div", { className: "step-row" }, !isRoot && element("span", { className: "grip", "aria-hidden": "true", title: say("Drag it elsewhere") }, "⠿"), press);
    if (note) row.append(element("small", { className: "note" }, note));
    for (const each of errors) row.append(element("small", { className: "error" }, each));
    if (errors.length) row.dataset.wrong = "";
    const item = element("li", {}, row);
    item.dataset.id = String(node.id);
    if (holdsSteps(node)) {
      const below = node.below.map((each, index) => this.item(each, `${path}.${index}`));
      item.append(below.length ? element("ol", {}, ...below) : element("p", { className: "empty" }, say("No step yet.")));
    }
    return item;
  }

  focus(/** @type {number} */ id) {
    /** @type {HTMLElement | null} */ (this.place.querySelector(`[data-id="${id}"] button.step`))?.focus();
  }

  key(event) {
    const item = event.target.closest("button.step")?.closest("li");
    if (!item) return;
    const id = Number(item.dataset.id);
    if (event.altKey && WAYS[event.key]) {
      event.preventDefault();
      this.builder.shift(id, WAYS[event.key]);
    } else if (event.key === "Delete") {
      this.builder.drop(id);
    } else if (event.key === "ArrowUp" || event.key === "ArrowDown") {
      event.preventDefault();
      const all = /** @type {HTMLElement[]} */ ([...this.place.querySelectorAll("button.step")]);
      all[all.indexOf(event.target.closest("button.step")) + (event.key === "ArrowUp" ? -1 : 1)]?.focus();
    }
  }

  // -- by pointer ---------------------------------------------------------------------------------------------------

  grab(event) {
    const grip = event.target.closest?.(".grip");
    if (!grip || !event.isPrimary) return;
    event.preventDefault();
    const item = grip.closest("li");
    const id = Number(item.dataset.id);
    let place;
    grip.setPointerCapture(event.pointerId);
    item.dataset.dragged = "";
    const over = (moved) => {
      if (moved.clientY < EDGE) scrollBy(0, -12);
      if (moved.clientY > innerHeight - EDGE) scrollBy(0, 12);
      place = this.over(moved, item);
      this.mark(place);
    };
    const end = (ended) => {
      for (const [name, each] of Object.entries({ pointermove: over, pointerup: end, pointercancel: end })) grip.removeEventListener(name, each);
      delete item.dataset.dragged;
      this.mark(undefined);
      if (ended.type === "pointerup" && place) this.drop(id, place);
    };
    grip.addEventListener("pointermove", over);
    grip.addEventListener("pointerup", end);
    grip.addEventListener("pointercancel", end);
  }

  /** @returns {{row: HTMLElement, where: "before" | "after" | "inside"} | undefined} */
  over({ clientX, clientY }, item) {
    const row = /** @type {HTMLElement} */ (document.elementFromPoint(clientX, clientY)?.closest("li[data-id]")?.querySelector(":scope > .step-row"));
    if (!row || !this.place.contains(row) || item.contains(row)) return undefined;
    const { node, parent } = find(this.builder.mission.root, Number(row.closest("li").dataset.id));
    const { top, height } = row.getBoundingClientRect();
    const share = (clientY - top) / height;
    if (!parent || (holdsSteps(node) && share > 0.3)) return holdsSteps(node) ? { row, where: "inside" } : undefined;
    return { row, where: share < 0.5 ? "before" : "after" };
  }

  mark(place) {
    for (const each of this.place.querySelectorAll("[data-drop]")) delete each.dataset.drop;
    if (place) place.row.dataset.drop = place.where;
  }

  drop(id, { row, where }) {
    const { root } = this.builder.mission;
    const target = find(root, Number(row.closest("li").dataset.id));
    if (where === "inside") return this.builder.moveTo(id, target.node, 0);
    const index = target.parent.below.indexOf(target.node) + (where === "after" ? 1 : 0);
    const from = find(root, id);
    const before = from.parent === target.parent && from.parent.below.indexOf(from.node) < index;
    this.builder.moveTo(id, target.parent, before ? index - 1 : index);
  }
}

/** The buttons for a step that is selected. */
export function stepButtons(/** @type {import("./builder.js").Builder} */ builder, /** @type {number} */ id) {
  const { root } = builder.mission;
  const bar = element("p", { className: "buttons step-buttons" });
  const ways = { up: say("Up"), down: say("Down"), out: say("Out"), in: say("In") };
  for (const [way, text] of Object.entries(ways)) {
    bar.append(button(text, () => builder.shift(id, way), { disabled: !placeFor(root, id, /** @type {any} */ (way)), "aria-label": say("Move the step {text}", { text: text.toLowerCase() }), title: say("Alt and the arrow keys do so in the outline") }));
  }
  if (id !== root.id) bar.append(button(say("Duplicate"), () => builder.duplicate(id)), button(say("Delete"), () => builder.drop(id), { className: "danger" }));
  return bar;
}

/** Return where a step is, in words for people who do not see the outline. */
export function placeInWords(/** @type {import("./mission_tree.js").Node} */ root, /** @type {number} */ id) {
  const { node, parent } = find(root, id);
  if (!parent) return "";
  return say("Step {value} of {length} in {value2}, of {value22} steps.", { value: parent.below.indexOf(node) + 1, length: parent.below.length, value2: KINDS[parent.type], value22: [...walk(root)].length - 1 });
}
