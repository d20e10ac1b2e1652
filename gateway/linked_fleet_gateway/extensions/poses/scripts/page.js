// Saved poses: the form that saves the present one, a mission from some of them, and the page of one.

import { ghost } from "../../pages/scripts/src/ghost.js";
import { Motion } from "../../pages/scripts/src/motion.js";
import { key, parse, write } from "../../pages/scripts/src/ntriples.js";
import { drawScene, sceneOf } from "../../pages/scripts/src/other_scene.js";
import { adopt, refresh } from "../../pages/scripts/src/region.js";
import { send } from "../../pages/scripts/src/request.js";
import { say } from "../../pages/scripts/src/say.js";
import { DECIMAL, NUMERICAL_VALUE, TITLE, lf } from "../../pages/scripts/src/vocabulary.js";

const COMMENT = "http://www.w3.org/2000/01/rdf-schema#comment";
const UNIT_TERM = "http://vocab.arvida.de/2015/06/vom/vocab#unit";
const DECIMALS = 3;
/** How much of the SI unit one of a unit is. */
const SIZES = { DEG: Math.PI / 180, MilliM: 1e-3 };
/** @type {string[]} the titles of the chosen poses, in the order of the steps */
const steps = [];

export function start() {
  document.addEventListener("submit", (event) => {
    const form = event.target;
    if (!(form instanceof HTMLFormElement) || !("teach" in form.dataset || "sequence" in form.dataset)) return;
    event.preventDefault();
    if ("teach" in form.dataset) save(form);
    else makeMission(form);
  });
  document.addEventListener("change", ({ target }) => {
    if (target instanceof HTMLInputElement && "step" in target.dataset) choose(target);
  });
  adopt(number);
  const edited = /** @type {HTMLFormElement | null} */ (document.querySelector("form.invoke.pose"));
  const go = /** @type {HTMLFormElement | null} */ (document.querySelector("form.motion[data-assume]"));
  if (!go || !edited) return;
  const going = new Going(go, edited);
  new Editing(edited, () => going.adopt());
}

const iri = (value) => write({ kind: "iri", value });
const literal = (value) => write({ kind: "literal", value });
const statement = (predicate, object) => `_:pose ${iri(predicate)} ${object} .\n`;

/** Return a body that saves the present positions of some joints, or of all. */
function present(title, note, joints) {
  return [statement(TITLE, literal(title)), note && statement(COMMENT, literal(note)), ...joints.map((each) => statement(lf("ofJoint"), iri(each)))].filter(Boolean).join("");
}

async function save(/** @type {HTMLFormElement} */ form) {
  if (form.getAttribute("aria-busy") === "true") return;
  const data = new FormData(form);
  const [title, note, joints] = ["title", "note", "joints"].map((name) => String(data.get(name) ?? "").trim());
  if (!title) return answer(form, "error", say("A pose needs a name."));
  form.setAttribute("aria-busy", "true");
  answer(form, "waiting", say("Asking…"));
  const body = present(title, note, joints.split(" ").filter(Boolean));
  const { problem, location } = await send("POST", form.dataset.teach, { body });
  form.removeAttribute("aria-busy");
  if (problem) return answer(form, "error", `${problem.title}. ${problem.detail}`);
  form.reset();
  answer(form, "done", say("Saved: "), Object.assign(document.createElement("a"), { href: location, textContent: title }));
  refresh();
}

function answer(form, state, ...parts) {
  const output = form.querySelector("output.answer");
  output.dataset.state = state;
  output.replaceChildren(...parts);
}

// -- a mission from poses -----------------------------------------------------------------------------------------------

function choose(/** @type {HTMLInputElement} */ box) {
  const { step } = box.dataset;
  if (box.checked) steps.push(step);
  else steps.splice(steps.indexOf(step), 1);
  number();
}

/** Show the numbers of the steps: rows may be new. Poses that have gone are no steps any more. */
function number() {
  const boxes = /** @type {HTMLInputElement[]} */ ([...document.querySelectorAll("input[data-step]")]);
  const present = new Set(boxes.map(({ dataset }) => dataset.step));
  for (const each of [...steps]) if (!present.has(each)) steps.splice(steps.indexOf(each), 1);
  for (const box of boxes) {
    const place = steps.indexOf(box.dataset.step);
    box.checked = place >= 0;
    box.parentElement.querySelector(".order").textContent = place < 0 ? "" : String(place + 1);
  }
  document.querySelector("form.sequence .chosen")?.replaceChildren(...steps.map((each) => Object.assign(document.createElement("li"), { textContent: each })));
}

async function makeMission(/** @type {HTMLFormElement} */ form) {
  if (form.getAttribute("aria-busy") === "true") return;
  if (!steps.length) return answer(form, "error", say("No pose is chosen: tick those that the mission has as its steps."));
  const action = form.dataset.assume;
  const list = steps.map((pose) => ({ type: "invoke", title: pose, action, body: { pose } }));
  const mission = { title: steps.join(", ").slice(0, 200), step: { type: "sequence", steps: list } };
  form.setAttribute("aria-busy", "true");
  answer(form, "waiting", say("Asking…"));
  const headers = { "Content-Type": "application/json" };
  const { problem, location: made } = await send("POST", form.dataset.sequence, { body: JSON.stringify(mission), headers });
  form.removeAttribute("aria-busy");
  if (problem) return answer(form, "error", `${problem.title}. ${problem.detail}`);
  location.assign(`${form.dataset.sequence}/builder?mission=${made.slice(made.lastIndexOf("/") + 1)}`);
}

