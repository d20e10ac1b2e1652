// A rule without SPARQL: when a value of a robot passes a number for a time, then an action. It writes the fields of the
// form of the rule, which are those that are sent.

import { say } from "../../pages/scripts/src/say.js";
import { fetchInput, hasFields } from "../../pages/scripts/src/action_input.js";
import { button, choice, element, field } from "../../pages/scripts/src/elements.js";
import { fetchActions, fetchRobots } from "../../pages/scripts/src/fleet_offer.js";
import { draft, read } from "../../pages/scripts/src/form.js";
import { fetchValues } from "../../pages/scripts/src/measured.js";
import { write } from "../../pages/scripts/src/ntriples.js";
import { TITLE, lf, segments } from "../../pages/scripts/src/vocabulary.js";

const NUMBER = /^[-+]?(\d+([.]\d+)?|[.]\d+)(e[-+]?\d+)?$/i;
const COMPARISONS = [[">", say("is above")], ["<", say("is below")], [">=", say("is at least")], ["<=", say("is at most")], ["=", say("is")], ["!=", say("is not")]];
const DEGREES = 180 / Math.PI;

/**
 * @param {HTMLFormElement} form of the rule
 * @param {HTMLElement} place of the composer
 * @param {(names: string[]) => void} tellApart sets the variables by which answers are told apart
 */
export async function compose(form, place, tellApart) {
  const composer = new Composer(form, place, tellApart);
  await composer.start();
}

class Composer {
  /** @param {HTMLFormElement} form @param {HTMLElement} place @param {(names: string[]) => void} tellApart */
  constructor(form, place, tellApart) {
    this.form = form;
    this.tellApart = tellApart;
    this.place = place;
    this.root = document.body.dataset.root ?? "/";
    this.query = `${this.root}query`;
    this.written = /** @type {HTMLDetailsElement} */ (form.closest("details"));
    this.written.open = false;
    this.sends = false; // whether the answer is to what is composed here
    /** @type {import("../../pages/scripts/src/measured.js").Measured[]} */
    this.values = [];
    /** @type {HTMLFormElement | undefined} */
    this.input = undefined;
  }

  async start() {
    const robots = await fetchRobots(this.root);
    if (!robots.length) {
      this.written.open = true;
      return;
    }
    const named = robots.map(({ iri, title }) => /** @type {[string, string]} */ ([iri, title]));
    this.robot = choice(named, robots[0].iri);
    this.value = choice([]);
    this.comparison = choice(/** @type {[string, string][]} */ (COMPARISONS), ">");
    this.number = element("input", { inputMode: "decimal", required: true });
    this.seconds = element("input", { inputMode: "decimal", value: "0" });
    this.actor = choice([...named, [this.root, say("the fleet")]], robots[0].iri);
    this.action = choice([]);
    this.hint = element("p", { className: "hint" });
    this.problem = element("p", { className: "error", role: "alert", hidden: true });
    this.inputs = element("div", { className: "then-input" });
    const when = element("fieldset", { className: "sentence" }, element("legend", {}, say("When")),
      field(say("robot"), this.robot), field(say("value"), this.value), field(say("compared"), this.comparison), field(say("with"), this.number), field(say("for seconds"), this.seconds));
    const then = element("fieldset", { className: "sentence" }, element("legend", {}, say("Then")),
      field(say("who does it"), this.actor), field(say("what"), this.action), this.inputs);
    const save = button(say("Save this rule"), () => this.save(), { className: "" });
    const done = element("output", { className: "composed", role: "status" });
    this.place.append(when, this.hint, then, this.problem, element("p", { className: "buttons" }, save), done);
    this.follow(done);
    this.robot.addEventListener("change", () => this.attempt(() => this.offerValues()));
    this.actor.addEventListener("change", () => this.attempt(() => this.offerActions()));
    this.action.addEventListener("change", () => this.attempt(() => this.offerInput()));
    this.value.addEventListener("change", () => this.describe());
    this.number.addEventListener("input", () => this.describe());
    this.place.hidden = false;
    await this.attempt(async () => {
      await this.offerValues();
      await this.offerActions();
    });
  }

  /** Show what became of the rule, also while its form is folded. A refusal is shown at its fields. */
  follow(/** @type {HTMLElement} */ done) {
    this.form.addEventListener("click", () => (this.sends = false));
    /** @type {HTMLElement | null} */
    const answer = this.form.querySelector("output.answer");
    if (!answer) return;
    new MutationObserver(() => {
      done.textContent = "";
      if (!this.sends) return;
      const refused = answer.dataset.state === "error";
      if (refused) this.written.open = true;
      done.textContent = refused ? say("It was refused; the form below says why.") : answer.textContent;
    }).observe(answer, { childList: true, subtree: true, attributes: true });
  }

  /** Do something that asks the gateway, and say so if it fails. */
  async attempt(step) {
    this.say("");
    try {
      await step();
    } catch (error) {
      this.say(say("This cannot be loaded: {message}", { message: error.message }));
    }
  }

  say(/** @type {string} */ text) {
    this.problem.textContent = text;
    this.problem.hidden = !text;
  }

