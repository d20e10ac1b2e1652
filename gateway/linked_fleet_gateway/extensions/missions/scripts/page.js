// Missions: the builder, missions for chosen robots, and answers to runs that wait for people.

import { say } from "../../pages/scripts/src/say.js";
import { notice } from "../../pages/scripts/src/notice.js";
import * as group from "./group.js";
import * as run from "./run.js";

export function start() {
  run.start();
  group.start();
  /** @type {HTMLElement | null} */
  const builder = document.querySelector("#builder");
  if (builder) import("./builder.js").then(({ open }) => open(builder)).catch((error) => notice(say("The builder could not be opened: {message}", { message: error.message })));
}
