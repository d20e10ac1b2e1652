// Faults on all pages: how many nobody has acknowledged, in the navigation and in the title, and what is wrong on the
// cards of robots, of which those with trouble come first.

import { say } from "../../pages/scripts/src/say.js";
import { notice } from "../../pages/scripts/src/notice.js";
import { parse } from "../../pages/scripts/src/ntriples.js";
import { adopt, refresh } from "../../pages/scripts/src/region.js";
import { send } from "../../pages/scripts/src/request.js";
import { watch } from "../../pages/scripts/src/socket.js";
import { RDF_TYPE, TITLE, lf, localName } from "../../pages/scripts/src/vocabulary.js";
import { offerTelling, tell } from "./telling.js";

const LINK = '.sections a[href$="/faults"]';
const CARDS = "#robots [data-robot]:has(.trouble)";
const SEVERITIES = ["critical", "error", "warning", "information"];
const PRESENCES = ["faulty", "offline"]; // worse than a warning, and not as bad as an error
const WELL = 9;

/** @typedef {{iri: string, title: string, about: string, severity: string, waits: boolean}} Fault */
/** @type {Fault[]} the open ones, the worst first */
let faults = [];
let title = "";

export function start() {
  /** @type {HTMLAnchorElement | null} */
  const link = document.querySelector(LINK);
  if (!link) return;
  title = document.title;
  const may = document.body.dataset.may?.split(" ");
  if (!may || may.includes("subscribe")) watch(link.href, { interval: 0.5, depth: "this" }, (graph) => take(graph, link));
  else read(link);
  adopt(showCards);
  offerTelling();
  document.addEventListener("click", (event) => {
    /** @type {HTMLAnchorElement | null} */
    const wanted = event.target instanceof Element ? event.target.closest("a[data-acknowledge]") : null;
    if (!wanted) return;
    event.preventDefault();
    wanted.blur(); // otherwise its section would wait for it to lose the focus
    acknowledge(wanted.href);
  });
}

async function read(link) {
  const response = await fetch(link.href, { headers: { Accept: "application/n-triples" }, cache: "no-cache" });
  if (response.ok) take(parse(await response.text()), link);
}

async function acknowledge(action) {
  const { problem } = await send("POST", action);
  if (problem) notice(`${problem.title}. ${problem.detail}`);
  refresh();
}

/** Show the faults of a description of their container. */
function take(graph, link) {
  const found = graph.having(RDF_TYPE, lf("Fault")).map((iri) => faultIn(graph, iri));
  faults = found.filter(Boolean).sort((one, other) => rank(one) - rank(other) || one.iri.localeCompare(other.iri));
  const waiting = faults.filter(({ waits }) => waits);
  count(link, waiting);
  showCards();
  tell(waiting);
}

/** @returns {Fault | undefined} */
function faultIn(graph, iri) {
  const state = localName(graph.value(iri, lf("state"))?.value ?? "");
  if (state === "faultCleared" || state === "faultRaised") return undefined;
  const said = (predicate) => graph.value(iri, predicate)?.value ?? "";
  const severity = localName(said(lf("severity")));
  return { iri, title: said(TITLE), about: said(lf("about")), severity, waits: state === "faultConfirmed" && severity !== "information" };
}

function rank({ severity }) {
  return 2 * SEVERITIES.indexOf(severity);
}

function count(link, waiting) {
  document.title = waiting.length ? `(${waiting.length}) ${title}` : title;
  const mark = link.querySelector(".attention") ?? link.appendChild(Object.assign(document.createElement("span"), { className: "attention" }));
  mark.hidden = !waiting.length;
  mark.textContent = String(waiting.length);
  mark.dataset.severity = waiting[0]?.severity ?? "";
  link.title = waiting.length ? say("{length} that nobody has acknowledged", { length: waiting.length }) : "";
}

/** Write into each card what is wrong, and move those with trouble to the front. */
function showCards() {
  const cards = /** @type {HTMLElement[]} */ ([...document.querySelectorAll(CARDS)]);
  for (const card of cards) {
    const own = faults.filter(({ about }) => about.startsWith(card.dataset.robot));
    show(card, own);
    const presence = PRESENCES.includes(card.querySelector(".state")?.dataset.state) ? rank({ severity: "error" }) + 1 : WELL;
    card.dataset.trouble = String(Math.min(presence, ...own.map(rank)));
  }
  const ordered = [...cards].sort((one, other) => Number(one.dataset.trouble) - Number(other.dataset.trouble));
  const byTrouble = document.querySelector('#robots[data-sort="trouble"]');
  if (byTrouble && ordered.some((card, index) => card !== cards[index])) cards[0].parentElement.append(...ordered);
}

function show(card, own) {
  const text = own.length > 1 ? say("{title} (and {value} more)", { title: own[0].title, value: own.length - 1 }) : own[0]?.title ?? "";
  const line = card.querySelector(".trouble");
  if (line.hidden === Boolean(own.length)) line.hidden = !own.length;
  if (line.textContent === text && line.querySelector("a")?.href === own[0]?.iri) return;
  const link = Object.assign(document.createElement("a"), { href: own[0]?.iri ?? "", textContent: text });
  line.replaceChildren(...(own.length ? [link] : []));
  line.dataset.severity = own[0]?.severity ?? "";
}
