// What a step says: the fields of its kind, and for an action the form that is made of its shape.

import { say } from "../../pages/scripts/src/say.js";
import { fetchInput, fill, hasFields, markField, offerVariables, read } from "../../pages/scripts/src/action_input.js";
import { button, choice, element, field } from "../../pages/scripts/src/elements.js";
import { homeOf } from "./mission_offer.js";
import { KINDS, groupsOf, variablesOf } from "./mission_tree.js";
import { stepButtons } from "./outline.js";
import { nameOf } from "./summary.js";
import { localName, words } from "../../pages/scripts/src/vocabulary.js";

const BRANCHES = ["sequence", "parallel", "firstOf"];
const NAME = "[A-Za-z_][A-Za-z0-9_]*";
// Before the name of a parameter in the choice of robots, where others are IRIs.
const VARIABLE = "?";

export class StepEditor {
  /**
   * @param {HTMLElement} place
   * @param {import("./builder.js").Builder} builder
   */
  constructor(place, builder) {
    this.place = place;
    this.builder = builder;
    this.shown = 0;
  }

  render(/** @type {import("./mission_tree.js").Node} */ node) {
    this.node = node;
    this.form = undefined;
    const turn = ++this.shown;
    const isRoot = node === this.builder.mission.root;
    const title = element("h2", { id: "step-title" }, KINDS[node.type]);
    const fields = element("div", { className: "fields" }, ...this.fields(node));
    const own = isRoot ? [] : [this.text(say("Name"), "name", say("Steps refer to its result by it: letters, digits and _"), { pattern: NAME }), this.text(say("Title"), "title", say("for people"))];
    this.input = element("div", { className: "input" });
    const parts = [title, stepButtons(this.builder, node.id), this.input, fields];
    if (own.length) parts.push(element("div", { className: "fields own" }, ...own));
    this.place.replaceChildren(...parts);
    if (node.type === "invoke") this.invoke(turn);
    this.mark();
  }

  fields(node) {
    if (BRANCHES.includes(node.type)) return [this.kind(), ...(node.type === "parallel" ? [this.check(say("One that succeeds is enough"), "anySuffices")] : [])];
    if (node.type === "repeat") return [this.number(say("Times"), "times", { min: "1", max: "1000", step: "1" })];
    if (node.type === "wait") return this.wait(node);
    if (node.type === "confirm") return [this.area(say("Question"), "text", say("The run waits until somebody answers yes or no."))];
    return node.type === "notify" ? [this.area(say("Message"), "text", say("Everybody who watches the run sees it."))] : [];
  }

  kind() {
    const made = choice(BRANCHES.map((each) => [each, KINDS[each]]), this.node.type);
    made.addEventListener("change", () => this.builder.changed(() => {
      this.node.type = made.value;
      if (made.value !== "parallel") delete this.node.said.anySuffices;
    }, say("Change of the kind")));
    return field(say("Its steps run"), made);
  }

  wait(node) {
    const { said } = node;
    const now = said.condition !== undefined ? "condition" : said.until !== undefined ? "until" : "seconds";
    const made = choice([["seconds", say("for a time")], ["until", say("until an instant")], ["condition", say("until a query has an answer")]], now);
    made.addEventListener("change", () => this.builder.changed(() => {
      for (const each of ["seconds", "until", "condition", "within"]) delete said[each];
      said[made.value] = made.value === "seconds" ? 1 : "";
    }, say("Change of the wait")));
    const chosen = field(say("Wait"), made);
    if (now === "seconds") return [chosen, this.number(say("Seconds"), "seconds", { min: "0", step: "any" })];
    if (now === "until") return [chosen, this.text(say("Instant"), "until", say("such as 2026-11-29T20:00:00Z"))];
    return [chosen, this.area("SPARQL SELECT", "condition", say("as conditions of rules")), this.number(say("Fails after seconds"), "within", { min: "0", step: "any" })];
  }

  // -- fields of one member -----------------------------------------------------------------------------------------

  say(member, value) {
    this.builder.edited(() => {
      if (value === undefined) delete this.node.said[member];
      else this.node.said[member] = value;
    }, this.node.id);
  }

  plain(label, member, control, hint, read) {
    control.dataset.said = member;
    control.addEventListener("input", () => this.say(member, read(control)));
    return field(label, control, hint);
  }

