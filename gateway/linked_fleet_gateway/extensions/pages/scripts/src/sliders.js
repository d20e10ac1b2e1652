// A slider for each joint, which shows its position and sets its target.

import { say } from "./say.js";
import { number } from "./format.js";
import { jointTargets, Motion } from "./motion.js";
import { onJoints } from "./robot_state.js";
import { UNIT, lf } from "./vocabulary.js";

const TRY_MS = 250;
const UNIT_PATH = "http://vocab.arvida.de/2015/06/vom/vocab#unit";
// Continuous joints have no limits: the slider offers one turn in each direction.
const FULL_TURN = Math.PI;
const SHOWN = {
  RAD: { scale: 180 / Math.PI, symbol: "°", decimals: 1, step: 0.1 },
  M: { scale: 1000, symbol: "mm", decimals: 0, step: 1 },
};

let rows = new Map();

export function start() {
  const form = document.querySelector("form.motion[data-move]");
  if (form) new Sliders(form);
}

/** Set these targets, as a named pose does. */
export function aim(targets) {
  for (const [joint, position] of targets) rows.get(joint)?.aim(position);
  [...rows.values()][0]?.form.changed();
}

class Sliders {
  constructor(form) {
    this.form = form;
    this.action = form.dataset.move;
    // The browser would only allow its own steps; the shape accepts any value within the limits.
    form.noValidate = true;
    this.motion = new Motion(form);
    this.list = form.querySelector(".sliders");
    this.speed = form.querySelector("select[name=speed]");
    this.buttons = { send: form.querySelector("button[data-send]"), reset: form.querySelector("button[type=reset]") };
    this.buttons.send.addEventListener("click", () => this.send());
    // Enter in a field, and Go on a phone: a dry run. Only the button moves the robot.
    form.addEventListener("submit", (event) => event.preventDefault());
    form.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" || event.target.tagName !== "INPUT") return;
      event.preventDefault();
      this.changed();
    });
    form.addEventListener("reset", (event) => {
      event.preventDefault();
      this.forget();
      this.motion.forget();
    });
    this.speed.addEventListener("change", () => this.changed());
    this.say();
    this.ready = this.limits();
    onJoints((state, values) => this.show(state, values));
  }

  /** Set the limits of each joint, from the shape of the action; the first limits create the sliders. */
  async limits() {
    const found = new Map();
    try {
      const response = await fetch(this.action, { headers: { Accept: "text/html" } });
      const page = new DOMParser().parseFromString(await response.text(), "text/html");
      const input = page.querySelector("form.invoke input[data-limits]");
      for (const { when = {}, min, max } of JSON.parse(input?.dataset.limits ?? "[]")) {
        const radian = (when[UNIT_PATH] ?? when[UNIT])?.some((each) => /\/unit\/(RAD|M)$/.test(each));
        for (const joint of radian ? when[lf("ofJoint")] ?? [] : []) found.set(joint, { min, max });
      }
    } catch (error) {
      console.debug("the limits of the joints cannot be had:", error);
    }
    this.found = found;
  }

  show(state, values) {
    if (this.state !== state) {
      this.state = state;
      this.ready.then(() => this.build(state));
    }
    if (this.built !== state) return;
    for (const [index, joint] of state.joints.entries()) rows.get(joint)?.now(values.positions[index]);
  }

  build(state) {
    const names = new Map([...document.querySelectorAll('a[data-part-kind="joint"]')].map((each) => [each.href, each.dataset.part]));
    const before = rows;
    rows = new Map();
    state.joints.forEach((joint, index) => {
      // Joints that no motion may name, because they mimic others or are not driven, get no slider.
      if (!this.found.has(joint) && this.found.size) return;
      const unit = state.units[index] === "M" ? "M" : "RAD";
      const { min = -FULL_TURN, max = FULL_TURN } = this.found.get(joint) ?? {};
      const row = new Row(this, { joint, name: names.get(joint) ?? joint, unit, min, max });
      if (before.get(joint)?.target !== undefined) row.aim(before.get(joint).target);
      rows.set(joint, row);
    });
    this.list.replaceChildren(...[...rows.values()].map(({ element }) => element));
    this.built = state;
    state.joints.forEach((joint, index) => rows.get(joint)?.now(state.present.positions[index]));
  }

  get targets() {
    return [...rows.values()]
      .filter(({ target }) => target !== undefined)
      .map(({ joint, target, unit }) => ({ joint, position: target, unit }));
  }

  get body() {
    return jointTargets(this.targets, Number(this.speed.value));
  }

  /** Do a dry run once the user stops changing targets. */
  changed() {
    this.say();
    clearTimeout(this.trying);
    const { targets } = this;
    if (!targets.length) {
      this.motion.forget();
      return;
    }
    const joints = new Map(targets.map(({ joint, position }) => [joint, position]));
    this.motion.preview(joints);
    if ("closed" in this.form.dataset) return; // it would be refused, for the reason that is shown
    this.trying = setTimeout(() => this.motion.rehearse(this.action, this.body, joints), TRY_MS);
  }

  say() {
    const { length } = this.targets;
    this.buttons.send.textContent = length > 1 ? say("Move {length} joints", { length }) : say("Move");
    this.buttons.send.ariaDisabled = String(!length);
    this.buttons.reset.hidden = !length;
    this.form.toggleAttribute("data-aimed", length > 0);
  }

  async send() {
    clearTimeout(this.trying);
    if (!this.targets.length || this.form.getAttribute("aria-busy") === "true") return;
    if (await this.motion.begin(this.action, this.body)) this.forget();
  }

  forget() {
    clearTimeout(this.trying);
    for (const row of rows.values()) row.forget();
    this.say();
  }
}

