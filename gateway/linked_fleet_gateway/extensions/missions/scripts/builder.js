// The builder of missions: an outline of steps, the fields of one of them, parameters, and what the gateway says of all.

import { say } from "../../pages/scripts/src/say.js";
import { send } from "../../pages/scripts/src/request.js";
import { button, element, field } from "../../pages/scripts/src/elements.js";
import { fetchActions, fetchKinds, fetchRobots } from "../../pages/scripts/src/fleet_offer.js";
import { fetchMissions, homeOf } from "./mission_offer.js";
import { KINDS, at, copyOf, emptyMission, find, fresh, groupsOf, holdsSteps, insert, jsonOf, missionOf, move, placeFor, remove, rename } from "./mission_tree.js";
import { Outline, placeInWords } from "./outline.js";
import { parameterTable } from "./parameters.js";
import { noteOf, rehearsalIn } from "./rehearsal.js";
import { RobotView } from "./robot_scene.js";
import { StepEditor } from "./step_editor.js";

const MOST_UNDONE = 50;
const NARROW = matchMedia("(max-width: 60rem)");
const JSON_TYPE = "application/json";
const TREE_TYPE = "application/vnd.behaviortree+xml";

/** @typedef {{step?: string, parameter?: string, parameterNumber?: string, member?: string, path?: string, message: string}} Finding */
/** @typedef {{errors?: string[], findings?: Finding[], note?: string, rehearsed?: string}} Mark */

/** Open the builder with the mission that the address names, or with an empty one. */
export async function open(/** @type {HTMLElement} */ section) {
  const builder = new Builder(section);
  const id = new URLSearchParams(location.search).get("mission");
  await builder.begin(id ? `${builder.missions}/${encodeURIComponent(id)}` : "");
}

export class Builder {
  constructor(/** @type {HTMLElement} */ section) {
    this.section = section;
    this.root = document.body.dataset.root;
    this.missions = section.dataset.missions;
    this.query = section.dataset.query;
    this.robots = [];
    this.offers = new Map();
    this.mission = emptyMission();
    this.selected = this.mission.root.id;
    /** @type {Map<number, Mark>} */
    this.marks = new Map();
    /** @type {Map<string, string>} */
    this.parameterErrors = new Map();
    this.undone = [];
    this.iri = "";
    this.tag = "";
    this.dirty = false;
    this.checked = false;
    this.lastRobot = "";
  }

  async begin(/** @type {string} */ iri) {
    let refusal = "";
    await Promise.all([
      fetchRobots(this.root).then((found) => (this.robots = found), (error) => (refusal = say("The robots cannot be loaded: {message}", { message: error.message }))),
      iri ? this.load(iri).catch((error) => (refusal = say("The mission cannot be loaded: {message}", { message: error.message }))) : undefined,
    ]);
    this.build();
    this.render();
    if (refusal) this.tell("error", refusal);
    addEventListener("beforeunload", (event) => {
      if (this.dirty) event.preventDefault();
    });
  }

  async load(iri) {
    const response = await fetch(iri, { headers: { Accept: JSON_TYPE }, cache: "no-store" });
    const said = await response.json();
    if (!response.ok) throw new Error(said.detail ?? response.statusText);
    this.mission = missionOf(said);
    this.selected = this.mission.root.id;
    this.iri = iri;
    this.tag = response.headers.get("etag") ?? "";
    this.dirty = false;
  }

  // -- the page -----------------------------------------------------------------------------------------------------

