// The live pictures of a camera in an image: each message is a whole picture.

import { watch } from "./socket.js";

/**
 * Show the pictures of the camera at an address.
 * @param {HTMLImageElement} image @param {string} iri @param {number} interval in seconds
 * @param {() => void} seen called for each picture
 * @returns {() => void} what ends it
 */
export function showLive(image, iri, interval, seen = () => {}) {
  let shown = "";
  return watch(iri, { protocol: "lf.jpeg", interval }, (picture) => {
    const next = URL.createObjectURL(new Blob([picture], { type: "image/jpeg" }));
    image.src = next;
    image.hidden = false;
    // A picture may be dropped before it is decoded; the following one is shown.
    if (shown) URL.revokeObjectURL(shown);
    shown = next;
    seen();
  });
}
