// Numbers as people read them; gateway/linked_fleet_gateway/extensions/pages/labels.py writes the same.

const LARGE = 1e6;
const SMALL = 1e-4;
const DECIMALS = 4;

/** @param {number} value */
export function number(value) {
  if (!Number.isFinite(value)) return String(value);
  const size = Math.abs(value);
  if (size >= LARGE || (size > 0 && size < SMALL)) return value.toExponential(DECIMALS).replace(/\.?0+e/, "e");
  return String(Number(value.toFixed(DECIMALS)) + 0);
}

const CONVERTED = { rad: [180 / Math.PI, "°", 1], m: [1000, "mm", 1] };

/**
 * An angle in degrees, a short length in millimetres; nothing for what needs no conversion.
 *
 * @param {number} value in `unit`
 * @param {string} unit as in `data-unit`
 */
export function converted(value, unit) {
  const known = CONVERTED[unit];
  if (!known || !Number.isFinite(value)) return "";
  const [scale, name, decimals] = known;
  const text = String(Number((value * scale).toFixed(decimals)) + 0);
  return name === "°" ? `${text}°` : `${text} ${name}`;
}
