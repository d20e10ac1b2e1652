// Filters rows of tables by a word, or by the contents of their cells.

import { say } from "./say.js";
import { adopt } from "./region.js";

export function start() {
  for (const filter of document.querySelectorAll("form[data-rows]")) {
    const choose = () => apply(filter);
    filter.addEventListener("input", choose);
    filter.addEventListener("submit", (event) => event.preventDefault());
    adopt(choose);
  }
}

function apply(filter) {
  const place = document.getElementById(filter.dataset.rows);
  if (!place) return;
  const { text, ...chosen } = Object.fromEntries(new FormData(filter));
  const words = String(text).trim().toLowerCase().split(/\s+/);
  const rows = /** @type {HTMLElement[]} */ ([...place.querySelectorAll("[data-row]")]);
  let shown = 0;
  for (const row of rows) {
    const said = row.textContent.toLowerCase();
    const fits = Object.entries(chosen).every(([name, value]) => !value || row.getAttribute(`data-${name}`) === value);
    row.hidden = !fits || !words.every((word) => said.includes(word));
    if (!row.hidden) shown += 1;
  }
  /** @type {NodeListOf<HTMLElement>} */
  const chapters = place.querySelectorAll("[data-chapter]");
  for (const chapter of chapters) chapter.hidden = !chapter.querySelector("[data-row]:not([hidden])");
  filter.querySelector("output").textContent = shown === rows.length ? "" : say("{shown} of {length} shown", { shown, length: rows.length });
  /** @type {HTMLElement | null} */
  const none = place.querySelector("[data-none]");
  if (none) none.hidden = shown > 0 || !rows.length;
}
