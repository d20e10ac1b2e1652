// Sections that may change are fetched again with their page, and replaced where they differ from what was served.

import { agree } from "./age.js";

const REGION = "section[data-region][id]";
const LIVE = "[data-subject][data-path]";
const SPACING_MS = 700;
// What somebody has opened, and plots with their past, move into the new section.
const KEPT = ["details[data-include][open]", "figure.plot", "#scene"];

/** @type {Map<string, string>} what was served, without the values that are live */
const served = new Map();
const adopters = new Set();
let running = false;
let wanted = false;

/** Have a function called with each part of the page that is new, first with all of it. */
export function adopt(adopter) {
  adopters.add(adopter);
  adopter(document.body);
}

export function start() {
  for (const region of document.querySelectorAll(REGION)) served.set(region.id, plain(region));
}

/** Fetch the page again, at once if that was not just done. What is new is given to those who adopt it. */
export async function refresh() {
  wanted = true;
  if (running) return;
  running = true;
  try {
    while (wanted) {
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
    const response = await fetch(location.href, { headers: { Accept: "text/html" }, cache: "no-cache" });
    if (!response.ok) return;
    agree(response, sentMs);
    page = new DOMParser().parseFromString(await response.text(), "text/html");
  } catch {
    return; // that the connection is lost is said elsewhere
  }
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

/** Nothing is taken away under somebody's hands. It is tried again when something else changes, or they leave it. */
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

function plain(region) {
  const copy = region.cloneNode(true);
  for (const each of copy.querySelectorAll(LIVE)) {
    each.textContent = "";
    for (const name of ["value", "datetime", "data-state"]) each.removeAttribute(name);
  }
  for (const each of copy.querySelectorAll(".converted")) each.textContent = "";
  return copy.innerHTML;
}
