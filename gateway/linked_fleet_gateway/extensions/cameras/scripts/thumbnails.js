// Small pictures of a robot's cameras, which link their pages.

import { showLive } from "../../pages/scripts/src/live_picture.js";
import { parse } from "../../pages/scripts/src/ntriples.js";
import { TITLE } from "../../pages/scripts/src/vocabulary.js";

const CONTAINS = "http://www.w3.org/ns/ldp#contains";
const INTERVAL_S = 1;

export function start() {
  const place = document.querySelector("[data-cameras]");
  if (place) list(place).catch((error) => console.debug("the cameras cannot be had at present:", error));
}

async function list(place) {
  const { cameras } = place.dataset;
  const answer = await fetch(cameras, { headers: { Accept: "application/n-triples" } });
  if (!answer.ok) return;
  const graph = parse(await answer.text());
  const found = graph.values(cameras, CONTAINS).map(({ value }) => thumbnail(value, graph.value(value, TITLE)?.value ?? "camera"));
  place.querySelector(".thumbnails").replaceChildren(...found);
  place.hidden = !found.length;
}

function thumbnail(iri, title) {
  const link = Object.assign(document.createElement("a"), { href: iri });
  const image = Object.assign(document.createElement("img"), { alt: "", width: 160, height: 120, hidden: true });
  link.append(image, title);
  let end;
  // Invisible pictures are not rendered by the robot.
  new IntersectionObserver((entries) => {
    const seen = entries.at(-1).isIntersecting;
    if (!seen) end = end?.();
    else end ??= showLive(image, iri, INTERVAL_S);
  }).observe(link);
  return link;
}
