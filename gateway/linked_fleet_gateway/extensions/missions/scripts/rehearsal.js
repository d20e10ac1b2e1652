// What a rehearsal says of each step, and the motions of a robot as a path that a ghost follows.

import { say } from "../../pages/scripts/src/say.js";
import { positionsIn } from "../../pages/scripts/src/targets.js";
import { NUMERICAL_VALUE, RDF_TYPE, lf, localName } from "../../pages/scripts/src/vocabulary.js";

/**
 * @typedef {{path: string, seconds: number, reason: string, free: string, joints: Map<string, number>}} StepRehearsal
 * @typedef {{seconds: number, steps: StepRehearsal[]}} Rehearsal
 */

/** @returns {Rehearsal} */
export function rehearsalIn(/** @type {import("../../pages/scripts/src/ntriples.js").Graph | undefined} */ graph) {
  const [root] = [...(graph?.subjects ?? [])].find(([, facts]) => facts.get(RDF_TYPE)?.some(({ value }) => value === lf("Rehearsal"))) ?? [];
  if (!root) return { seconds: 0, steps: [] };
  const steps = graph.values(root, lf("stepRehearsal")).map(({ value }) => stepIn(graph, `_:${value}`));
  return { seconds: secondsOf(graph, root), steps };
}

function stepIn(graph, node) {
  const free = graph.value(node, lf("collisionFree"))?.value;
  return {
    path: graph.value(node, lf("stepPath"))?.value ?? "",
    seconds: secondsOf(graph, node),
    reason: graph.value(node, lf("reason"))?.value ?? "",
    free: free === "true" ? "free" : free === undefined ? "" : say("its way is not checked for collisions"),
    joints: positionsIn(graph, node),
  };
}

function secondsOf(graph, node) {
  const inner = graph.value(node, lf("duration"));
  return Number(graph.value(`_:${inner?.value}`, NUMERICAL_VALUE)?.value ?? 0);
}

/** Return a step of a rehearsal in words. */
export function noteOf(/** @type {StepRehearsal[]} */ steps) {
  const why = steps.find(({ reason }) => reason)?.reason;
  if (why) return say("not rehearsed: {why}", { why });
  const [{ free }] = steps;
  const each = steps.map(({ seconds }) => `${seconds.toFixed(1)} s`);
  return [each.length > 2 ? `${each[0]}, … ${each.at(-1)}` : each.join(", "), free].filter(Boolean).join(", ");
}

/**
 * Return the path that the joints of a robot take, from where they are now.
 *
 * @param {StepRehearsal[]} steps
 * @param {string} robot its IRI
 * @param {(joint: string) => number | undefined} now the position of a joint by its name
 */
export function waypointsOf(steps, robot, now) {
  const own = steps.filter(({ joints }) => [...joints.keys()].some((iri) => iri.startsWith(robot)));
  const all = new Map(own.flatMap(({ joints }) => [...joints.keys()]).map((iri) => [iri, now(localName(iri))]));
  const places = new Map([...all].filter(([, at]) => at !== undefined));
  const found = [{ atTime: 0, joints: new Map(places) }];
  for (const { seconds, joints } of own) {
    for (const [iri, at] of joints) places.set(iri, at);
    found.push({ atTime: found.at(-1).atTime + Math.max(seconds, 0.01), joints: new Map(places) });
  }
  return found;
}
