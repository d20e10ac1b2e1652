// A mission as it is edited: its steps as nodes that know no page. Each operation changes the nodes in place.

import { say } from "../../pages/scripts/src/say.js";

/**
 * @typedef {object} Node
 * @property {number} id tells nodes apart while they are edited
 * @property {string} type
 * @property {Record<string, any>} said the members of the step in JSON, without those below it
 * @property {Node[]} below the steps below it
 * @typedef {{name: string, type: string, title?: string, minimum?: number, maximum?: number, default?: any, options?: string[]}} Parameter
 * @typedef {{title: string, holds: boolean, parameters: Parameter[], root: Node}} Mission
 */

export const KINDS = {
  invoke: say("Do an action"),
  sequence: say("One after the other"),
  parallel: say("At the same time"),
  firstOf: say("The first that succeeds"),
  repeat: say("Repeat"),
  wait: say("Wait"),
  confirm: say("Ask a person"),
  notify: say("Tell people"),
};
const BRANCHES = ["sequence", "parallel", "firstOf"];
const FRESH = { wait: { seconds: 1 }, repeat: { times: 2 }, confirm: { text: "" }, notify: { text: "" } };

let count = 0;

/** @returns {Node} */
export function fresh(/** @type {string} */ type) {
  return { id: ++count, type, said: { ...FRESH[type] }, below: [] };
}

/** @returns {Mission} */
export function emptyMission() {
  return { title: "", holds: false, parameters: [], root: fresh("sequence") };
}

/** @returns {boolean} */
export function holdsSteps(/** @type {Node} */ { type }) {
  return type === "repeat" || BRANCHES.includes(type);
}

/** @returns {Mission} the mission that is in JSON */
export function missionOf({ title = "", holds = false, parameters = [], step }) {
  return { title, holds, parameters: structuredClone(parameters), root: nodeOf(step) };
}

/** @returns {Node} */
function nodeOf({ type, steps, step, ...said }) {
  const below = (steps ?? (step ? [step] : [])).map(nodeOf);
  return { id: ++count, type, said: structuredClone(said), below };
}

/** Return the mission in JSON, without members that say nothing. */
export function jsonOf(/** @type {Mission} */ { title, holds, parameters, root }) {
  return { title, ...(holds && { holds }), ...(parameters.length && { parameters: parameters.map(told) }), step: stepOf(root) };
}

/** @returns {Record<string, any>} */
export function stepOf(/** @type {Node} */ { type, said, below }) {
  const steps = below.map(stepOf);
  if (type === "repeat") return { type, ...told(said), ...(steps.length && { step: steps[0] }) };
  return { type, ...told(said), ...(BRANCHES.includes(type) && { steps }) };
}

/** A text that a person is asked may be empty, so that the gateway says that it is not to be. */
function told(said) {
  return Object.fromEntries(Object.entries(said).filter(([name, value]) => value !== undefined && (value !== "" || name === "text") && !(Array.isArray(value) && !value.length)));
}

/** @returns {Generator<{node: Node, path: string, parent: Node | undefined, deep: number}>} all steps in their order */
export function* walk(/** @type {Node} */ node, path = "0", parent = undefined, deep = 0) {
  yield { node, path, parent, deep };
  for (const [index, each] of node.below.entries()) yield* walk(each, `${path}.${index}`, node, deep + 1);
}

/** @returns {{node: Node, path: string, parent: Node | undefined, deep: number} | undefined} */
export function find(/** @type {Node} */ root, /** @type {number} */ id) {
  return [...walk(root)].find(({ node }) => node.id === id);
}

