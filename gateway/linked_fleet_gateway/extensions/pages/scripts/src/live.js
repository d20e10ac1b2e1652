// Live values: each element with a subject and a path shows the value of the last message.

import { say } from "./say.js";
import { refresh as refreshAge } from "./age.js";
import { converted, number } from "./format.js";
import { fetchLayout, graphOfFrame } from "./frames.js";
import { key } from "./ntriples.js";
import { adopt, refresh } from "./region.js";
import { rest } from "./shown.js";
import { watch } from "./socket.js";
import { RESULT_TIME, UNKNOWN, lf, localName } from "./vocabulary.js";

const LIVE = "[data-subject][data-path]:not(figure)";
// These change but cannot be observed: their page polls.
const ASKING = new Set(["subscriptions", "subscription", "lease"]);
const ASK_AGAIN_MS = 3000;
// Subscribed without values, which come as small frames.
const THINGS = new Set(["robot", "joint", "link"]);
const FRAMES_S = 0.033; // 30 Hz
const SETTINGS_S = 0.1;

/** @type {Map<Element, {subject: string, path: string[], shown?: string}>} */
let elements = new Map();
let pending = new Map();
/** @type {Map<string, import("./ntriples.js").Graph>} the latest message by what is watched */
const latest = new Map();
const before = new Map();
/** @type {Map<string, () => void>} functions that end the subscription of a property */
const watched = new Map();
const followers = new Set();

/** Call a function for every message about what this page shows. */
export function follow(follower) {
  followers.add(follower);
  for (const graph of latest.values()) follower(graph);
}

export function start() {
  const { resource, observable, kind } = document.body.dataset;
  adopt(collect);
  const may = document.body.dataset.may?.split(" ");
  const follows = !may || may.includes("subscribe"); // guests do not
  // Whether the robot of an action is there cannot be observed at the action.
  if (!follows || kind === "action" || (observable === undefined && ASKING.has(kind))) setInterval(() => document.hidden || refresh(), ASK_AGAIN_MS);
  if (!follows) return;
  if (observable !== undefined && THINGS.has(kind)) {
    watch(resource, { depth: "this" }, (graph) => take(resource, graph));
    adopt(properties);
  } else if (observable !== undefined) watch(resource, {}, (graph) => take(resource, graph));
}

function collect() {
  const found = document.querySelectorAll(LIVE);
  elements = new Map([...found].map((each) => [each, elements.get(each) ?? address(each)]));
  for (const graph of latest.values()) show(graph);
}

/** Subscribe to each property whose value the page shows: as frames if it is measured, else on change. */
function properties() {
  const { resource } = document.body.dataset;
  const shown = new Map();
  for (const { subject, path } of elements.values()) {
    const below = subject !== resource && subject.startsWith(resource) && !path[0].startsWith("^");
    if (below) shown.set(subject, shown.get(subject) || path.at(-1) === RESULT_TIME);
  }
  for (const [subject, end] of watched) {
    if (shown.has(subject)) continue;
    end();
    watched.delete(subject);
  }
  for (const [subject, measured] of shown) if (!watched.has(subject)) watched.set(subject, property(subject, measured));
}

/** Subscribe to a property of this thing; a joint state is subscribed with its scene. */
function property(iri, measured) {
  if (iri === document.querySelector("[data-state][data-model]")?.dataset.state) return () => {};
  let end = () => {};
  let over = false;
  const begin = (layout) => {
    if (over) return;
    /** @type {import("./socket.js").Options} */
    const options = layout ? { protocol: "lf.frame", interval: FRAMES_S } : { interval: SETTINGS_S };
    end = watch(iri, options, (/** @type {any} */ message) => {
      const graph = layout && graphOfFrame(layout, message);
      if (graph) give(iri, graph);
      else if (!layout) take(iri, message);
    });
  };
  if (measured) fetchLayout(iri).then(begin, () => begin(undefined));
  else begin(undefined);
  return () => {
    over = true;
    end();
    latest.delete(iri);
  };
}

function address(element) {
  return { subject: element.dataset.subject, path: element.dataset.path.split(/\s+/) };
}

function take(iri, graph) {
  const first = !before.has(iri);
  const now = rest(graph, give(iri, graph));
  // The page may be older than the first message.
  if (first || now !== before.get(iri)) refresh();
  before.set(iri, now);
}

/** Show a message, and pass it to listeners; return the pairs of subject and predicate that are shown. */
export function give(iri, graph) {
  latest.set(iri, graph);
  const shown = show(graph);
  for (const follower of followers) follower(graph);
  return shown;
}

/** Collect changes for the next frame; return the pairs of subject and predicate that are shown. */
function show(graph) {
  const shown = new Set([...document.querySelectorAll("[data-robot]")].map(({ dataset }) => `${dataset.robot} ${lf("currentTask")}`));
  for (const [element, live] of elements) {
    const found = reach(graph, live.subject, live.path);
    if (!found) continue;
    const { node, term } = found;
    shown.add(`${node} ${live.path.at(-1)}`);
    if (term.value === live.shown) continue;
    live.shown = term.value;
    if (!pending.size) requestAnimationFrame(flush);
    pending.set(element, term);
  }
  return shown;
}

/**
 * Follow a path, and return its end and the node that has it. A step `^IRI` goes backwards, to nodes with this value;
 * if there are several, to the first from which the path continues.
 *
 * @param {import("./ntriples.js").Graph} graph
 * @param {import("./ntriples.js").Graph} graph
 * @param {string} node
 * @param {string[]} way
 * @returns {{node: string, term: import("./ntriples.js").Term}|undefined}
 */
export function reach(graph, node, way) {
  const [hop, ...path] = way;
  if (!path.length) {
    const term = graph.value(node, hop);
    return term && { node, term };
  }
  const next = hop.startsWith("^") ? graph.having(hop.slice(1), node) : graph.values(node, hop).map(key);
  for (const each of next) {
    const found = reach(graph, each, path);
    if (found) return found;
  }
  return undefined;
}

function flush() {
  const changes = pending;
  pending = new Map();
  for (const [element, term] of changes) write(element, term);
}

function write(element, term) {
  if (element instanceof HTMLTimeElement) writeTime(element, term);
  else if (element instanceof HTMLProgressElement) element.value = Number(term.value) || 0;
  else if (element instanceof HTMLDataElement) writeNumber(element, term);
  else if (element instanceof HTMLMeterElement) writeMeter(element, Number(term.value));
  else writeState(element, term);
}

function writeTime(time, term) {
  if (term.kind === "iri") {
    time.removeAttribute("datetime");
    time.textContent = say(localName(term.value));
  } else {
    time.dateTime = term.value;
    refreshAge(time);
  }
}

function writeMeter(meter, value) {
  if (Number.isFinite(value)) meter.value = value;
}

function writeNumber(data, term) {
  const unknown = term.value === UNKNOWN;
  const value = unknown ? NaN : Number(term.value);
  data.textContent = unknown ? say("unknown") : Number.isNaN(value) ? term.value : number(value, data.dataset.unit);
  data.value = unknown ? "" : term.value;
  const next = data.parentElement?.querySelector(":scope > .converted");
  if (next) next.textContent = converted(value, data.dataset.unit);
}

function writeState(element, term) {
  const text = term.kind === "iri" ? localName(term.value) : term.value;
  element.textContent = term.kind === "iri" || "state" in element.dataset ? say(text) : text;
  if ("state" in element.dataset) element.dataset.state = text;
}
