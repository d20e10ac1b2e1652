// The pages of components that are moved by hand: a stick for a base, buttons for an arm.

import { notice } from "../../pages/scripts/src/notice.js";

export function start() {
  show("[data-drive]", () => import("./drive.js"), "The stick");
  show("[data-jog]", () => import("./jog.js"), "The panel for jogging");
}

function show(selector, load, what) {
  const section = document.querySelector(selector);
  if (!section) return;
  load().then(
    (made) => made.show(section),
    (error) => notice(`${what} could not be fetched: ${error.message}`),
  );
}
