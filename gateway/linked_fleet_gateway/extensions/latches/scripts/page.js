// Stops that hold, on all pages: the stop button latches what it stops, and a bar says what stays still, since when and by
// whom, until somebody resets it.

import { say } from "../../pages/scripts/src/say.js";
import { confirmed } from "../../pages/scripts/src/confirm.js";
import { element } from "../../pages/scripts/src/elements.js";
import { robotCount } from "../../pages/scripts/src/format.js";
import { notice } from "../../pages/scripts/src/notice.js";
import { key, parse } from "../../pages/scripts/src/ntriples.js";
import { apply } from "../../pages/scripts/src/presence.js";
import { send } from "../../pages/scripts/src/request.js";
import { watch } from "../../pages/scripts/src/socket.js";
import { RDF_TYPE, lf } from "../../pages/scripts/src/vocabulary.js";

const CREATED = "http://purl.org/dc/terms/created";
const ENDED = "http://www.w3.org/ns/prov#endedAtTime";
const SUCCEEDED = lf("succeeded");
const FORBIDDEN = 403;
const HTTP_CREATED = 201;
const ASK_MS = 500;
const MOST_ASKED = 20;

/** @typedef {{iri: string, about: string, by: string, since: string}} Latch */
let root = "";
/** The IRI of the fleet. */
let fleet = "";
let isLive = false;
/** @type {HTMLElement|undefined} */
let bar;
/** @type {Map<string, string>} how the stops of this page went, by the robot or fleet */
const standing = new Map();
/** @type {Latch[]} */
let latches = [];

export function start() {
  root = document.body.dataset.root ?? "";
  if (!root) return;
  fleet = new URL(root, document.baseURI).href;
  const list = `${root}stopLatches`;
  const may = document.body.dataset.may?.split(" ");
  isLive = !may || may.includes("subscribe");
  if (isLive) watch(list, { interval: 0.2, depth: "this" }, take);
  else read(list);
  /** @type {Promise<number>|undefined} */
  let latching;
  document.addEventListener("stopping", (event) => (latching = latch(list, stoppedBy(told(event).action))));
  document.addEventListener("stopped", async (event) => {
    const { action, invocation, isConfirmed } = told(event);
    const status = await latching;
    // What has begun between a stop and its latch is stopped too. While a stop is not confirmed, nothing begins.
    if (isConfirmed && status === HTTP_CREATED) fetch(action, { method: "POST", keepalive: true, cache: "no-store" }).catch(() => {});
    const answers = invocation ? await follow(stoppedBy(action), invocation) : [];
    if (status === FORBIDDEN) for (const { iri } of answers) await latch(list, iri); // not the fleet, but these robots
    if (!isLive) read(list);
  });
}

/** @returns {{action: string, invocation: string|null, isConfirmed: boolean}} */
function told(/** @type {Event} */ event) {
  return /** @type {CustomEvent} */ (event).detail;
}

/** @returns {string} the robot or the fleet that an action stops */
function stoppedBy(/** @type {string} */ action) {
  return new URL(action.replace(/actions\/[^/]+$/, ""), document.baseURI).href;
}

/** Latch what is being stopped, and return the status of the answer; 0 without one. One that holds already stays. */
async function latch(/** @type {string} */ list, /** @type {string} */ about) {
  try {
    const headers = { "Content-Type": "application/json" };
    const response = await fetch(list, { method: "POST", headers, body: JSON.stringify({ about }), keepalive: true, cache: "no-store" });
    if (!response.ok && (response.status !== FORBIDDEN || about !== fleet)) {
      const { title = String(response.status), detail = "" } = await response.json().catch(() => ({}));
      notice(say("The stop does not hold, so that robots may move again: {title}. {detail}", { title, detail }));
    }
    return response.status;
  } catch (error) {
    console.debug("the stop is not latched:", error); // the button says that the gateway does not answer
    return 0;
  }
}

/** Say when all that was stopped stands, and return what the robots answered. */
async function follow(/** @type {string} */ about, /** @type {string} */ invocation) {
  for (let asked = 0; asked < MOST_ASKED; asked++) {
    const graph = await described(invocation);
    const ended = graph?.value(invocation, ENDED)?.value;
    if (graph && ended) {
      const robots = graph.values(invocation, lf("answer")).map((answer) => answerIn(graph, key(answer)));
      const all = graph.value(invocation, lf("state"))?.value === SUCCEEDED;
      const began = graph.value(invocation, CREATED)?.value ?? ended;
      const seconds = ((Date.parse(ended) - Date.parse(began)) / 1000).toFixed(1);
      standing.set(about, words(robots, all, ended, seconds));
      show();
      return robots;
    }
    await new Promise((resolve) => setTimeout(resolve, ASK_MS));
  }
  standing.set(about, say("The stop is not confirmed. Use the hardware stop."));
  show();
  return [];
}

