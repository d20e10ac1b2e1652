// The page of a base: a stick to drive it by hand.

import { notice } from "../../pages/scripts/src/notice.js";

export function start() {
  /** @type {HTMLElement | null} */
  const section = document.querySelector("[data-drive]");
  if (!section) return;
  import("./drive.js").then(
    ({ show }) => show(section),
    (error) => notice(`The stick could not be fetched: ${error.message}`),
  );
}
