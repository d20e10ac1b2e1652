// Jogs joints or a hand of a robot by held buttons, over a stream of the actions of its component jogging.

import { say } from "../../pages/scripts/src/say.js";
import { notice } from "../../pages/scripts/src/notice.js";
import { ByHand } from "./by_hand.js";
import { HeldButtons } from "./held_buttons.js";

const WORDS = { control: "panel", begin: say("Jog"), doing: say("You jog"), idle: say("You do not jog.") };
const AXES = { linear: ["x", "y", "z"], angular: ["x", "y", "z"] };

export async function show(/** @type {HTMLElement} */ section) {
  const component = new URL(section.dataset.jog ?? "", document.baseURI);
  const answer = await fetch(component, { headers: { Accept: "application/td+json" } });
  if (!answer.ok) return notice(say("What can be jogged could not be fetched: {status} {statusText}", { status: answer.status, statusText: answer.statusText }));
  const { actions } = await answer.json();
  new Jog(section, component, actions);
}

class Jog {
  constructor(section, component, actions) {
    this.section = section;
    this.component = component;
    this.joints = actions.jogJoints.input.properties.velocities.properties;
    this.hand = actions.jogHand?.input.properties;
    this.fill();
    this.control = new HeldButtons(section);
    this.stream = new ByHand(section, WORDS, this);
    section.addEventListener("change", (event) => event.target.name === "jogged" && this.choose());
    this.choose();
  }

  /** Make a row of buttons for each joint and each axis, and the choices of the hand. */
  fill() {
    const rows = this.section.querySelector(".joints");
    for (const name of Object.keys(this.joints)) rows.append(row(name, name));
    this.part(".of-hand").hidden = !this.hand;
    if (!this.hand) return;
    const axes = this.section.querySelector(".axes");
    for (const axis of AXES.linear) axes.append(row(say("Along {axis}", { axis }), `linear ${axis}`));
    for (const axis of AXES.angular) axes.append(row(say("About {axis}", { axis }), `angular ${axis}`));
    for (const name of ["link", "frame"]) {
      this.choice(name).append(...this.hand[name].enum.map((each) => new Option(each, each)));
      this.choice(name).value = this.hand[name].default;
    }
  }

  part(selector) {
    return /** @type {HTMLElement} */ (this.section.querySelector(selector));
  }

  choice(name) {
    return /** @type {HTMLSelectElement} */ (this.section.querySelector(`select[name=${name}]`));
  }

  get ofHand() {
    return /** @type {HTMLInputElement} */ (this.section.querySelector("input[value=hand]")).checked;
  }

  /** Show the chosen buttons. Another choice ends the stream of the one before. */
  choose() {
    this.control.release();
    this.part(".joints").hidden = this.ofHand;
    this.part(".hand").hidden = !this.ofHand;
    this.stream.close();
  }

  action() {
    return new URL(`${this.component.pathname}/actions/${this.ofHand ? "jogHand" : "jogJoints"}`, this.component);
  }

  moves() {
    return this.control.value().length > 0;
  }

  input(share) {
    return this.ofHand ? this.twist(share) : { velocities: this.velocities(share) };
  }

  velocities(share) {
    const found = {};
    for (const [name, sign] of this.control.value().map(parsed)) found[name] = sign * share * this.joints[name].maximum;
    return found;
  }

  twist(share) {
    const found = { linear: {}, angular: {}, link: this.choice("link").value, frame: this.choice("frame").value };
    for (const [name, sign] of this.control.value().map(parsed)) {
      const [kind, axis] = name.split(" ");
      found[kind][axis] = sign * share * this.hand[kind].properties[axis].maximum;
    }
    return found;
  }

  figures() {
    return this.control.value().map(([sign, ...name]) => `${name.join("")} ${sign}`).join(", ") || say("Nothing is held");
  }
}

/** @returns {[string, number]} a name and 1 or -1 */
function parsed(held) {
  return [held.slice(1), held[0] === "+" ? 1 : -1];
}

function row(title, name) {
  const made = document.createElement("div");
  const label = document.createElement("span");
  label.textContent = title;
  made.append(label, button(title, "−", `-${name}`), button(title, "+", `+${name}`));
  return made;
}

function button(title, sign, held) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = sign;
  made.dataset.hold = held;
  made.setAttribute("aria-label", `${title} ${sign === "+" ? "plus" : "minus"}`);
  return made;
}