/** @returns {Promise<import("../../pages/scripts/src/ntriples.js").Graph|undefined>} */
async function described(/** @type {string} */ iri) {
  try {
    const response = await fetch(iri, { headers: { Accept: "application/n-triples" }, cache: "no-store" });
    return response.ok ? parse(await response.text()) : undefined;
  } catch {
    return undefined; // the gateway is away
  }
}

/** @typedef {{iri: string, robot: string, stands: boolean, word: string}} Answer */

/** @returns {Answer} */
function answerIn(graph, answer) {
  const word = graph.value(answer, lf("reason"))?.value ?? "";
  const iri = graph.value(answer, lf("ofRobot"))?.value ?? fleet;
  return { iri, robot: robotOf(iri), stands: word === "succeeded", word };
}

/** @param {Answer[]} robots */
function words(robots, /** @type {boolean} */ all, /** @type {string} */ ended, /** @type {string} */ seconds) {
  const at = clock(ended);
  const late = robots.filter(({ stands }) => !stands).map(({ robot, word }) => `${robot} (${word})`);
  if (late.length) return say("{robots}: not confirmed. Use the hardware stop.", { robots: late.join(", ") });
  if (!all) return say("The stop is not confirmed. Use the hardware stop.");
  if (robots.length > 1) return say("All {robots} stand since {at}, {seconds} s after the stop.", { robots: robotCount(robots.length), at, seconds });
  return say("It stands since {at}, {seconds} s after the stop.", { at, seconds });
}

function clock(/** @type {string} */ time) {
  return new Date(time).toLocaleTimeString(document.documentElement.lang === "de" ? "de" : "en-GB");
}

async function read(/** @type {string} */ list) {
  const graph = await described(list);
  if (graph) take(graph);
}

function take(graph) {
  latches = graph.having(RDF_TYPE, lf("StopLatch")).map((iri) => ({
    iri,
    about: graph.value(iri, lf("latchAbout"))?.value ?? "",
    by: graph.value(iri, lf("latchedBy"))?.value ?? "",
    since: graph.value(iri, CREATED)?.value ?? "",
  }));
  latches.sort((one, other) => one.about.length - other.about.length || one.about.localeCompare(other.about));
  for (const about of standing.keys()) if (!latches.some((each) => each.about === about)) standing.delete(about);
  show();
}

function show() {
  const here = latches.filter(concerns);
  if (!here.length) {
    bar?.remove();
    bar = undefined;
    return;
  }
  bar ??= document.body.appendChild(element("section", { id: "latch-bar", ariaLabel: say("Stops that hold") }));
  const lines = bar.querySelector("ul") ?? bar.appendChild(element("ul", { role: "status" }));
  lines.replaceChildren(...here.map(line));
  apply();
}

/** The page of a robot tells of that robot and of the fleet, every other page of all. */
function concerns(/** @type {Latch} */ { about }) {
  const robot = document.body.dataset.kind === "robot" ? document.body.dataset.resource : undefined;
  return !robot || about === fleet || about === robot;
}

function nameOf(/** @type {Latch} */ { about }) {
  return about === fleet ? say("The stop of all robots") : say("The stop of {robot}", { robot: robotOf(about) });
}

/** @returns {string} the name of the robot with an IRI */
function robotOf(/** @type {string} */ iri) {
  return decodeURIComponent(new URL(iri).pathname.split("/").at(-2) ?? "");
}

function line(/** @type {Latch} */ latch) {
  const how = standing.get(latch.about);
  const what = element("span", {}, element("a", { href: latch.iri, textContent: nameOf(latch) }), " ", say("holds since {at}, {by}.", { at: clock(latch.since), by: latch.by }), how && ` ${how}`);
  const button = element("button", { type: "button", textContent: say("Reset"), onclick: () => reset(latch) });
  button.dataset.needs = "reset";
  return element("li", {}, what, button);
}

async function reset(/** @type {Latch} */ latch) {
  const question = say("Reset: {title}? Robots may move again, and nothing starts by itself.", { title: nameOf(latch) });
  if ((await confirmed(question, { yes: say("Reset"), no: say("Keep it") })) === undefined) return;
  const { problem } = await send("DELETE", latch.iri);
  if (problem) notice(`${problem.title}. ${problem.detail}`);
  if (!isLive) read(`${root}stopLatches`);
}
