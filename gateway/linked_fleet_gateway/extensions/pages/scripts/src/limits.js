// Limits of numbers that depend on other fields, such as the unit.

import { message, say } from "./say.js";
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
    tellField(input, limits && !boundless(limits) ? range(limits, unitOf(input)) : "");
  }
}

/** Return an error for a number outside its limits; empty if it is within. */
export function outside(input) {
  const limits = input.dataset?.limits ? limitsOf(input) : plainLimits(input);
  if (!limits) return "";
  const value = Number(input.value);
  if (Number.isNaN(value)) return say("This is no number.");
  const open = (end) => limits.exclusive?.includes(end);
  const low = limits.min !== undefined && (value < limits.min || (open("min") && value === limits.min));
  const high = limits.max !== undefined && (value > limits.max || (open("max") && value === limits.max));
  return low || high ? say("This must be {range}.", { range: range(limits, unitOf(input)) }) : "";
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
  const ends = { low: number(min ?? NaN), high: number(max ?? NaN) };
  const [above, below] = [exclusive.includes("min"), exclusive.includes("max")];
  return `${say(sentence(min !== undefined, max !== undefined, above, below), ends)} ${unit}`.trim();
}

/** Return the message about a range of these ends. */
function sentence(hasLow, hasHigh, above, below) {
  if (!hasLow) return below ? message("less than {high}") : message("at most {high}");
  if (!hasHigh) return above ? message("more than {low}") : message("from {low}");
  if (above) return below ? message("more than {low} to less than {high}") : message("more than {low} to {high}");
  return below ? message("from {low} to less than {high}") : message("from {low} to {high}");
}

let said = 0;

function tellField(input, text) {
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