  build() {
    const titleInput = element("input", { type: "text", maxLength: 200, autocomplete: "off", required: true });
    titleInput.addEventListener("input", () => this.edited(() => (this.mission.title = titleInput.value.trim()), "title"));
    const holds = element("input", { type: "checkbox" });
    holds.addEventListener("change", () => this.edited(() => (this.mission.holds = holds.checked), "holds"));
    this.titleInput = titleInput;
    this.holds = holds;
    this.undoButton = button(say("Undo"), () => this.undo(), { disabled: true });
    this.saveButton = button(say("Save"), () => this.save(), { className: "" });
    const bar = element("p", { className: "buttons" }, button(say("Check"), () => this.check()), button(say("Rehearse"), () => this.rehearse()), this.saveButton, this.undoButton);
    this.answer = element("output", { className: "answer", role: "status" });
    const held = element("div", { className: "field" }, element("label", { className: "check" }, holds, say(" A step that fails lets the run wait for a person")));
    const head = element("div", { className: "panel builder-head" }, element("div", { className: "fields" }, field(say("Title of the mission"), titleInput), held), bar, this.answer);

    this.outlinePlace = element("div", { className: "outline" });
    this.outline = new Outline(this.outlinePlace, this);
    const kinds = Object.entries(KINDS).map(([type, text]) => button(text, () => this.add(type)));
    const adding = element("div", { className: "add", role: "group", "aria-label": say("Add a step") }, element("span", { className: "hint" }, say("Add a step:")), element("p", { className: "buttons" }, ...kinds));
    this.spoken = element("output", { className: "spoken", role: "status" });
    const steps = panel(say("Steps"), "steps-title", this.outlinePlace, adding, this.spoken);

    const editorPlace = element("section", { className: "panel step-editor", "aria-labelledby": "step-title" });
    this.editor = new StepEditor(editorPlace, this);
    const viewPlace = element("div", { className: "robot-view", hidden: true });
    this.view = new RobotView(viewPlace);
    const grid = element("div", { className: "builder-grid" }, steps, element("div", { className: "builder-side" }, editorPlace, viewPlace));

    this.parameterPlace = element("div");
    this.runPlace = element("div");
    this.runPanel = panel(say("Run"), "run-title", this.runPlace);
    const parts = [head, grid, panel(say("Parameters"), "parameters-title", this.parameterPlace), this.runPanel];
    if (!this.iri) parts.push(this.importPanel());
    this.section.replaceChildren(...parts);
  }

  importPanel() {
    const input = element("input", { type: "file", accept: ".xml,application/xml,text/xml" });
    input.addEventListener("change", () => input.files.length && this.importTree(input.files[0]));
    return panel(say("Import"), "import-title", field(say("Behavior tree"), input, say("XML of BehaviorTree.CPP 4. It becomes a mission of its own, which is opened here.")));
  }

  /** Show all again. */
  render() {
    if (!find(this.mission.root, this.selected)) this.selected = this.mission.root.id;
    if (this.titleInput.value.trim() !== this.mission.title) this.titleInput.value = this.mission.title;
    this.holds.checked = this.mission.holds;
    this.outline.render();
    this.editor.render(find(this.mission.root, this.selected).node);
    this.renderParameters();
    this.renderState();
  }

  renderParameters() {
    this.parameterPlace.replaceChildren(parameterTable(this, this.parameterErrors));
  }

  renderState() {
    const last = this.undone.at(-1);
    this.undoButton.disabled = !last;
    this.undoButton.title = last ? say("Undo: {what}", { what: last.what }) : "";
    this.saveButton.textContent = this.dirty || !this.iri ? say("Save") : say("Saved");
    this.runPanel.hidden = !this.iri;
    if (!this.iri) return;
    const page = element("a", { href: this.iri }, say("The page of the mission"));
    if (this.dirty) {
      this.runPlace.replaceChildren(element("p", {}, say("There are unsaved changes. Save them to run the mission. ")), element("p", {}, page));
    } else if (!this.runPlace.querySelector("details")) {
      const details = element("details", { className: "action" }, element("summary", {}, say("Run the mission")));
      details.dataset.include = `${this.iri}/actions/run`;
      this.runPlace.replaceChildren(details, element("p", {}, page));
    }
  }

  tell(state, ...parts) {
    this.answer.dataset.state = state;
    this.answer.replaceChildren(...parts);
  }

  // -- changes ------------------------------------------------------------------------------------------------------

  /** Change the structure of the mission; `what` is what can be undone. */
  changed(change, what) {
    this.remember(what);
    change();
    this.touched();
    this.render();
  }

  /** Change a value, in the fields of which somebody is writing. Changes of the same one are undone together. */
  edited(change, about) {
    this.remember(say("Change of {value}", { value: typeof about === "number" ? "a step" : about }), about);
    change();
    this.touched();
    if (typeof about === "number") this.marks.delete(about);
    this.outline.render();
    this.renderState();
  }

  remember(what, about = undefined) {
    if (about !== undefined && this.undone.at(-1)?.about === about) return;
    this.undone.push({ what, about, mission: structuredClone(this.mission), selected: this.selected });
    if (this.undone.length > MOST_UNDONE) this.undone.shift();
  }

  /** What was found about the mission as it was no longer holds. */
  touched() {
    this.dirty = true;
    for (const mark of this.marks.values()) {
      delete mark.note;
      delete mark.rehearsed;
    }
    if (this.view.steps.length) this.view.rehearsed([]);
  }

