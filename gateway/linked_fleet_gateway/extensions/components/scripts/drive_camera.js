// The picture of a camera of the robot beside its stick.

import { showLive } from "../../pages/scripts/src/live_picture.js";
import { send } from "../../pages/scripts/src/request.js";
import { lf } from "../../pages/scripts/src/vocabulary.js";

const CONTAINS = "http://www.w3.org/ns/ldp#contains";
const INTERVAL_S = 0.1;

/**
 * Show the first camera of the robot, if it has one.
 * @param {HTMLElement} section @param {() => void} seen called for each picture
 * @returns {() => void} what ends it
 */
export function camera(section, seen) {
  const image = /** @type {HTMLImageElement} */ (section.querySelector("img"));
  let [ended, end] = [false, () => {}];
  first(new URL(section.dataset.robot ?? "", document.baseURI).href).then((iri) => {
    if (iri && !ended) end = showLive(image, iri, INTERVAL_S, seen);
  });
  return () => {
    ended = true;
    image.hidden = true;
    end();
  };
}

async function first(robot) {
  const cameras = (await send("GET", robot)).graph?.value(robot, lf("cameras"))?.value;
  return cameras && (await send("GET", cameras)).graph?.values(cameras, CONTAINS)[0]?.value;
}
