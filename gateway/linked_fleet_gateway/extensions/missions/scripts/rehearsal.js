// What a rehearsal says of each step, and the motions of a robot as a path that a ghost follows.

import { say } from "../../pages/scripts/src/say.js";
import { waypointsOf } from "../../pages/scripts/src/planned_path.js";
import { positionsIn } from "../../pages/scripts/src/targets.js";
import { NUMERICAL_VALUE, RDF_TYPE, lf, localName } from "../../pages/scripts/src/vocabulary.js";

/**
 * @typedef {import("../../pages/scripts/src/planned_path.js").Waypoint} Waypoint
 * @typedef {{path: string, seconds: number, reason: string, free: string, detour: string, way: Waypoint[], joints: Map<string, number>}} StepRehearsal
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
    detour: graph.value(node, lf("plannedBecause"))?.value ?? "",
    way: waypointsOf(graph, node),
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
  const [{ free, detour }] = steps;
  const each = steps.map(({ seconds }) => `${seconds.toFixed(1)} s`);
  const planned = detour && say("on a planned path: {value}", { value: detour });
  return [each.length > 2 ? `${each[0]}, … ${each.at(-1)}` : each.join(", "), free, planned].filter(Boolean).join(", ");
}

/**
 * Return the path that the joints of a robot take, from where they are now, with the step of each part of it.
 *
 * @param {StepRehearsal[]} steps
 * @param {string} robot its IRI
 * @param {(joint: string) => number | undefined} now the position of a joint by its name
 * @returns {(Waypoint & {step?: string})[]}
 */
export function pathOf(steps, robot, now) {
  const own = steps.filter(({ joints }) => [...joints.keys()].some((iri) => iri.startsWith(robot)));
  const all = new Map(own.flatMap(({ joints }) => [...joints.keys()]).map((iri) => [iri, now(localName(iri))]));
  const places = new Map([...all].filter(([, at]) => at !== undefined));
  /** @type {(Waypoint & {step?: string})[]} */
  const found = [{ atTime: 0, joints: new Map(places) }];
  for (const { path: step, seconds, way, joints } of own) {
    const begun = found.at(-1).atTime;
    for (const each of [...way, { atTime: Math.max(seconds, 0.01), joints }]) {
      for (const [iri, at] of each.joints) places.set(iri, at);
      found.push({ atTime: begun + each.atTime, joints: new Map(places), step });
    }
  }
  return found;
}
