// The cards or rows of a fleet: each robot's activity, and the filter, which is in the address too.

import { say } from "./say.js";
import { refresh as refreshAge } from "./age.js";
import * as drawings from "./card_drawings.js";
import { follow } from "./live.js";
import { adopt, refresh } from "./region.js";
import { NUMERICAL_VALUE, PROV, RDF_TYPE, TITLE, lf, localName, taskName } from "./vocabulary.js";

const ROBOTS = "#robots [data-robot]";
const LOW_PERCENT = 20; // as in fleet_views.py
const PRESENCES = ["online", "faulty", "offline"];
const FILTERS = ["text", "presence", "kind", "tag"];
const LINKS = {
  good: say("at least 98 % of its frames arrive"),
  weak: say("less than 95 % of its frames of the last 10 s have arrived"),
  lost: say("connected, but no frame has arrived for 3 s"),
};
const VIEW = "lf-view-of-the-fleet";
const HIDDEN = "lf-hide-further";
const TYPING_MS = 300;
let filter;
let typing;

export function start() {
  offerToHide();
  filter = document.querySelector("form[data-filters=robots]");
  if (!filter || remembered()) return;
  filter.addEventListener("input", () => {
    if (!isPaged()) apply();
    clearTimeout(typing);
    typing = setTimeout(asked, isPaged() ? TYPING_MS : 0);
  });
  filter.addEventListener("submit", (event) => event.preventDefault());
  follow(tell);
  adopt(apply);
  adopt(drawings.watch);
  const changes = { subtree: true, attributes: true, attributeFilter: ["data-state"] };
  new MutationObserver(apply).observe(document.querySelector("main"), changes);
}

/** Remember whether the reader wants cards or a table. Return true if the page is left for a table. */
function remembered() {
  filter.addEventListener("click", ({ target }) => {
    const view = target instanceof Element ? target.closest("a[data-view]")?.dataset.view : undefined;
    if (view) localStorage.setItem(VIEW, view);
  });
  if (location.search || localStorage.getItem(VIEW) !== "table") return false;
  location.replace("?view=table");
  return true;
}

function offerToHide() {
  const line = document.getElementById("further");
  const button = line?.querySelector("button");
  if (!button) return;
  button.hidden = false;
  button.onclick = () => {
    localStorage.setItem(HIDDEN, "yes");
    line.hidden = true;
  };
  line.hidden = localStorage.getItem(HIDDEN) === "yes";
}

/** Whether the gateway filters, sorts and pages: it does so for tables, and for cards of a large fleet. */
function isPaged() {
  return Boolean(document.querySelector("#robots[data-paged]"));
}

function asked() {
  writeAddress();
  if (isPaged()) refresh();
}

/** Write the filter into the address, so that the view can be sent to somebody, and into the links of this page. */
function writeAddress() {
  const chosen = new FormData(filter);
  const here = with_(location.search, chosen);
  history.replaceState(history.state, "", here || location.pathname);
  /** @type {NodeListOf<HTMLAnchorElement>} */
  const links = document.querySelectorAll(".views a, table.fleet thead a");
  for (const link of links) link.search = with_(link.search, chosen);
}

function with_(search, chosen) {
  const said = new URLSearchParams(search);
  said.delete("page");
  for (const name of FILTERS) {
    const value = String(chosen.get(name) ?? "").trim();
    if (value) said.set(name, value);
    else said.delete(name);
  }
  return said.size ? `?${said}` : "";
}

/** Write what robots do into their cards or rows: all of it is optional, so it has no addresses in the page. */
function tell(graph) {
  if (isPaged()) countAll(graph);
  for (const card of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(ROBOTS))) {
    const iri = card.dataset.robot;
    const of = (name) => graph.value(iri, lf(name))?.value;
    const task = of("currentTask");
    const said = card.querySelector("[data-activity]");
    const moving = of("moving") === "true";
    const text = task ? doing(graph, task) : moving ? say("moving") : say("idle");
    if (said.textContent !== text) said.textContent = text;
    said.classList.toggle("busy", Boolean(task) || moving);
    const moved = of("lastMoved");
    move(card.querySelector("[data-moved]"), moving, moved);
    charge(card.querySelector("[data-battery]"), of("batteryCharge"));
    quality(card.querySelector("[data-link]"), of("linkQuality"));
    tellText(card.querySelector("[data-holder]"), graph.follow(iri, [lf("lease"), lf("holder")])?.value);
    tellText(card.querySelector("[data-stopped]"), of("stopped"));
    tellText(card.querySelector("[data-out]"), of("outOfService"));
    drawings.moves(card, Boolean(task) || moving, moved);
  }
}

