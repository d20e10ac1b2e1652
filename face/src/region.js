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
let running;
let wanted = false;

/** Have a function called with each part of the page that is new, first with all of it. */
export function adopt(adopter) {
  adopters.add(adopter);
  adopter(document.body);
}

export function start() {
  for (const region of document.querySelectorAll(REGION)) served.set(region.id, plain(region));
}

export function regions() {
  return document.querySelectorAll(REGION).length;
}

/** Whether anything was replaced. Those who ask while it is under way get one further round together. */
export function refresh() {
  if (running) {
    wanted = true;
    return running;
  }
  running = rounds().finally(() => (running = undefined));
  return running;
}

async function rounds() {
  let changed = false;
  do {
    wanted = false;
    changed = (await round()) || changed;
    await new Promise((resolve) => setTimeout(resolve, changed ? 0 : 1));
    if (wanted) await new Promise((resolve) => setTimeout(resolve, SPACING_MS));
  } while (wanted);
  return changed;
}

async function round() {
  let response;
  try {
    response = await fetch(location.href, { headers: { Accept: "text/html" }, cache: "no-cache" });
  } catch {
    return false; // the connection says so
  }
  if (!response.ok) return false;
  agree(response);
  const page = new DOMParser().parseFromString(await response.text(), "text/html");
  return [...page.querySelectorAll(REGION)].filter(renew).length > 0;
}

function renew(fresh) {
  const text = plain(fresh);
  const old = document.getElementById(fresh.id);
  if (!old || served.get(fresh.id) === text || busy(old)) return false;
  served.set(fresh.id, text);
  const section = document.importNode(fresh, true);
  for (const kept of KEPT.flatMap((each) => [...old.querySelectorAll(each)])) {
    match(section, kept)?.replaceWith(kept);
  }
  old.replaceWith(section);
  for (const adopter of adopters) adopter(section);
  return true;
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
