// The scene of a robot on a page that is about something else, as the page of the robot draws it.

import { button, element } from "./elements.js";
import { whenWanted } from "./lazy_scene.js";
import { say } from "./say.js";

/**
 * Return the section of a robot's scene, not drawn so far; undefined if the robot has no model.
 *
 * @param {string} robot
 * @returns {Promise<HTMLElement|undefined>}
 */
export async function sceneOf(robot) {
  const page = await fetchPage(robot);
  const found = page?.querySelector("#scene[data-model]");
  if (!found) return undefined;
  const scene = /** @type {HTMLElement} */ (document.importNode(found, true));
  scene.dataset.lazily = "";
  scene.dataset.robot = robot;
  // By these links the scene knows the names of joints, and where a click on a part leads.
  const parts = element("span", { hidden: true }, ...[...page.querySelectorAll("a[data-part]")].map((each) => document.importNode(each, true)));
  scene.replaceChildren(element("p", { className: "fallback" }, say("The robot in 3D."), parts), button(say("Show the robot in 3D"), () => {}, { hidden: true }));
  return scene;
}

/** Draw a scene that is on the page, at once or on demand. */
export function drawScene(/** @type {HTMLElement} */ scene) {
  whenWanted(scene, () => import("./scene.js").then(({ show }) => show(scene)));
}

async function fetchPage(iri) {
  try {
    const response = await fetch(iri, { headers: { Accept: "text/html" }, cache: "no-cache" });
    return response.ok ? new DOMParser().parseFromString(await response.text(), "text/html") : undefined;
  } catch {
    return undefined; // what is drawn there is not needed to use the page
  }
}
