// Where things are, as read from their descriptions. Metre.

import { key } from "./ntriples.js";
import { lf } from "./vocabulary.js";

export const MATHS = "http://vocab.arvida.de/2015/06/maths/vocab#";
const VOM_UNIT = "http://vocab.arvida.de/2015/06/vom/vocab#unit";
const MILLIMETRE = "http://qudt.org/vocab/unit/MilliM";

/**
 * @param {import("./ntriples.js").Graph} graph
 * @param {string} iri of the placed thing
 * @returns {{position: number[], orientation: number[]}|undefined} in metre; undefined while it is unknown
 */
export function poseOf(graph, iri) {
  const read = (path, axes) => axes.map((axis) => length(graph, graph.follow(iri, [lf(path)]), axis));
  const xyz = ["x", "y", "z"].map((axis) => MATHS + axis);
  const position = read("position", xyz);
  const orientation = graph.value(iri, lf("orientation")) ? read("orientation", [...xyz, lf("w")]) : [0, 0, 0, 1];
  return [...position, ...orientation].every(Number.isFinite) ? { position, orientation } : undefined;
}

/** Return a number of a node in metre; unchanged without a known unit. */
export function length(graph, node, predicate) {
  if (!node) return NaN;
  const scale = graph.value(key(node), VOM_UNIT)?.value === MILLIMETRE ? 0.001 : 1;
  return number(graph.value(key(node), predicate)) * scale;
}

function number(term) {
  return term?.kind === "literal" && term.value.trim() ? Number(term.value) : NaN;
}
