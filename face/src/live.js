// Live values: each element that names a subject and a path shows what the last message says.

import { refresh as refreshAge } from "./age.js";
import { converted, number } from "./format.js";
import { key } from "./ntriples.js";
import { adopt, refresh } from "./region.js";
import { rest } from "./shown.js";
import { watch } from "./socket.js";
import { UNKNOWN, localName } from "./vocabulary.js";

const LIVE = "[data-subject][data-path]:not(figure)";
// These change and cannot be observed: their page asks again.
const ASKING = new Set(["subscriptions", "subscription", "lease"]);
const ASK_AGAIN_MS = 3000;

/** @type {Map<Element, {subject: string, path: string[], shown?: string}>} */
let elements = new Map();
let pending = new Map();
let latest;
let before;
const followers = new Set();

/** Be told of every message about what this page shows. */
export function follow(follower) {
  followers.add(follower);
  if (latest) follower(latest);
}

export function start() {
  const { resource, observable, kind } = document.body.dataset;
  adopt(collect);
  if (observable !== undefined) watch(resource, { interval: 0.1 }, take);
  else if (ASKING.has(kind)) setInterval(() => document.hidden || refresh(), ASK_AGAIN_MS);
}

function collect() {
  const found = document.querySelectorAll(LIVE);
  elements = new Map([...found].map((each) => [each, elements.get(each) ?? address(each)]));
  if (latest) show(latest);
}

function address(element) {
  return { subject: element.dataset.subject, path: element.dataset.path.split(/\s+/) };
}

function take(graph) {
  const first = !latest;
  latest = graph;
  const shown = show(graph);
  for (const follower of followers) follower(graph);
  const now = rest(graph, shown);
  // The page may be older than the first message.
  if (first || now !== before) refresh();
  before = now;
}

/** Note what has changed, to be written in the next frame; the pairs of subject and predicate that are shown. */
function show(graph) {
  const shown = new Set();
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
 * What a path leads to, and the node that says it. A hop `^IRI` goes backwards, to what has the node as that value; of
 * several such, to the first from which the path goes on.
 *
 * @param {import("./ntriples.js").Graph} graph
 * @returns {{node: string, term: import("./ntriples.js").Term}|undefined}
 */
export function reach(graph, node, [hop, ...path]) {
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
    time.textContent = localName(term.value);
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
  data.textContent = unknown ? "unknown" : Number.isNaN(value) ? term.value : number(value);
  data.value = unknown ? "" : term.value;
  const next = data.parentElement?.querySelector(":scope > .converted");
  if (next) next.textContent = converted(value, data.dataset.unit);
}

function writeState(element, term) {
  const text = term.kind === "iri" ? localName(term.value) : term.value;
  element.textContent = text;
  if ("state" in element.dataset) element.dataset.state = text;
}