  text(label, member, hint = "", given = {}) {
    const control = element("input", { type: "text", value: this.node.said[member] ?? "", autocomplete: "off", ...given });
    return this.plain(label, member, control, hint, ({ value }) => value.trim() || undefined);
  }

  area(label, member, hint = "") {
    const control = element("textarea", { value: this.node.said[member] ?? "", rows: 3 });
    return this.plain(label, member, control, hint, ({ value }) => value);
  }

  number(label, member, given) {
    const control = element("input", { type: "number", value: String(this.node.said[member] ?? ""), ...given });
    return this.plain(label, member, control, "", ({ value }) => (value === "" ? undefined : Number(value)));
  }

  check(label, member) {
    const control = element("input", { type: "checkbox", checked: Boolean(this.node.said[member]) });
    control.addEventListener("change", () => this.builder.edited(() => (control.checked ? (this.node.said[member] = true) : delete this.node.said[member]), this.node.id));
    return element("div", { className: "field" }, element("label", { className: "check" }, control, ` ${label}`));
  }

  // -- actions ------------------------------------------------------------------------------------------------------

  invoke(turn) {
    const { said } = this.node;
    if (said.triples || (said.of && !said.of.variable)) return this.raw(say("This step says more than this page has fields for."));
    const { root, missions, robots, mission } = this.builder;
    const home = said.action ? homeOf(said.action, root, missions) : said.of ? VARIABLE + said.of.variable : this.builder.lastRobot;
    const named = mission.parameters.filter(({ type, name }) => type === "iri" && name).map(({ name }) => [VARIABLE + name, say("what {name} names", { name })]);
    const things = [["", "–"], ...named, ...robots.map(({ iri, title }) => [iri, title]), [root, say("The fleet")], [missions, say("Another mission")]];
    if (home && !things.some(([iri]) => iri === home)) things.push([home, home]);
    const robot = choice(/** @type {any} */ (things), home ?? "");
    const action = element("select", { disabled: true });
    robot.dataset.said = "of";
    robot.addEventListener("change", () => {
      const variable = variableIn(robot.value);
      for (const each of ["action", "kind", "body"]) this.say(each, undefined);
      this.say("of", variable && { variable });
      if (!variable) this.builder.lastRobot = robot.value;
      action.dataset.said = variable ? "kind" : "action";
      this.form = undefined;
      this.formPlace.replaceChildren();
      this.offer(action, robot.value, this.shown);
    });
    action.addEventListener("change", () => {
      this.say("body", undefined);
      this.say(variableIn(robot.value) ? "kind" : "action", action.value || undefined);
      this.showForm(this.shown);
    });
    action.dataset.said = said.of ? "kind" : "action";
    this.formPlace = element("div", { className: "action-form" });
    this.input.append(element("div", { className: "fields" }, field(say("Robot"), robot), field(say("Action"), action)), this.formPlace);
    this.offer(action, robot.value, turn);
    if (said.action || said.kind) this.showForm(turn);
  }

  async offer(select, home, turn) {
    this.home = home;
    select.disabled = true;
    select.replaceChildren(new Option(home ? "…" : say("choose a robot first"), ""));
    if (!home) return;
    try {
      const options = variableIn(home) ? (await this.builder.kinds()).map(({ kind, name }) => new Option(name, kind)) : grouped(await this.builder.offeredBy(home));
      if (turn !== this.shown || home !== this.home) return;
      select.replaceChildren(new Option(say("choose one"), ""), ...options);
    } catch (error) {
      if (turn !== this.shown) return;
      select.replaceChildren(new Option(say("none could be loaded"), ""));
      this.formPlace.replaceChildren(wrong(say("The actions cannot be loaded: {message}", { message: error.message })), button(say("Try again"), () => this.offer(select, home, this.shown)));
    }
    const { action, kind } = this.node.said;
    const chosen = action ?? kind ?? "";
    if (chosen && ![...select.options].some(({ value }) => value === chosen)) select.add(new Option(action ? nameOf(action) : words(localName(chosen)), chosen));
    select.value = chosen;
    select.disabled = false;
  }

