// The page of the world: a list of its objects, and forms whose positions can be dragged in the scene.

import { say } from "../../pages/scripts/src/say.js";
import { draft } from "../../pages/scripts/src/form.js";
import { drawing } from "../../pages/scripts/src/ghost.js";
import { renew } from "../../pages/scripts/src/include.js";
import { applyLimits } from "../../pages/scripts/src/limits.js";
import { parse } from "../../pages/scripts/src/ntriples.js";
import { apply as applyPresence } from "../../pages/scripts/src/presence.js";
import { PoseFields } from "../../pages/scripts/src/pose_fields.js";
import { watch } from "../../pages/scripts/src/socket.js";
import { lf, localName, RDF_TYPE, TITLE } from "../../pages/scripts/src/vocabulary.js";

const CONTAINS = "http://www.w3.org/ns/ldp#contains";
const INTERVAL_S = 0.2;
const UPRIGHT = [0, 0, 0, 1];
const PLACE = "details[data-place]";

export function start() {
  const list = document.querySelector("[data-things]");
  if (!list) return;
  const iri = new URL(list.dataset.things, document.baseURI).href;
  watch(iri, { interval: INTERVAL_S }, (graph) => tell(list, graph, iri));
  document.addEventListener("included", ({ target }) => arranged(target.closest?.(PLACE))?.begin());
  // This event does not bubble.
  document.addEventListener("toggle", ({ target }) => target.matches?.(PLACE) && arranged(target).toggled(), true);
  document.addEventListener("saved", ({ target }) => arranged(target.closest?.(PLACE))?.saved());
  document.getElementById("scene")?.addEventListener("drawn", () => current?.begin());
  document.getElementById("scene")?.addEventListener("chosen", (/** @type {any} */ { detail }) => choose(detail));
}

/** Open the form of what was clicked in the scene. */
function choose(iri) {
  const details = [...document.querySelectorAll(PLACE)].find(({ dataset }) => iri === (dataset.robot ?? dataset.include));
  if (!details) return;
  details.open = true;
  details.scrollIntoView({ block: "nearest" });
  details.querySelector("summary").focus({ preventScroll: true });
}

function tell(list, graph, container) {
  const known = new Map([...list.children].map((item) => [item.dataset.thing, item]));
  const members = graph.values(container, CONTAINS).map(({ value }) => value);
  for (const [iri, item] of known) if (!members.includes(iri)) item.remove();
  for (const iri of members) {
    const item = known.get(iri) ?? list.appendChild(row(iri));
    if (!known.has(iri)) applyPresence();
    const zone = graph.values(iri, RDF_TYPE).some(({ value }) => value === lf("KeepOutZone"));
    const holder = graph.value(iri, lf("heldBy"))?.value;
    const held = holder ? say(", held by {localName}", { localName: localName(holder) }) : "";
    const [title, kind] = [graph.value(iri, TITLE)?.value ?? "object", (zone ? say("keep-out zone") : "obstacle") + held];
    item.toggleAttribute("data-held", Boolean(holder)); // its position is that in the hand: nothing to be dragged
    if (item.dataset.said === `${title} ${kind}`) continue;
    item.dataset.said = `${title} ${kind}`;
    item.querySelector("h3 a").textContent = title;
    item.querySelector("h3 small").textContent = kind;
    item.querySelector("button[data-delete]").ariaLabel = say("Delete {title}", { title });
  }
}

/** An object in the list: its name, the form that changes it, and a button that deletes it. */
function row(iri) {
  const item = make("li");
  item.dataset.thing = iri;
  const link = make("a");
  link.href = iri;
  const form = make("details", { className: "action" }, make("summary", {}, say("Move or change it")));
  Object.assign(form.dataset, { include: iri, place: "" });
  const button = make("button", { type: "button", className: "danger" }, say("Delete"));
  button.dataset.delete = iri;
  button.dataset.needs = "admin";
  item.append(make("h3", {}, link, " ", make("small")), button, form);
  return item;
}

/** @type {WeakMap<Element, Arrangement>} */
const arrangements = new WeakMap();
/** @type {Arrangement|undefined} the one that is dragged: there is one at a time */
let current;

function arranged(details) {
  if (!details) return undefined;
  if (!arrangements.has(details)) arrangements.set(details, new Arrangement(details));
  return arrangements.get(details);
}

/** The form of an object or of a robot's placement, with its draft in the scene. */
class Arrangement {
  constructor(details) {
    this.details = details;
    details.addEventListener("input", () => this.typed());
    details.addEventListener("change", () => this.typed());
    new MutationObserver(() => details.isConnected || this.end()).observe(document.body, { childList: true, subtree: true });
  }

  get form() {
    return this.details.querySelector("form.invoke");
  }

  toggled() {
    if (this.details.open) this.begin();
    else this.end();
  }

  /** Show the form's contents in the scene, and make them draggable. */
  begin() {
    const scene = drawing();
    if (!this.details.open || !this.form) return;
    if (current !== this) current?.end();
    current = this;
    if (scene?.section.dataset.phase !== "ready" || this.details.closest("[data-held]")) return;
    this.fields = new PoseFields(this.form);
    if (!this.fields.readPosition()) this.fields.writePosition(scene.middle());
    this.target ??= scene.target((pose, done) => this.dragged(pose, done));
    this.offer();
    this.typed();
  }

  /** Buttons that choose between dragging the position and the orientation. */
  offer() {
    if (this.form.querySelector(".gizmo")) return;
    const bar = make("p", { className: "buttons gizmo" });
    for (const [mode, text] of /** @type {const} */ ([["translate", say("Drag it")], ["rotate", say("Turn it")]])) {
      const button = make("button", { type: "button", className: "quiet" }, text);
      button.ariaPressed = String(mode === "translate");
      button.onclick = () => {
        for (const each of bar.children) each.ariaPressed = String(each === button);
        if (this.target) this.target.mode = mode;
      };
      bar.append(button);
    }
    this.form.prepend(bar);
  }

  dragged({ position, orientation }, done) {
    this.form.dataset.touched = "";
    this.fields.writePosition(position);
    if (!same(orientation, this.fields.readOrientation() ?? UPRIGHT)) this.fields.writeOrientation(orientation);
    applyLimits(this.form);
    this.draw();
    if (done) this.typed();
  }

  /** Move the object in the scene after numbers were typed. */
  typed() {
    const position = this.fields?.readPosition();
    if (!this.target || !this.form || !position) return;
    this.target.pose = { position, orientation: this.fields.readOrientation() ?? UPRIGHT };
    this.draw();
  }

  draw() {
    const { include, robot } = this.details.dataset;
    drawing()?.draft(parse(draft(this.form)), robot ?? new URL(include, document.baseURI).href, Boolean(robot));
  }

  async saved() {
    const said = this.form.querySelector("output.answer").cloneNode(true);
    this.end();
    await renew(this.details);
    this.form?.querySelector("output.answer")?.replaceWith(said);
  }

  end() {
    if (current !== this) return;
    current = undefined;
    this.target?.dispose();
    this.target = undefined;
    drawing()?.draft();
  }
}

function same(one, other) {
  return one.every((value, index) => Math.abs(value - other[index]) < 1e-4);
}

/** @param {string} tag @param {Record<string, any>} properties @param {...(string|Node)} children */
function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}
