// The picture of a camera of the robot beside its stick.

import { parse } from "../../pages/scripts/src/ntriples.js";
import { watch } from "../../pages/scripts/src/socket.js";
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
  let [ended, shown, end] = [false, "", () => {}];
  first(section.dataset.robot).then((iri) => {
    if (!iri || ended) return;
    end = watch(iri, { protocol: "lf.jpeg", interval: INTERVAL_S }, (picture) => {
      const next = URL.createObjectURL(new Blob([picture], { type: "image/jpeg" }));
      image.src = next;
      image.hidden = false;
      if (shown) URL.revokeObjectURL(shown);
      shown = next;
      seen();
    });
  });
  return () => {
    ended = true;
    image.hidden = true;
    end();
  };
}

async function first(robot) {
  const iri = new URL(robot, document.baseURI).href;
  const cameras = (await graphOf(iri))?.value(iri, lf("cameras"))?.value;
  return cameras && (await graphOf(cameras))?.values(cameras, CONTAINS)[0]?.value;
}

async function graphOf(iri) {
  const answer = await fetch(iri, { headers: { Accept: "application/n-triples" } }).catch(() => undefined);
  return answer?.ok ? parse(await answer.text()) : undefined;
}