  async offerValues() {
    const robot = this.robot.value;
    const values = await fetchValues(this.query, robot);
    if (robot !== this.robot.value) return; // another one was chosen meanwhile
    this.values = values;
    refill(this.value, [...this.values.map(({ name }) => new Option(name)), new Option("presence")]);
    this.describe();
  }

  async offerActions() {
    const actor = this.actor.value;
    const found = await fetchActions(this.query, actor, actor !== this.root);
    if (actor !== this.actor.value) return;
    const before = this.action.value;
    refill(this.action, found.map(({ action, name, thing }) => new Option(thing && thing !== this.root ? `${name} (${thing})` : name, action)));
    if (this.action.value !== before) await this.offerInput();
  }

  async offerInput() {
    this.inputs.replaceChildren();
    this.input = undefined;
    if (!this.action.value) return;
    const action = this.action.value;
    const input = await fetchInput(action);
    if (action !== this.action.value || !hasFields(input)) return;
    this.inputs.replaceChildren();
    this.input = input;
    this.inputs.append(input);
  }

  /** Say in which unit the number is. */
  describe() {
    const isPresence = this.value.value === "presence";
    for (const each of [this.comparison, this.number]) each.closest(".field").hidden = isPresence;
    const measured = this.values.find(({ name }) => name === this.value.value);
    const number = Number(this.number.value);
    const turned = measured?.unit === "rad" && NUMBER.test(this.number.value) ? say(", which is {value}°", { value: (number * DEGREES).toFixed(1) }) : "";
    if (isPresence) this.hint.textContent = say("The robot goes offline: its agent is not there any more.");
    else if (measured?.text) this.hint.textContent = say("The value is a text, or true or false. It is compared as it is written.");
    else this.hint.textContent = measured?.unit ? say("The number is in {unit}{turned}.", { unit: measured.unit, turned }) : say("The number has no unit.");
  }

  /** Return the condition and its words, or undefined with the reason at the field. */
  condition() {
    if (this.value.value === "presence") {
      const condition = `SELECT ?robot WHERE {\n  BIND(<${this.robot.value}> AS ?robot)\n  ?robot <${lf("presence")}> <${lf("offline")}> .\n}\n`;
      return { condition, apart: "robot", said: say("{value} goes offline", { value: segments(this.robot.value)[0] }) };
    }
    const measured = this.values.find(({ name }) => name === this.value.value);
    if (!measured) return void this.say(say("The robot has no value to be compared. Choose another one."));
    const text = this.number.value.trim();
    if (!measured.text && !NUMBER.test(text)) return void this.say(say("A number is needed to compare the value with, such as 0.5."));
    if (!text) return void this.say(say("A value is needed to compare with."));
    const { thing, path } = measured;
    const compared = measured.text ? `STR(?value) ${this.comparison.value} ${write({ kind: "literal", value: text })}` : `?value ${this.comparison.value} ${text}`;
    const condition = `SELECT ?thing ?value WHERE {\n  BIND(<${thing}> AS ?thing)\n  ?thing ${path.map((each) => `<${each}>`).join("/")} ?value .\n  FILTER(${compared})\n}\n`;
    const said = say("{name} of {value} {text} {text2}{value2}", { name: measured.name, value: segments(thing)[0], text: this.comparison.selectedOptions[0].text, text2: text, value2: measured.unit && ` ${measured.unit}` });
    return { condition, apart: "thing", said };
  }

  /** Write the fields of the rule, and send it. */
  save() {
    this.say("");
    const when = this.condition();
    if (!when) return;
    const seconds = this.seconds.value.trim() || "0";
    if (!NUMBER.test(seconds) || Number(seconds) < 0 || Number(seconds) > 86400) return this.say(say("For how long it holds is a number of seconds from 0 to 86400."));
    if (!this.action.value) return this.say(say("There is no action to choose. Choose somebody else who does it."));
    if (this.input && read(this.input) === null) return this.say(say("The input of the action is not complete; see its fields."));
    const lasting = Number(seconds) > 0 ? say(" for {seconds} s", { seconds }) : "";
    const did = this.action.selectedOptions[0].text;
    const fields = {
      [TITLE]: say("When {said}{lasting}: {did}", { said: when.said, lasting, did }).slice(0, 200),
      [lf("condition")]: when.condition,
      [lf("invokes")]: this.action.value,
      [lf("body")]: this.input ? draft(this.input).replaceAll(/_:n0(?= )/g, "_:body") : "",
      [lf("holdsFor")]: seconds,
    };
    for (const [path, value] of Object.entries(fields)) {
      const control = /** @type {HTMLInputElement} */ (this.form.querySelector(`[data-path="${path}"]`));
      control.value = value;
      control.dispatchEvent(new Event("replaced"));
    }
    this.tellApart([when.apart]);
    this.sends = true;
    this.form.requestSubmit(this.form.querySelector("button[data-save]"));
  }
}

/** Give a choice other options; what was chosen stays chosen if it is there. */
function refill(select, options) {
  const before = select.value;
  select.replaceChildren(...options);
  if (options.some(({ value }) => value === before)) select.value = before;
}
