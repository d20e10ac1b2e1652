// The cards of a fleet: each robot's activity, and the filter of cards.

import { refresh } from "./age.js";
import * as drawings from "./card_drawings.js";
import { follow } from "./live.js";
import { adopt } from "./region.js";
import { NUMERICAL_VALUE, PROV, TITLE, lf, taskName } from "./vocabulary.js";

const CARDS = "#robots li[data-robot]";
const LOW_PERCENT = 20; // as in root_views.py
const PRESENCES = ["online", "faulty", "offline"];
let filter;

export function start() {
  filter = document.querySelector("form[data-filters=robots]");
  if (!filter) return;
  filter.addEventListener("input", apply);
  filter.addEventListener("submit", (event) => event.preventDefault());
  follow(tell);
  adopt(apply);
  adopt(drawings.watch);
  const changes = { subtree: true, attributes: true, attributeFilter: ["data-state"] };
  new MutationObserver(apply).observe(document.querySelector("main"), changes);
}

/** Write tasks and times of motions into the cards: both are optional, so they have no addresses in the page. */
function tell(graph) {
  for (const card of document.querySelectorAll(CARDS)) {
    const task = graph.value(card.dataset.robot, lf("currentTask"));
    const said = card.querySelector("[data-activity]");
    const moving = graph.value(card.dataset.robot, lf("moving"))?.value === "true";
    const text = task ? doing(graph, task.value) : moving ? "moving" : "idle";
    if (said.textContent !== text) said.textContent = text;
    said.classList.toggle("busy", Boolean(task) || moving);
    const moved = graph.value(card.dataset.robot, lf("lastMoved"))?.value;
    move(card.querySelector("[data-moved]"), moving, moved);
    charge(card.querySelector("[data-battery]"), graph.value(card.dataset.robot, lf("batteryCharge"))?.value);
    tellText(card.querySelector("[data-holder]"), graph.follow(card.dataset.robot, [lf("lease"), lf("holder")])?.value);
    tellText(card.querySelector("[data-out]"), graph.value(card.dataset.robot, lf("outOfService"))?.value);
    drawings.moves(card, Boolean(task) || moving, moved);
  }
}

/** Return what a robot does, how far it is, and for whom. */
function doing(graph, task) {
  const share = graph.follow(task, [lf("progress"), NUMERICAL_VALUE])?.value;
  const who = graph.follow(task, [`${PROV}wasAssociatedWith`, TITLE])?.value;
  const far = share === undefined ? "" : ` ${Math.round(100 * Number(share))} %`;
  return taskName(task) + far + (who ? ` for ${who}` : "");
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

function move(element, moving, stamp) {
  if (moving) return element.replaceChildren();
  const time = element.querySelector("time");
  if (!stamp || time?.dateTime === stamp) return;
  const fresh = Object.assign(document.createElement("time"), { dateTime: stamp });
  refresh(fresh);
  element.replaceChildren("moved ", fresh);
}

function apply() {
  const { text, presence, kind } = Object.fromEntries(new FormData(filter));
  const wanted = String(text).trim().toLowerCase().split(/\s+/);
  const cards = /** @type {HTMLElement[]} */ ([...document.querySelectorAll(CARDS)]);
  const counts = new Map();
  offer(new Set(cards.map((card) => card.dataset.modelName).filter(Boolean)));
  let shown = 0;
  for (const card of cards) {
    const state = card.querySelector(".state")?.dataset.state;
    counts.set(state, (counts.get(state) ?? 0) + 1);
    const said = `${card.dataset.name} ${card.querySelector("h3").textContent}`.toLowerCase();
    const fits = (!presence || state === presence) && (!kind || card.dataset.modelName === kind);
    const hidden = !fits || !wanted.every((word) => said.includes(word));
    if (card.hidden !== hidden) card.hidden = hidden;
    if (!hidden) shown += 1;
  }
  count(counts);
  document.getElementById("shown").textContent = shown === cards.length ? "" : `${shown} of ${cards.length} shown`;
  document.getElementById("none-shown").hidden = shown > 0 || !cards.length;
}

function count(counts) {
  const text = PRESENCES.filter((name) => counts.has(name)).map((name) => [name, `${counts.get(name)} ${name}`]);
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

/** Robots that joined after the page was served may be of a kind missing in the filter. */
function offer(kinds) {
  const select = filter.elements.kind;
  const known = new Set([...select.options].map(({ value }) => value));
  for (const kind of kinds) if (!known.has(kind)) select.add(new Option(kind));
}
