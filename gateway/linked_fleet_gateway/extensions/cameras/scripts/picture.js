// The live pictures on the page of a camera.

import { showLive } from "../../pages/scripts/src/live_picture.js";

const INTERVAL_S = 0.1;

export function start() {
  /** @type {HTMLImageElement | null} */
  const image = document.querySelector("#seen > img");
  if (image) showLive(image, image.getAttribute("src") ?? "", INTERVAL_S);
}
