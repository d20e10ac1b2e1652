// The page of the world, the floor from above, and the scene of the world on any page.

import { say } from "../../pages/scripts/src/say.js";
import { whenWanted } from "../../pages/scripts/src/lazy_scene.js";
import { notice } from "../../pages/scripts/src/notice.js";
import * as arrange from "./arrange.js";
import * as refused from "./refused.js";

export function start() {
  arrange.start();
  refused.start();
  /** @type {HTMLElement | null} */
  const scene = document.querySelector("#scene[data-world]");
  if (scene) whenWanted(scene, () => draw(scene));
  /** @type {HTMLElement | null} */
  const floor = document.querySelector("[data-floor]");
  if (floor) drawFloor(floor);
}

function draw(scene) {
  import("./scene_world.js").then(
    ({ show }) => show(scene),
    (error) => notice(say("The scene could not be fetched: {message}", { message: error.message })),
  );
}

function drawFloor(floor) {
  import("./floor.js").then(
    ({ show }) => show(floor),
    (error) => notice(say("The plan of the floor could not be fetched: {message}", { message: error.message })),
  );
}