/** Return what a robot does, how far it is, and for whom. */
function doing(graph, task) {
  const share = graph.follow(task, [lf("progress"), NUMERICAL_VALUE])?.value;
  const who = graph.follow(task, [`${PROV}wasAssociatedWith`, TITLE])?.value;
  const far = share === undefined ? "" : ` ${Math.round(100 * Number(share))} %`;
  return who ? say("{what} for {who}", { what: taskName(task) + far, who }) : taskName(task) + far;
}

function tellText(element, text) {
  element.hidden = text === undefined;
  const said = element.querySelector("bdi");
  if (text !== undefined && said.textContent !== text) said.textContent = text;
}

function charge(element, percent) {
  element.hidden = percent === undefined;
  if (percent === undefined) return;
  element.toggleAttribute("data-low", Number(percent) < LOW_PERCENT);
  const data = element.querySelector("data");
  if (data.value === percent) return;
  data.value = percent;
  data.textContent = String(Math.round(Number(percent)));
}

function quality(element, term) {
  element.hidden = term === undefined;
  if (term === undefined) return;
  const word = localName(term).replace("link", "").toLowerCase();
  if (element.dataset.link === word) return;
  element.dataset.link = word;
  element.title = LINKS[word] ?? "";
  element.lastElementChild.textContent = say(word);
}

function move(element, moving, stamp) {
  if (moving) {
    if (element.textContent !== say("now")) element.textContent = say("now");
    return;
  }
  const time = element.querySelector("time");
  if (!stamp || time?.dateTime === stamp) return;
  const fresh = Object.assign(document.createElement("time"), { dateTime: stamp });
  refreshAge(fresh);
  element.replaceChildren(Object.assign(document.createElement("span"), { className: "word", textContent: `${say("moved")} ` }), fresh);
}

/** A page of the table has not all robots. */
function countAll(graph) {
  const counts = new Map();
  for (const iri of graph.having(RDF_TYPE, lf("Robot"))) {
    const state = localName(graph.value(iri, lf("presence"))?.value ?? "");
    counts.set(state, (counts.get(state) ?? 0) + 1);
  }
  filter.hidden = !counts.size;
  count(counts);
}

function apply() {
  if (isPaged()) return;
  const { text, presence, kind, tag } = Object.fromEntries(new FormData(filter));
  const wanted = String(text).trim().toLowerCase().split(/\s+/);
  const cards = /** @type {HTMLElement[]} */ ([...document.querySelectorAll(ROBOTS)]);
  const counts = new Map();
  filter.hidden = !cards.length;
  offer("kind", new Set(cards.map((card) => card.dataset.modelName).filter(Boolean)));
  offer("tag", new Set(cards.flatMap((card) => tagsOf(card))));
  let shown = 0;
  for (const card of cards) {
    const state = card.querySelector(".state")?.dataset.state;
    counts.set(state, (counts.get(state) ?? 0) + 1);
    const { name, modelName, tags } = card.dataset;
    const said = `${name} ${card.querySelector(":is(h3, th)").textContent} ${modelName} ${tags}`.toLowerCase();
    const fits = (!presence || state === presence) && (!kind || modelName === kind) && (!tag || tagsOf(card).includes(String(tag)));
    const hidden = !fits || !wanted.every((word) => said.includes(word));
    if (card.hidden !== hidden) card.hidden = hidden;
    if (!hidden) shown += 1;
  }
  count(counts);
  document.getElementById("shown").textContent = shown === cards.length ? "" : say("{shown} of {length} shown", { shown, length: cards.length });
  const none = document.getElementById("none-shown");
  if (none) none.hidden = shown > 0 || !cards.length;
}

function tagsOf(card) {
  return card.dataset.tags.split(",").filter(Boolean);
}

function count(counts) {
  const text = PRESENCES.filter((name) => counts.has(name)).map((name) => [name, `${counts.get(name)} ${say(name)}`]);
  const box = document.getElementById("counts");
  if (!box || box.textContent.trim().replace(/\s+/g, " ") === text.map(([, each]) => each).join(" ")) return;
  box.replaceChildren(
    ...text.flatMap(([name, each]) => {
      const state = Object.assign(document.createElement("span"), { className: "state", textContent: each });
      state.dataset.state = name;
      return [state, " "];
    }),
  );
}

/** Robots that joined after the page was served may be of a kind, or have a tag, that is missing in the filter. */
function offer(name, values) {
  const select = filter.elements[name];
  const known = new Set([...select.options].map(({ value }) => value));
  for (const value of values) if (!known.has(value)) select.add(new Option(value));
  if (name === "tag") select.closest(".field").hidden = select.options.length < 2;
}
