// Cards of running tasks: progress, state and a button to end each; in the form that began it, else above the page.

import { say } from "./say.js";
import { follow as followPage } from "./live.js";
import { number } from "./format.js";
import { send } from "./request.js";
import { watch } from "./socket.js";
import { ACTION, NUMERICAL_VALUE, TITLE, lf, localName } from "./vocabulary.js";

const INTERVAL_S = 0.2;
// Successful tasks disappear by themselves; failed ones stay until they are dismissed.
const SEEN_MS = 8000;
const WANTED = new Set(["succeeded", "cancelled", "preempted"]);
const OPEN = new Set(["accepted", "running", "unknown"]);
// Its id means nothing to people.
const COMMAND = /\bcommand [0-9a-f]{8}-[0-9a-f-]{27}/;
const STORED = "linked-fleet tasks";

/** @type {Map<string, Card>} */
const cards = new Map();

export function start() {
  for (const iri of JSON.parse(sessionStorage.getItem(STORED) ?? "[]")) follow(iri);
  followPage((graph) => {
    for (const { value } of graph.values(document.body.dataset.resource, lf("currentTask"))) follow(value);
  });
}

/**
 * Show the progress of an invocation.
 *
 * @param {string} iri
 * @param {import("./ntriples.js").Graph} [graph] what is known of it
 * @param {HTMLFormElement} [form] that began it; the card of its former invocation is removed
 * @param {() => void} [onOver] is called when it has ended
 */
export function follow(iri, graph, form, onOver) {
  const place = form ? placeIn(form) : document.getElementById("tasks");
  const known = cards.get(iri);
  if (known && form) known.move(place, onOver);
  if (!place || known) return;
  const card = new Card(iri, place, onOver);
  cards.set(iri, card);
  store();
  if (graph) card.show(graph);
}

function placeIn(form) {
  let place = form.querySelector(".outcome");
  if (!place) {
    place = Object.assign(document.createElement("div"), { className: "outcome" });
    place.setAttribute("aria-live", "polite");
    form.append(place);
  }
  for (const [, card] of cards) if (!card.open && card.element.parentElement === place) card.remove();
  return place;
}

/** Show running tasks on the next page, too. */
function store() {
  sessionStorage.setItem(STORED, JSON.stringify([...cards].filter(([, card]) => card.open).map(([iri]) => iri)));
}

class Card {
  constructor(iri, place, onOver = () => {}) {
    this.iri = iri;
    this.onOver = onOver;
    this.open = true;
    this.element = document.createElement("article");
    this.element.className = "task";
    this.element.dataset.task = iri;
    this.link = this.add("a", { href: iri, textContent: localName(iri) });
    this.state = this.add("span", { className: "state", textContent: "…" });
    this.progress = this.add("progress", { max: 1, value: 0 });
    this.progress.setAttribute("aria-label", say("progress"));
    this.percent = this.add("small", { className: "percent" });
    this.reason = this.add("p", { className: "reason", hidden: true });
    this.cancel = this.add("button", { type: "button", textContent: say("Cancel"), hidden: true });
    this.cancel.onclick = () => this.end();
    this.close = this.add("button", { type: "button", className: "close", textContent: say("Dismiss"), hidden: true });
    this.close.onclick = () => this.remove();
    place.append(this.element);
    // A deleted invocation is no longer a task.
    this.stop = watch(iri, { interval: INTERVAL_S, onGone: () => this.remove() }, (message) => this.show(message));
  }

  /** The page may know a task before the form that began it. */
  move(place, onOver = () => {}) {
    place.append(this.element);
    this.onOver = onOver;
    if (!this.open) onOver();
  }

  add(name, members) {
    const element = Object.assign(document.createElement(name), members);
    this.element.append(element);
    return element;
  }

  show(graph) {
    const state = localName(graph.value(this.iri, lf("state"))?.value ?? lf("unknown"));
    const share = Number(graph.follow(this.iri, [lf("progress"), NUMERICAL_VALUE])?.value) || 0;
    this.link.textContent = words(graph, this.iri);
    this.state.dataset.state = this.element.dataset.state = state;
    this.state.textContent = say(state);
    this.progress.value = share;
    this.percent.textContent = `${number(Math.round(share * 100))} %`;
    this.say(graph.value(this.iri, lf("reason"))?.value ?? "");
    this.action = graph.value(this.iri, ACTION)?.value;
    this.cancel.hidden = !this.action;
    if (!OPEN.has(state) && this.open) this.over(state);
  }

  say(text) {
    this.reason.textContent = text.replace(COMMAND, say("another command"));
    this.reason.hidden = !text;
  }

  over(state) {
    this.open = false;
    this.onOver();
    store();
    // The caller is the subscription itself, which is ended afterwards.
    queueMicrotask(() => this.stop());
    this.close.hidden = false;
    if (WANTED.has(state)) setTimeout(() => this.remove(), SEEN_MS);
  }

  async end() {
    this.cancel.disabled = true;
    const { problem } = await send("POST", this.action);
    this.cancel.disabled = false;
    if (problem) this.say(`${problem.title}. ${problem.detail}`);
  }

  remove() {
    this.stop();
    this.element.remove();
    cards.delete(this.iri);
    store();
  }
}

/** Shorten `Invocation 3f… of /baxter/right_s1/actions/rotate`. */
function words(graph, iri) {
  const title = graph.value(iri, TITLE)?.value ?? localName(iri);
  const path = title.split(" of ").at(-1);
  const parts = path.split("/").filter((part) => part && part !== "actions");
  return parts.length > 1 ? `${parts.at(-1)} ${parts.slice(0, -1).join(" / ")}` : parts[0] ?? title;
}