class Row {
  constructor(form, { joint, name, unit, min, max }) {
    this.form = form;
    this.joint = joint;
    this.unit = unit;
    this.min = min;
    this.max = max;
    this.position = NaN;
    /** @type {number|undefined} */
    this.target = undefined;
    const { scale, symbol, step } = SHOWN[unit];
    const id = `slider-${rows.size}`;
    const range = { type: "range", id, min: String(min * scale), max: String(max * scale), step: String(step) };
    this.range = make("input", { ...range, oninput: () => this.chosen(this.range) });
    this.field = make("input", { ...range, type: "number", step: "any", id: `${id}-n`, inputMode: "decimal", oninput: () => this.chosen(this.field) });
    this.field.setAttribute("aria-label", say("target of {name} in {symbol}", { name, symbol }));
    this.value = make("output", { htmlFor: id, textContent: "…" });
    this.mark = make("i", { ariaHidden: "true" });
    const ends = make("small", { className: "ends" }, make("span", {}, shown(min, unit)), make("span", {}, shown(max, unit)));
    this.element = make(
      "div",
      { className: "slider" },
      make("label", { htmlFor: id }, name),
      this.value,
      make("div", { className: "track" }, this.range, this.mark, ends),
      make("span", { className: "number" }, this.field, ` ${symbol}`),
    );
    this.element.dataset.joint = joint;
  }

  /** Show the position of the joint; changes below the visible resolution are ignored. */
  now(position) {
    const { scale, decimals } = SHOWN[this.unit];
    const text = Number.isFinite(position) ? shown(position, this.unit) : "unknown";
    if (text === this.text) return;
    this.text = text;
    this.value.textContent = text;
    this.position = position;
    if (!Number.isFinite(position)) return;
    const share = Math.min(1, Math.max(0, (position - this.min) / (this.max - this.min)));
    this.mark.style.setProperty("--at", share.toFixed(4));
    if (this.target !== undefined) return;
    this.range.value = String(position * scale);
    if (document.activeElement !== this.field) this.field.value = fixed(position * scale, decimals);
  }

  chosen(input) {
    const { scale, decimals } = SHOWN[this.unit];
    const value = Number(input.value);
    if (input.value === "" || !Number.isFinite(value)) return;
    this.target = Math.min(this.max, Math.max(this.min, value / scale));
    if (input === this.range) this.field.value = fixed(value, decimals);
    else this.range.value = input.value;
    this.element.dataset.aimed = "";
    this.form.changed();
  }

  aim(position) {
    const { scale, decimals } = SHOWN[this.unit];
    this.target = position;
    this.range.value = String(position * scale);
    this.field.value = fixed(position * scale, decimals);
    this.element.dataset.aimed = "";
  }

  forget() {
    this.target = undefined;
    this.text = undefined;
    delete this.element.dataset.aimed;
    this.now(this.position);
  }
}

/** Round without a minus before zero. */
function fixed(value, decimals) {
  return (Number(value.toFixed(decimals)) + 0).toFixed(decimals);
}

function shown(position, unit) {
  const { scale, symbol, decimals } = SHOWN[unit];
  const text = number(Number((position * scale).toFixed(decimals)));
  return symbol === "°" ? `${text}°` : `${text} ${symbol}`;
}

function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}
