// Positions of joints in a graph.

import { NUMERICAL_VALUE, lf } from "./vocabulary.js";

/** @returns {Map<string, number>} the positions that a node states by `lf:target`, in rad or m by the joint's IRI */
export function positionsIn(graph, node) {
  const found = new Map();
  for (const { value } of graph.values(node, lf("target"))) {
    const target = `_:${value}`;
    const joint = graph.value(target, lf("ofJoint"))?.value;
    const inner = graph.value(target, lf("value"));
    const position = Number(graph.value(`_:${inner?.value}`, NUMERICAL_VALUE)?.value);
    if (joint && Number.isFinite(position)) found.set(joint, position);
  }
  return found;
}
