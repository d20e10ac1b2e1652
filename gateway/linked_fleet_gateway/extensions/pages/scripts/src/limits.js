// Limits of numbers that depend on other fields, such as the unit.

import { number } from "./format.js";

const BOUNDLESS = 1e6;

/**
 * @typedef {{when?: Record<string, string[]>, min?: number, max?: number, exclusive?: ("min"|"max")[]}} Limits
 */

/** Apply the limits for the present choices to every number field, and show them beside it. */
export function applyLimits(form) {
  for (const input of form.querySelectorAll("input[data-limits]")) {
    const limits = limitsOf(input);
    for (const end of ["min", "max"]) {
      if (limits?.[end] === undefined) input.removeAttribute(end);
      else input.setAttribute(end, String(limits[end]));
    }
    say(input, limits && !boundless(limits) ? range(limits, unitOf(input)) : "");
  }
}

/** Return an error for a number outside its limits; empty if it is within. */
export function outside(input) {
  const limits = input.dataset?.limits ? limitsOf(input) : plainLimits(input);
  if (!limits) return "";
  const value = Number(input.value);
  if (Number.isNaN(value)) return "This is no number.";
  const open = (end) => limits.exclusive?.includes(end);
  const low = limits.min !== undefined && (value < limits.min || (open("min") && value === limits.min));
  const high = limits.max !== undefined && (value > limits.max || (open("max") && value === limits.max));
  return low || high ? `This must be ${range(limits, unitOf(input))}.` : "";
}

/** Return whether limits are only those of the number type, which nobody needs to see. @param {Limits} limits */
function boundless({ min, max }) {
  return Math.abs(min) >= BOUNDLESS && Math.abs(max) >= BOUNDLESS;
}

function plainLimits(input) {
  if (input.type !== "number" && input.inputMode !== "decimal") return undefined;
  /** @type {Limits} */
  const limits = {};
  for (const end of ["min", "max"]) if (input.getAttribute(end)) limits[end] = Number(input.getAttribute(end));
  return limits;
}

/** @returns {Limits|undefined} the ones whose conditions hold */
function limitsOf(input) {
  /** @type {Limits[]} */
  const all = JSON.parse(input.dataset.limits);
  return all.find(({ when = {} }) => Object.entries(when).every(([path, values]) => values.includes(sibling(input, path)?.value)));
}

/** Return the field of the same node with this path. */
function sibling(input, path) {
  const node = (each) => each.parentElement.closest("fieldset[data-path], form.invoke");
  const home = node(input);
  return [...home.querySelectorAll("input[data-path], select[data-path]")].find(
    (each) => each.dataset.path === path && node(each) === home,
  );
}

/** Return the chosen unit's label in the list of units. */
function unitOf(input) {
  const paths = new Set(JSON.parse(input.dataset.limits ?? "[]").flatMap(({ when = {} }) => Object.keys(when)));
  const units = [...paths].filter((path) => /[#/]unit$/.test(path)).map((path) => sibling(input, path));
  return units[0]?.selectedOptions?.[0]?.textContent.trim() ?? units[0]?.dataset.label ?? "";
}

/** @param {Limits} limits */
function range({ min, max, exclusive = [] }, unit) {
  const low = min === undefined ? "" : `${exclusive.includes("min") ? "more than" : "from"} ${number(min)}`;
  const high = max === undefined ? "" : `${exclusive.includes("max") ? "less than" : low ? "" : "at most"} ${number(max)}`.trim();
  return `${[low, high].filter(Boolean).join(" to ")} ${unit}`.trim();
}

let said = 0;

function say(input, text) {
  let place = document.getElementById(input.dataset.range ?? "");
  if (!place) {
    place = document.createElement("small");
    place.className = "range";
    place.id = `range-${++said}`;
    input.dataset.range = place.id;
    (input.closest("label") ?? input).after(place);
    const ids = [input.getAttribute("aria-describedby"), place.id].filter(Boolean);
    input.setAttribute("aria-describedby", ids.join(" "));
  }
  if (place.textContent !== text) place.textContent = text;
}
