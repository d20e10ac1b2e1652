// Motions that were refused, on the page of the world: what would meet, where, and links to both.

import { refresh } from "../../pages/scripts/src/age.js";
import { key } from "../../pages/scripts/src/ntriples.js";
import { watch } from "../../pages/scripts/src/socket.js";
import { LABEL, lf } from "../../pages/scripts/src/vocabulary.js";

const CREATED = "http://purl.org/dc/terms/created";

export function start() {
  const list = document.querySelector("[data-refused]");
  if (!list) return;
  const iri = new URL(list.dataset.refused, document.baseURI).href;
  watch(iri, {}, (graph) => tell(list, graph, iri));
}

function tell(list, graph, iri) {
  const items = graph.values(iri, lf("collision")).map((node) => item(graph, key(node)));
  list.replaceChildren(...items);
  list.nextElementSibling.hidden = items.length > 0;
}

function item(graph, node) {
  const time = document.createElement("time");
  time.dateTime = graph.value(node, CREATED)?.value ?? "";
  refresh(time);
  const said = make("p", graph.value(node, lf("reason"))?.value ?? "", " ", make("small", time));
  const links = graph.values(node, lf("meets")).map(({ value }) => Object.assign(make("a", graph.value(value, LABEL)?.value ?? value), { href: value }));
  return make("li", said, make("p", ...links.flatMap((link, index) => (index ? [" · ", link] : [link]))));
}

/** @param {string} tag @param {...(string|Node)} children */
function make(tag, ...children) {
  const element = document.createElement(tag);
  element.append(...children);
  return /** @type {any} */ (element);
}
