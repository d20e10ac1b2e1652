// Elements of SVG on the plan of the floor, whose y points down.

const SVG = "http://www.w3.org/2000/svg";
const LETTERS_PX = 12;

/** @param {string} tag @param {Record<string, any>} attributes @returns {any} an element of SVG */
export function draw(tag, attributes = {}) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  return element;
}

/** Return a name below a place of the world. `scale`: metres of a pixel. */
export function label(/** @type {string} */ text, /** @type {number[]} */ [x, y], /** @type {number} */ scale) {
  const size = LETTERS_PX * scale;
  const found = draw("text", { x, y: -y, "font-size": size, dy: 2 * size, "text-anchor": "middle" });
  found.textContent = text;
  return found;
}

/** @param {number[][]} corners in the world */
export function polygon(corners, className = "") {
  return draw("polygon", { class: className, points: corners.map(([x, y]) => `${x},${-y}`).join(" ") });
}

/** Return a group at a pose on the floor, in which x points where that looks. */
export function at(/** @type {number[]} */ [x, y], /** @type {number} */ heading) {
  return draw("g", { transform: transform([x, y], heading) });
}

export function transform(/** @type {number[]} */ [x, y], /** @type {number} */ heading) {
  return `translate(${x} ${-y}) rotate(${(-heading * 180) / Math.PI})`;
}

/** Return a place in words. */
export function words(/** @type {number[]} */ [x, y]) {
  return `${x.toFixed(2)} m, ${y.toFixed(2)} m`;
}