  async showForm(turn) {
    const { action: own, kind, body } = this.node.said;
    if (!own && !kind) return this.formPlace.replaceChildren();
    this.formPlace.replaceChildren(element("p", { className: "hint" }, "…"));
    const isChosen = () => turn === this.shown && this.node.said.action === own && this.node.said.kind === kind;
    let form;
    let action = own;
    try {
      // The form is that of one thing with such an action. Limits of others differ, and are checked when the mission runs.
      action ??= (await this.builder.kinds()).find((each) => each.kind === kind)?.action;
      if (!action) throw new Error(say("no robot that is here has such an action"));
      form = await fetchInput(action);
    } catch (error) {
      if (isChosen()) this.raw(say("The form of this action cannot be loaded: {message}", { message: error.message }));
      return;
    }
    if (!isChosen()) return;
    if (own) this.builder.look(action);
    else unlimited(form);
    if (!hasFields(form)) return this.formPlace.replaceChildren(element("p", { className: "hint" }, say("It takes no input.")));
    this.form = form;
    form.setAttribute("aria-label", say("Input of {nameOf}", { nameOf: nameOf(action) }));
    this.formPlace.replaceChildren(form);
    fill(form, body ?? {});
    this.offerVariables();
    const taken = () => this.take();
    form.addEventListener("input", taken);
    form.addEventListener("change", taken);
    form.addEventListener("click", ({ target }) => {
      if (/** @type {Element} */ (target).closest("[data-add], [data-remove]")) setTimeout(() => {
        this.offerVariables();
        this.take();
      });
    });
    if (!body) this.take();
    this.mark();
  }

  /** Keep what the form says. */
  take() {
    const { said } = read(this.form);
    this.say("body", Object.keys(said).length || this.form.querySelector("[required]") ? said : undefined);
  }

  offerVariables() {
    if (this.form) offerVariables(this.form, variablesOf(this.builder.mission), () => this.take());
  }

  /** Edit as text what no form has fields for. */
  raw(why) {
    const { said } = this.node;
    const members = Object.fromEntries(["action", "kind", "of", "body", "triples"].filter((each) => said[each] !== undefined).map((each) => [each, said[each]]));
    const area = element("textarea", { rows: 8, spellcheck: false, value: JSON.stringify(members, null, 1) });
    const error = wrong("");
    error.hidden = true;
    area.addEventListener("input", () => {
      try {
        const { action, kind, of, body, triples } = JSON.parse(area.value);
        error.hidden = true;
        for (const [name, value] of Object.entries({ action, kind, of, body, triples })) this.say(name, value);
      } catch (problem) {
        error.textContent = say("This is no JSON: {message}", { message: problem.message });
        error.hidden = false;
      }
    });
    (this.formPlace ?? this.input).replaceChildren(element("p", { className: "hint" }, why), field(say("Step in JSON"), area, say("its members action, kind, of, body and triples")), error);
  }

  /** Show the errors of the step at its fields, and all others above them. */
  mark() {
    const { findings = [] } = this.builder.marks.get(this.node.id) ?? {};
    this.place.querySelector(":scope > .wrong")?.remove();
    if (this.form) read(this.form, this.builder.checked);
    const left = findings.filter((each) => !(this.form && markField(this.form, each)));
    for (const control of this.place.querySelectorAll("[data-said]")) control.removeAttribute("aria-invalid");
    for (const { member } of left) this.place.querySelector(`[data-said="${CSS.escape(member ?? "-")}"]`)?.setAttribute("aria-invalid", "true");
    if (left.length) this.place.querySelector("h2").after(element("div", { className: "wrong" }, ...left.map(({ message }) => wrong(message))));
  }
}

/** Take the limits of one thing from a form, which others need not have. */
function unlimited(/** @type {HTMLFormElement} */ form) {
  for (const each of form.querySelectorAll("input")) for (const name of ["data-limits", "min", "max"]) each.removeAttribute(name);
  form.querySelectorAll(".range").forEach((each) => each.remove());
}

function variableIn(/** @type {string} */ chosen) {
  return chosen.startsWith(VARIABLE) ? chosen.slice(VARIABLE.length) : undefined;
}

function grouped(offered) {
  return [...groupsOf(offered, ({ thing }) => thing)].flatMap(([thing, all]) => {
    const options = all.map(({ action, name }) => new Option(thing ? `${name} ${thing}` : name, action));
    return thing ? [element("optgroup", { label: thing }, ...options)] : options;
  });
}

function wrong(text) {
  return element("p", { className: "error", role: "alert" }, text);
}