/** Return the step that a path of the gateway names: rounds and the steps of inner missions are left out. */
export function at(/** @type {Node} */ root, /** @type {string} */ path) {
  const plain = path.split("/")[0].replace(/#\d+/g, "");
  return [...walk(root)].find((each) => each.path === plain)?.node;
}

/** Put a step below another one. A step that repeats has one step: two of them come into a sequence. */
export function insert(/** @type {Node} */ parent, /** @type {number} */ index, /** @type {Node} */ node) {
  if (parent.type !== "repeat" || !parent.below.length) {
    parent.below.splice(index, 0, node);
    return;
  }
  const [only] = parent.below;
  if (only.type === "sequence") only.below.splice(index > 0 ? only.below.length : 0, 0, node);
  else {
    const list = fresh("sequence");
    list.below = index > 0 ? [only, node] : [node, only];
    parent.below = [list];
  }
}

/** Take a step out, with those below it. */
export function remove(/** @type {Node} */ root, /** @type {number} */ id) {
  const { node, parent } = find(root, id);
  if (parent) parent.below.splice(parent.below.indexOf(node), 1);
  return node;
}

/** @returns {Node} a copy, without the names of steps, which are told apart */
export function copyOf(/** @type {Node} */ { type, said, below }) {
  const { name: _, ...rest } = structuredClone(said);
  return { id: ++count, type, said: rest, below: below.map(copyOf) };
}

/**
 * Return where a step would go by a key or a button: undefined if there is no such place.
 *
 * @param {Node} root
 * @param {number} id
 * @param {"up" | "down" | "out" | "in"} way
 * @returns {{parent: Node, index: number} | undefined} the index is that after the step was taken out
 */
export function placeFor(root, id, way) {
  const { parent } = find(root, id) ?? {};
  if (!parent) return undefined;
  const index = parent.below.findIndex((each) => each.id === id);
  if (way === "up") return index > 0 ? { parent, index: index - 1 } : undefined;
  if (way === "down") return index < parent.below.length - 1 ? { parent, index: index + 1 } : undefined;
  if (way === "out") return outside(root, parent);
  const before = parent.below.slice(0, index).reverse().find(holdsSteps) ?? parent.below.slice(index + 1).find(holdsSteps);
  return before && { parent: before, index: before.below.length };
}

/** Return the place after a step; a step that repeats has one step, so that it is the place after that one. */
function outside(root, inner) {
  const { parent } = find(root, inner.id);
  if (!parent) return undefined;
  return parent.type === "repeat" ? outside(root, parent) : { parent, index: parent.below.indexOf(inner) + 1 };
}

/** Move a step, unless it would be below itself. Return whether it has moved. */
export function move(/** @type {Node} */ root, /** @type {number} */ id, /** @type {Node} */ parent, /** @type {number} */ index) {
  const { node, parent: from } = find(root, id);
  if (!from || [...walk(node)].some((each) => each.node === parent)) return false;
  from.below.splice(from.below.indexOf(node), 1);
  insert(parent, Math.min(index, parent.below.length), node);
  return true;
}

/** Return the variables that steps may refer to: parameters, and members of results of named steps that are in use. */
export function variablesOf(/** @type {Mission} */ { parameters, root }) {
  const used = JSON.stringify(stepOf(root)).matchAll(/\{"variable":"([^"]+)"\}/g);
  return [...new Set([...parameters.map(({ name }) => name).filter(Boolean), ...[...used].map(([, name]) => name)])];
}

/** @returns {Map<any, any[]>} the values by their key */
export function groupsOf(all, key) {
  const found = new Map();
  for (const each of all) found.set(key(each), [...(found.get(key(each)) ?? []), each]);
  return found;
}

/** Call a parameter by another name, wherever it is used. */
export function rename(/** @type {Mission} */ mission, /** @type {string} */ before, /** @type {string} */ after) {
  for (const { node } of walk(mission.root)) node.said = renamed(node.said, before, after);
}

function renamed(said, before, after) {
  if (Array.isArray(said)) return said.map((each) => renamed(each, before, after));
  if (!said || typeof said !== "object") return said;
  const keys = Object.keys(said);
  if (keys.length === 1 && keys[0] === "variable" && said.variable === before) return { variable: after };
  return Object.fromEntries(keys.map((key) => [key, renamed(said[key], before, after)]));
}
