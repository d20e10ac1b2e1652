// What robots, their parts and the fleet offer, as far as the reader may know it.

import { parse } from "./ntriples.js";
import { ACTION, HAS_PART, HYBRIT, RDF_TYPE, TITLE, lf, localName, segments, words } from "./vocabulary.js";

const LDP = "http://www.w3.org/ns/ldp#";
const MOST_KINDS = 100;

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
  const things = parts ? `<${robot}> <${HAS_PART}>* ?thing .` : `VALUES ?thing { <${robot}> }`;
  const asked = `SELECT DISTINCT ?thing ?action { ${things} ?thing <${ACTION}> ?action FILTER(!CONTAINS(STR(?action), "/invocations/")) }`;
  const found = (await select(query, asked)).map(({ thing, action }) => offered(thing.value, action.value, robot));
  return found.sort((one, other) => one.thing.localeCompare(other.thing) || one.name.localeCompare(other.name));
}

/**
 * Return kinds of actions of robots and their parts, each with the action of one of them.
 *
 * @param {string} query
 * @param {string} root robots' own kinds of actions, which are below it, are left out
 * @returns {Promise<{kind: string, name: string, action: string}[]>}
 */
export async function fetchKinds(query, root) {
  const asked = `SELECT ?name (MIN(STR(?offered)) AS ?action) {
  ?thing <${ACTION}> ?offered FILTER(?thing != <${root}> && !CONTAINS(STR(?offered), "/invocations/"))
} GROUP BY (REPLACE(STR(?offered), "^.*/", "") AS ?name) ORDER BY ?name LIMIT ${MOST_KINDS}`;
  const actions = (await select(query, asked)).map(({ action }) => action.value);
  const graphs = await Promise.allSettled(actions.map(fetchGraph)); // a robot may have left meanwhile
  const found = graphs.flatMap((each, index) => (each.status === "fulfilled" ? kindsIn(each.value, actions[index], root) : []));
  return found.sort((one, other) => one.name.localeCompare(other.name));
}

function kindsIn(/** @type {import("./ntriples.js").Graph} */ graph, /** @type {string} */ action, /** @type {string} */ root) {
  const kinds = graph.values(action, RDF_TYPE).map(({ value }) => value);
  return kinds.filter((kind) => ![HYBRIT, LDP, root].some((each) => kind.startsWith(each))).map((kind) => ({ kind, name: words(localName(kind)), action }));
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
