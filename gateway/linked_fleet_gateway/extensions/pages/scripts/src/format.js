// Numbers as people read them; gateway/linked_fleet_gateway/extensions/pages/texts.py does the same.

import { localized, say } from "./say.js";

const LARGE = 1e15;
const SMALL = 1e-9;
const DECIMALS = 4;
const DECIMALS_IN = { "N m": 2, N: 2, "rad/s": 3, "m/s": 3, kg: 3, s: 3 };
const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";

/**
 * Format with the decimals that suit `unit`, never in e-notation.
 *
 * @param {number} value
 * @param {string} [unit] as in `data-unit`
 */
export function number(value, unit = "") {
  if (!Number.isFinite(value)) return String(value);
  const size = Math.abs(value);
  if (size >= LARGE || (size > 0 && size < SMALL)) return power(value);
  let decimals = DECIMALS_IN[unit] ?? DECIMALS;
  if (size > 0 && size < 10 ** -decimals && !unit) decimals = Math.ceil(-Math.log10(size)) + 1;
  return localized(trimmed((value + 0).toFixed(decimals)));
}

function trimmed(text) {
  const short = text.includes(".") ? text.replace(/\.?0+$/, "") : text;
  return short === "-0" ? "0" : short;
}

/** Format a very large or small number as a power of ten. */
function power(value) {
  const [mantissa, exponent] = value.toExponential(2).split("e");
  const raised = String(Number(exponent)).replace(/[0-9]/g, (digit) => RAISED[digit]).replace("-", "⁻");
  return `${localized(trimmed(mantissa))}·10${raised}`;
}

const CONVERTED = { rad: [180 / Math.PI, "°", 1], m: [1000, "mm", 1] };

/**
 * Convert an angle to degrees and a short length to millimetres; empty if no conversion is needed.
 *
 * @param {number} value in `unit`
 * @param {string} unit as in `data-unit`
 */
export function converted(value, unit) {
  const known = CONVERTED[unit];
  if (!known || !Number.isFinite(value)) return "";
  const [scale, name, decimals] = known;
  const text = localized(String(Number((value * scale).toFixed(decimals)) + 0));
  return name === "°" ? `${text}°` : `${text} ${name}`;
}

export function robotCount(/** @type {number} */ count) {
  return count === 1 ? say("1 robot") : say("{count} robots", { count });
}
