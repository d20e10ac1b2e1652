// The pages of components that are moved by hand: a stick for a base, buttons for an arm.

import { say } from "../../pages/scripts/src/say.js";
import { notice } from "../../pages/scripts/src/notice.js";

export function start() {
  show("[data-drive]", () => import("./drive.js"), say("The stick"));
  show("[data-jog]", () => import("./jog.js"), say("The panel for jogging"));
}

function show(selector, load, what) {
  const section = document.querySelector(selector);
  if (!section) return;
  load().then(
    (made) => made.show(section),
    (error) => notice(say("{what} could not be fetched: {message}", { what, message: error.message })),
  );
}