  undo() {
    const last = this.undone.pop();
    if (!last) return;
    this.mission = last.mission;
    this.selected = last.selected;
    this.touched();
    this.render();
    this.spoken.textContent = say("Undone: {what}.", { what: last.what });
  }

  setParameter(parameter, member, value) {
    this.remember(say("Change of a parameter"), say("{member} of a parameter", { member }));
    if (member === "name") rename(this.mission, parameter.name, value);
    if (member === "type") for (const each of ["minimum", "maximum", "options", "default"]) delete parameter[each];
    if (value === undefined) delete parameter[member];
    else parameter[member] = value;
    this.touched();
    this.parameterErrors.clear();
    if (member === "type") {
      const label = document.activeElement?.getAttribute("aria-label");
      this.renderParameters();
      /** @type {HTMLElement | null} */ (label && this.parameterPlace.querySelector(`[aria-label="${CSS.escape(label)}"]`))?.focus();
    }
    this.editor.offerVariables();
    this.outline.render();
    this.renderState();
  }

  select(id) {
    this.selected = id;
    this.outline.render();
    this.editor.render(find(this.mission.root, id).node);
    this.outline.focus(id);
    this.view.after(this.marks.get(id)?.rehearsed);
    if (NARROW.matches) this.editor.place.scrollIntoView({ block: "start" });
  }

  add(type) {
    const made = fresh(type);
    const { node, parent } = find(this.mission.root, this.selected);
    this.changed(() => {
      if (holdsSteps(node)) insert(node, node.below.length, made);
      else insert(parent, parent.below.indexOf(node) + 1, made);
      this.selected = made.id;
    }, say("Add: {value}", { value: KINDS[type] }));
    this.spoken.textContent = say("Added. {placeInWords}", { placeInWords: placeInWords(this.mission.root, made.id) });
    if (NARROW.matches) this.editor.place.scrollIntoView({ block: "start" });
  }

  shift(id, way) {
    const place = placeFor(this.mission.root, id, way);
    if (place) this.moveTo(id, place.parent, place.index);
  }

  moveTo(id, parent, index) {
    this.remember(say("Move of a step"));
    if (!move(this.mission.root, id, parent, index)) {
      this.undone.pop();
      return;
    }
    this.selected = id;
    this.touched();
    this.render();
    this.outline.focus(id);
    this.spoken.textContent = placeInWords(this.mission.root, id);
  }

  duplicate(id) {
    const { node, parent } = find(this.mission.root, id);
    const copy = copyOf(node);
    this.changed(() => {
      insert(parent, parent.below.indexOf(node) + 1, copy);
      this.selected = copy.id;
    }, say("Duplicate"));
    this.outline.focus(copy.id);
  }

  drop(id) {
    const { parent } = find(this.mission.root, id);
    if (!parent) return;
    const index = parent.below.findIndex((each) => each.id === id);
    this.changed(() => {
      remove(this.mission.root, id);
      this.selected = (parent.below[index] ?? parent.below[index - 1] ?? parent).id;
    }, say("Delete of a step"));
    this.outline.focus(this.selected);
    this.spoken.textContent = say("The step is deleted. Undo brings it back.");
  }

  // -- what the fleet offers ----------------------------------------------------------------------------------------

  /** @returns {Promise<import("../../pages/scripts/src/fleet_offer.js").Offered[]>} */
  offeredBy(home) {
    if (!this.offers.has(home)) {
      const asked = home === this.missions ? fetchMissions(home, this.iri) : fetchActions(this.query, home, home !== this.root);
      this.offers.set(home, asked);
      asked.catch(() => this.offers.delete(home));
    }
    return this.offers.get(home);
  }

  /** Return the kinds of actions that a thing may have which a parameter names. */
  kinds() {
    this.kindsOfActions ??= fetchKinds(this.query, this.root);
    this.kindsOfActions.catch(() => (this.kindsOfActions = undefined));
    return this.kindsOfActions;
  }

  /** Show the robot of an action beside the outline. */
  look(action) {
    const home = homeOf(action, this.root, this.missions);
    this.lastRobot = home;
    if (home !== this.root && home !== this.missions) this.view.show(home);
  }

  // -- what the gateway says ----------------------------------------------------------------------------------------

  async request(method, iri, headers = {}) {
    const body = JSON.stringify(jsonOf(this.mission));
    this.section.setAttribute("aria-busy", "true");
    this.tell("waiting", say("Asking…"));
    const got = await send(method, iri, { body, headers: { "Content-Type": JSON_TYPE, ...headers } });
    this.section.removeAttribute("aria-busy");
    this.marks.clear();
    this.parameterErrors.clear();
    this.view.rehearsed([]);
    this.checked = Boolean(got.problem);
    if (got.problem) this.refused(got.problem);
    return got;
  }

