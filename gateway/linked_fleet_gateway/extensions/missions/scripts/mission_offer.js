// What steps can do beside the actions of robots: run other missions.

import { fetchGraph } from "../../pages/scripts/src/fleet_offer.js";
import { RDF_TYPE, TITLE, lf } from "../../pages/scripts/src/vocabulary.js";

/** @returns {Promise<import("../../pages/scripts/src/fleet_offer.js").Offered[]>} the actions by which other missions run */
export async function fetchMissions(/** @type {string} */ missions, /** @type {string} */ own) {
  const graph = await fetchGraph(missions);
  const found = [...graph.subjects.keys()].filter((iri) => iri !== own && graph.values(iri, RDF_TYPE).some(({ value }) => value === lf("Mission")));
  const named = found.map((iri) => ({ action: `${iri}/actions/run`, name: graph.value(iri, TITLE)?.value ?? iri, thing: "" }));
  return named.sort((one, other) => one.name.localeCompare(other.name));
}

/** Return the robot of an action, or the container of missions, or the fleet. */
export function homeOf(/** @type {string} */ action, /** @type {string} */ root, /** @type {string} */ missions) {
  if (action.startsWith(`${missions}/`)) return missions;
  const [first, ...rest] = action.startsWith(root) ? action.slice(root.length).split("/") : [""];
  return first === "actions" || !rest.length ? root : `${root}${first}/`;
}
