// What cameras see, live while it is in view: on the wall of cameras, and small on the page of a robot.

import { showLive } from "../../pages/scripts/src/live_picture.js";
import { parse } from "../../pages/scripts/src/ntriples.js";
import { adopt } from "../../pages/scripts/src/region.js";
import { TITLE } from "../../pages/scripts/src/vocabulary.js";

const CONTAINS = "http://www.w3.org/ns/ldp#contains";
const REASON = "https://w3id.org/linked-fleet#reason";
const INTERVAL_S = 1;

export function start() {
  const place = document.querySelector("[data-cameras]");
  if (place) list(place).catch((error) => console.debug("the cameras cannot be had at present:", error));
  adopt((root) => root.querySelectorAll("a[data-camera]").forEach(show));
}

async function list(place) {
  const { cameras } = place.dataset;
  const answer = await fetch(cameras, { headers: { Accept: "application/n-triples" } });
  if (!answer.ok) return;
  const graph = parse(await answer.text());
  const found = graph.values(cameras, CONTAINS).map(({ value }) => link(graph, value));
  place.querySelector(".thumbnails").replaceChildren(...found);
  found.filter((each) => each.dataset.camera).forEach(show);
  place.hidden = !found.length;
}

/** Return the link to a camera, with its reason if it has no pictures. */
function link(graph, iri) {
  const found = Object.assign(document.createElement("a"), { href: iri });
  const reason = graph.value(iri, REASON)?.value;
  if (reason === undefined) found.dataset.camera = iri;
  found.append(graph.value(iri, TITLE)?.value ?? "camera");
  if (reason) found.append(Object.assign(document.createElement("small"), { textContent: reason }));
  return found;
}

/** Show the pictures of a camera in the link to it. */
function show(/** @type {HTMLElement} */ link) {
  const image = Object.assign(document.createElement("img"), { alt: "", width: 160, height: 120, hidden: true });
  link.prepend(image);
  let end;
  // Invisible pictures are not rendered by the robot.
  new IntersectionObserver((entries) => {
    const seen = entries.at(-1).isIntersecting;
    if (!seen) end = end?.();
    else end ??= showLive(image, link.dataset.camera ?? "", INTERVAL_S);
  }).observe(link);
}
