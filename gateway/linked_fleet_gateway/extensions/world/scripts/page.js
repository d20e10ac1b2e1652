// The world: its 3D scene, the list of its objects with their forms, and motions that were refused.

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
}

function draw(scene) {
  import("./scene_world.js").then(
    ({ show }) => show(scene),
    (error) => notice(`The scene could not be fetched: ${error.message}`),
  );
}
