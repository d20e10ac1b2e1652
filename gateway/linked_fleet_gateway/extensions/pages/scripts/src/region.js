// Fetches sections that may change together with their page, and replaces those that differ.

import { agree } from "./gateway_clock.js";

const REGION = "section[data-region][id]";
const LIVE = "[data-subject][data-path]";
const SPACING_MS = 700;
// Opened parts, and plots with their data, move into the new section.
const KEPT = ["details[data-include][open]", "figure.plot", "#scene"];

/** @type {Map<string, string>} the served text, without live values */
const served = new Map();
const adopters = new Set();
let running = false;
let wanted = false;
let held = false;
let asking = new AbortController();

/** Call a function with each new part of the page, first with the whole page. */
export function adopt(adopter) {
  adopters.add(adopter);
  adopter(document.body);
}

export function start() {
  for (const region of document.querySelectorAll(REGION)) served.set(region.id, plain(region));
}

/** Fetch the page no more until `release`, not even what is on its way. */
export function hold() {
  held = true;
  asking.abort();
}

export function release() {
  held = false;
  asking = new AbortController();
  if (wanted) refresh();
}

/** Fetch the page again, unless that was just done. New parts are passed to the functions of `adopt`. */
export async function refresh() {
  wanted = true;
  if (running || held) return;
  running = true;
  try {
    while (wanted && !held) {
      wanted = false;
      await round();
      await new Promise((resolve) => setTimeout(resolve, SPACING_MS));
    }
  } finally {
    running = false;
  }
}

async function round() {
  let page;
  const sentMs = Date.now();
  try {
    const response = await fetch(location.href, { headers: { Accept: "text/html" }, cache: "no-cache", signal: asking.signal });
    if (!response.ok) return;
    agree(response, sentMs);
    page = new DOMParser().parseFromString(await response.text(), "text/html");
  } catch {
    return; // the lost connection is shown elsewhere
  }
  dropNoscript(page);
  const fresh = [...page.querySelectorAll(REGION)];
  for (const old of document.querySelectorAll(REGION)) if (!fresh.some(({ id }) => id === old.id) && !busy(old)) leave(old);
  fresh.forEach((region, index) => (document.getElementById(region.id) ? renew(region) : enter(region, fresh[index - 1])));
}

function leave(region) {
  served.delete(region.id);
  region.remove();
  for (const adopter of adopters) adopter(document.createDocumentFragment());
}

function enter(fresh, before) {
  const section = document.importNode(fresh, true);
  const place = before && document.getElementById(before.id);
  if (place) place.after(section);
  else document.querySelector("main").append(section);
  welcome(section, plain(fresh));
}

function welcome(section, text) {
  served.set(section.id, text);
  for (const adopter of adopters) adopter(section);
}

function renew(fresh) {
  const text = plain(fresh);
  const old = document.getElementById(fresh.id);
  if (served.get(fresh.id) === text || busy(old)) return;
  const section = document.importNode(fresh, true);
  for (const kept of KEPT.flatMap((each) => [...old.querySelectorAll(each)])) {
    match(section, kept)?.replaceWith(kept);
  }
  old.replaceWith(section);
  welcome(section, text);
}

/** Return whether a section is in use; it is tried again after another change, or when the user leaves it. */
function busy(region) {
  const here = region.contains(document.activeElement) || region.querySelector("form[data-touched], dialog[open]");
  if (here) region.addEventListener("focusout", () => setTimeout(refresh), { once: true });
  return Boolean(here);
}

function match(section, kept) {
  if (kept.id) return section.querySelector(`#${CSS.escape(kept.id)}`);
  const same = (each) => ["include", "subject", "path"].every((name) => each.dataset[name] === kept.dataset[name]);
  return [...section.querySelectorAll(kept.localName)].find(same);
}

/** Remove what is for browsers without scripts: a DOMParser has none, and makes elements of it. */
function dropNoscript(root) {
  for (const each of root.querySelectorAll("noscript")) each.remove();
}

function plain(region) {
  const copy = region.cloneNode(true);
  dropNoscript(copy);
  for (const each of copy.querySelectorAll(LIVE)) {
    each.textContent = "";
    for (const name of ["value", "datetime", "data-state"]) each.removeAttribute(name);
  }
  for (const each of copy.querySelectorAll(".converted")) each.textContent = "";
  return copy.innerHTML;
}