  /** Show each error at its step or parameter. */
  refused(/** @type {import("../../pages/scripts/src/request.js").Problem & {findings?: Finding[]}} */ problem) {
    let first;
    for (const each of problem.findings ?? []) {
      const name = each.parameter ?? this.mission.parameters[Number(each.parameterNumber ?? NaN)]?.name;
      if (name !== undefined) this.parameterErrors.set(name, each.message);
      const node = each.step === undefined ? undefined : at(this.mission.root, each.step);
      if (!node) continue;
      first ??= node.id;
      const mark = this.marks.get(node.id) ?? { errors: [], findings: [] };
      mark.errors.push(each.message);
      mark.findings.push(each);
      this.marks.set(node.id, mark);
    }
    if (first !== undefined) this.selected = first;
    this.render();
    const count = (problem.findings ?? []).length;
    this.tell("error", element("strong", {}, problem.title), ` ${problem.detail}${count > 1 ? say(" {count} errors are shown at their steps and parameters.", { count }) : ""}`);
  }

  async check() {
    const { problem } = await this.request("POST", this.missions, { Prefer: "dry-run" });
    if (problem) return;
    this.render();
    this.tell("done", say("No errors were found."));
  }

  async rehearse() {
    const { problem, graph } = await this.request("POST", this.missions, { Prefer: "dry-run, return=representation" });
    if (problem) return;
    const { seconds, steps } = rehearsalIn(graph);
    const of = groupsOf(steps, ({ path }) => at(this.mission.root, path)?.id);
    for (const [id, all] of of) if (id !== undefined) this.marks.set(id, { note: noteOf(all), rehearsed: all.at(-1).path });
    this.render();
    this.view.rehearsed(steps);
    const left = steps.filter(({ reason }) => reason).length;
    const parts = [element("strong", {}, say("It would work; nothing has moved.")), say(" It would take {seconds} s. {value} of {length} actions are rehearsed.", { seconds: seconds.toFixed(1), value: steps.length - left, length: steps.length })];
    if (this.mission.parameters.length) parts.push(say(" Parameters had their defaults, or a value in their range."));
    this.tell("rehearsed", ...parts);
  }

  async save() {
    if (!this.mission.title) {
      this.tell("error", say("A mission has a title."));
      return this.titleInput.focus();
    }
    const { iri } = this;
    const got = iri ? await this.request("PUT", iri, { "If-Match": this.tag }) : await this.request("POST", this.missions);
    if (got.problem) {
      if (got.status === 412) this.answer.append(element("p", { className: "buttons" }, button(say("Load it as it is now"), () => this.reload()), button(say("Save this as another mission"), () => this.saveCopy())));
      return;
    }
    await this.saved(iri || got.location);
  }

  async saved(iri) {
    this.iri = iri;
    this.dirty = false;
    const kept = await fetch(iri, { method: "HEAD", headers: { Accept: JSON_TYPE }, cache: "no-store" }).catch(() => undefined);
    this.tag = kept?.headers.get("etag") ?? "";
    history.replaceState(null, "", `${location.pathname}?mission=${iri.split("/").at(-1)}`);
    this.runPlace.replaceChildren();
    this.section.querySelector("[aria-labelledby=import-title]")?.remove();
    this.render();
    this.tell("done", say("Saved."));
  }

  async saveCopy() {
    this.iri = "";
    await this.save();
  }

  async reload() {
    try {
      await this.load(this.iri);
      this.undone = [];
      this.marks.clear();
      this.runPlace.replaceChildren();
      this.render();
      this.tell("done", say("This is the mission as it is now."));
    } catch (error) {
      this.tell("error", say("The mission cannot be loaded: {message}", { message: error.message }));
    }
  }

  async importTree(/** @type {File} */ file) {
    this.tell("waiting", say("Asking…"));
    const { problem, location: made } = await send("POST", this.missions, { body: await file.text(), headers: { "Content-Type": TREE_TYPE } });
    if (problem) return this.tell("error", element("strong", {}, problem.title), ` ${problem.detail}`);
    await this.load(made);
    await this.saved(made);
  }
}

function panel(title, id, ...inner) {
  return element("section", { className: "panel", "aria-labelledby": id }, element("h2", { id }, title), ...inner);
}
