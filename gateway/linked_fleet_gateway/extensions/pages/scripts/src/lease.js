// The control lease of this robot: shown, taken, renewed while the page is open, and released.

import { say } from "./say.js";
import { holds } from "./control.js";
import { held, leaseOf } from "./presence.js";
import { adopt } from "./region.js";
import { send } from "./request.js";
import { statements } from "./ntriples.js";
import { lf, localName } from "./vocabulary.js";

const ASK_MS = 3000;
const LEASE_S = 120;
const RENEW_BELOW_S = 60;
/** Leases that are followed. */
const observed = new Set();
const INTEGER = "http://www.w3.org/2001/XMLSchema#integer";

export function start() {
  const place = document.querySelector("[data-lease]");
  if (place) new Control(place);
  observed.add(place?.dataset.lease);
  const forms = (root) => root.querySelectorAll("form[data-needs]").forEach(observe);
  adopt(forms);
  // Forms of actions come when they are opened.
  document.addEventListener("included", ({ target }) => observe(target));
}

/** Follow who has the control on which a form depends. */
function observe(form) {
  const iri = leaseOf(form);
  if (!iri || observed.has(iri)) return;
  observed.add(iri);
  const look = async () => {
    const { graph } = await send("GET", iri);
    if (!graph) return;
    const { state, holder } = leaseIn(graph, iri);
    held(iri, state === "held" && !holds(iri) ? holder : "");
  };
  look();
  setInterval(() => document.hidden || look(), ASK_MS);
}

/** @returns {{state: string, holder: string, left: number}} what a graph says of a lease, with the seconds to its end */
function leaseIn(graph, iri) {
  const of = (name) => graph.value(iri, lf(name))?.value;
  const left = (Date.parse(of("expires") ?? "") - Date.now()) / 1000;
  return { state: localName(of("state") ?? lf("unknown")), holder: of("holder") ?? "", left };
}

class Control {
  constructor(place) {
    this.iri = place.dataset.lease;
    this.place = place;
    this.state = place.querySelector(".state");
    this.text = place.querySelector(".holder");
    this.button = place.querySelector("button");
    this.problem = place.querySelector(".error");
    this.button.onclick = () => (holds(this.iri) ? this.ask("DELETE") : this.take());
    this.look();
    setInterval(() => document.hidden || this.look(), ASK_MS);
  }

  async look() {
    if (this.looking || this.asking) return;
    this.looking = true;
    const { graph } = await send("GET", this.iri);
    this.looking = false;
    if (!graph || this.asking) return;
    const { state, holder, left } = leaseIn(graph, this.iri);
    this.show(state, holder, left);
    if (this.mine && left < RENEW_BELOW_S) this.take();
  }

  show(state, holder, left) {
    this.state.dataset.state = state;
    this.state.textContent = say(state);
    this.mine = state === "held" && holds(this.iri);
    const until = left > 0 ? say(" for {seconds} s", { seconds: Math.ceil(left) }) : "";
    this.text.textContent = state !== "held" ? say("Nobody has it.") : this.mine ? say("You have control.") : `${holder}${until}`;
    held(this.iri, state === "held" && !this.mine ? holder : "");
    this.button.hidden = state === "held" && !this.mine;
    delete this.button.dataset.unready;
    this.button.textContent = this.mine ? say("Give back") : say("Take control");
    const detail = { lease: this.iri, state, holder, mine: this.mine, look: () => this.look() };
    this.place.dispatchEvent(new CustomEvent("control", { bubbles: true, detail }));
  }

  take() {
    const holder = document.getElementById("who")?.textContent.trim() || "somebody at a browser";
    const body = statements([
      [lf("holder"), { kind: "literal", value: holder }],
      [lf("leaseDuration"), { kind: "literal", value: String(LEASE_S), datatype: INTEGER }],
    ]);
    return this.ask("PUT", body);
  }

  async ask(method, body) {
    if (this.asking) return;
    this.asking = true;
    this.button.disabled = true;
    const { problem } = await send(method, this.iri, { body });
    this.button.disabled = false;
    this.asking = false;
    this.problem.hidden = !problem;
    this.problem.textContent = problem ? `${problem.title}. ${problem.detail}` : "";
    this.look();
  }
}
