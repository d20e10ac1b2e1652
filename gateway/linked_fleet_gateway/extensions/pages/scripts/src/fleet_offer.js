// What robots, their parts and the fleet offer, as far as the reader may know it.

import { parse } from "./ntriples.js";
import { ACTION, RDF_TYPE, TITLE, lf, segments, words } from "./vocabulary.js";

/** @typedef {{action: string, name: string, thing: string}} Offered */

/** @returns {Promise<{iri: string, title: string}[]>} */
export async function fetchRobots(/** @type {string} */ root) {
  const graph = await fetchGraph(root);
  const found = [...graph.subjects].filter(([, facts]) => facts.get(RDF_TYPE)?.some(({ value }) => value === lf("Robot")));
  const robots = found.map(([iri]) => ({ iri, title: `${segments(iri)[0]}: ${graph.value(iri, TITLE)?.value ?? ""}`.replace(/: $/, "") }));
  return robots.sort((one, other) => one.title.localeCompare(other.title));
}

/** @returns {Promise<Offered[]>} the actions of a robot and of its parts */
export async function fetchActions(/** @type {string} */ query, /** @type {string} */ robot, /** @type {boolean} */ parts) {
  const things = parts ? `FILTER(STRSTARTS(STR(?thing), "${robot}"))` : `VALUES ?thing { <${robot}> }`;
  const asked = `SELECT DISTINCT ?thing ?action { ${things} ?thing <${ACTION}> ?action FILTER(!CONTAINS(STR(?action), "/invocations/")) }`;
  const found = (await select(query, asked)).map(({ thing, action }) => offered(thing.value, action.value, robot));
  return found.sort((one, other) => one.thing.localeCompare(other.thing) || one.name.localeCompare(other.name));
}

/** Return the answers to a query. Raises an error with a sentence. */
export async function select(/** @type {string} */ query, /** @type {string} */ asked) {
  const response = await fetch(`${query}?${new URLSearchParams({ query: asked })}`, { headers: { Accept: "application/sparql-results+json" }, cache: "no-store" });
  if (!response.ok) throw new Error(await said(response));
  return (await response.json()).results.bindings;
}

function offered(thing, action, robot) {
  const inside = thing.startsWith(robot) ? decodeURIComponent(thing.slice(robot.length)) : thing;
  return { action, name: words(segments(action).at(-1)), thing: inside };
}

/** Return the statements of a resource. Raises an error with a sentence. */
export async function fetchGraph(iri) {
  const response = await fetch(iri, { headers: { Accept: "application/n-triples" }, cache: "no-cache" });
  if (!response.ok) throw new Error(await said(response));
  return parse(await response.text());
}

async function said(response) {
  const text = await response.text();
  try {
    return JSON.parse(text).detail ?? response.statusText;
  } catch {
    return response.statusText;
  }
}