// -- one pose -----------------------------------------------------------------------------------------------------------

/** @returns {{joint: string, field: HTMLInputElement, unit: string}[]} */
function positions(/** @type {HTMLFormElement} */ form) {
  return [...form.querySelectorAll("fieldset.position")].map((each) => ({
    joint: /** @type {HTMLInputElement} */ (each.querySelector(`[data-path="${lf("ofJoint")}"]`)).value,
    field: /** @type {HTMLInputElement} */ (each.querySelector(`[data-path="${NUMERICAL_VALUE}"]`)),
    unit: /** @type {HTMLInputElement} */ (each.querySelector(`[data-path="${UNIT_TERM}"]`)).value.replace(/^.*\//, ""),
  }));
}

function targets(/** @type {HTMLFormElement} */ form) {
  const found = positions(form).map(({ joint, field, unit }) => /** @type {[string, number]} */ ([joint, Number(field.value) * SIZES[unit]]));
  return new Map(found.filter(([, position]) => Number.isFinite(position)));
}

/** Sends with each change the entity tag of what the page shows, so that nobody overwrites what others have changed. */
class Editing {
  constructor(/** @type {HTMLFormElement} */ form, /** @type {() => void} */ changed) {
    this.form = form;
    this.changed = changed;
    form.addEventListener("input", () => ghost(targets(form)));
    form.addEventListener("saved", () => this.show());
    form.querySelector("button[data-again]").addEventListener("click", () => this.again());
    this.show();
  }

  value(path) {
    return /** @type {HTMLInputElement} */ (this.form.querySelector(`[data-path="${path}"]`)).value.trim();
  }

  /** Save the present positions of the same joints. */
  async again() {
    const body = present(this.value(TITLE), this.value(COMMENT), positions(this.form).map(({ joint }) => joint));
    const { match } = this.form.dataset;
    if (!match) return answer(this.form, "error", say("The pose is not read yet: load the page again."));
    const headers = { "If-Match": match };
    const { problem } = await send("PUT", this.form.dataset.action, { body, headers });
    if (problem) return answer(this.form, "error", `${problem.title}. ${problem.detail}`);
    answer(this.form, "done", say("Done."));
    this.show();
    refresh();
  }

  /** Show the positions as they are saved, and remember their entity tag. */
  async show() {
    const { action } = this.form.dataset;
    const response = await fetch(action, { headers: { Accept: "application/n-triples" }, cache: "no-store" });
    if (!response.ok) return; // the page says so
    const graph = parse(await response.text());
    const saved = new Map(graph.values(action, lf("target")).map(key).map((node) => [graph.value(node, lf("ofJoint"))?.value, Number(graph.value(node, NUMERICAL_VALUE)?.value)]));
    for (const { joint, field, unit } of positions(this.form)) {
      if (saved.has(joint)) field.value = String(Number((saved.get(joint) / SIZES[unit]).toFixed(DECIMALS)));
    }
    this.form.dataset.match = response.headers.get("etag") ?? "";
    this.changed();
  }
}

/** Brings the robot to the pose that is saved, whatever the fields say meanwhile. */
class Going {
  constructor(/** @type {HTMLFormElement} */ form, /** @type {HTMLFormElement} */ edited) {
    this.form = form;
    this.motion = new Motion(form);
    this.edited = edited;
    this.adopt();
    this.speed = /** @type {HTMLSelectElement} */ (form.querySelector("select[name=speed]"));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.motion.rehearse(form.dataset.assume, this.body, this.joints);
    });
    form.querySelector("button[data-send]").addEventListener("click", () => {
      if (form.getAttribute("aria-busy") !== "true") this.motion.begin(form.dataset.assume, this.body);
    });
    this.draw(document.getElementById("pose-scene"));
  }

  /** Take the pose as the fields have it now, which is as it is saved. */
  adopt() {
    this.joints = targets(this.edited);
    this.title = /** @type {HTMLInputElement} */ (this.edited.querySelector(`[data-path="${TITLE}"]`)).value.trim();
  }

  /** Draw the robot, with a ghost of it where the pose is. */
  async draw(/** @type {HTMLElement} */ place) {
    const scene = await sceneOf(place.dataset.robot);
    if (!scene) return;
    ghost(this.joints); // the scene shows it once it is drawn
    place.replaceWith(scene);
    drawScene(scene);
  }

  get body() {
    const scale = Number(this.speed.value);
    const slower = scale === 1 ? "" : statement(lf("speedScale"), write({ kind: "literal", value: String(scale), datatype: DECIMAL }));
    return statement(lf("poseName"), literal(this.title)) + slower;
  }
}
