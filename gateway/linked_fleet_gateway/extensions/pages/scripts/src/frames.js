// Measured values as binary frames (docs/BINARY.md), converted to the triples that they stand for.

import { Graph, key, parse } from "./ntriples.js";
import { layoutFields, valueOf } from "./scene_state.js";
import { RESULT_TIME, UNKNOWN, lf } from "./vocabulary.js";

const RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#";
const XSD = "http://www.w3.org/2001/XMLSchema#";
// Visible resolution; more digits would be noise that is written again with every frame.
const DECIMALS = 5;
const NS_PER_MS = 1_000_000n;
const NS_PER_US = 1000n;

/**
 * @typedef {{subject: string, path: string[], type: string, offset: number}} NumberField
 * @typedef {{numbers: NumberField[], time?: {type: string, offset: number}, size: number}} Layout
 */

/**
 * Return the layout of a property's frames, found by the property's link.
 *
 * @param {string} iri
 * @returns {Promise<Layout|undefined>} undefined for a property without frames
 */
export async function fetchLayout(iri) {
  const head = await fetch(iri, { method: "HEAD", headers: { Accept: "application/n-triples" } });
  const address = /<([^>]+)>; *rel="describedby"/.exec(head.headers.get("link") ?? "")?.[1];
  if (!head.ok || !address) return undefined;
  const answer = await fetch(address, { headers: { Accept: "application/n-triples" } });
  if (!answer.ok) return undefined;
  return layoutIn(parse(await answer.text()), address);
}

/** @returns {Layout} as the graph describes it */
export function layoutIn(graph, address) {
  const numbers = [];
  let time;
  for (const { node, name, type, offset } of layoutFields(graph, graph.values(address, lf("field")))) {
    const subject = graph.value(node, lf("ofProperty"))?.value;
    const path = listOf(graph, graph.value(node, lf("valuePath"))).map(({ value }) => value);
    if (subject && path.length) numbers.push({ subject, path, type, offset });
    else if (name === "time" || name === "wall_ns") time = { type, offset };
  }
  return { numbers, time, size: Number(graph.value(address, lf("byteSize"))?.value) };
}

function listOf(graph, head) {
  const found = [];
  const seen = new Set();
  for (let cell = head; cell?.kind === "blank" && !seen.has(cell.value); cell = graph.value(key(cell), `${RDF}rest`)) {
    seen.add(cell.value);
    const first = graph.value(key(cell), `${RDF}first`);
    if (first) found.push(first);
  }
  return found;
}

/**
 * Return the triples of a frame, as in the property's own description.
 *
 * @param {Layout} layout
 * @param {ArrayBuffer} buffer
 * @returns {Graph|undefined} undefined if the frame has another layout
 */
export function graphOfFrame({ numbers, time, size }, buffer) {
  if (buffer.byteLength !== size) return undefined;
  const view = new DataView(buffer);
  const graph = new Graph();
  const inner = new Map();
  for (const { subject, path, type, offset } of numbers) {
    let node = subject;
    for (const hop of path.slice(0, -1)) {
      const name = `${node} ${hop}`;
      if (!inner.has(name)) {
        inner.set(name, `_:f${inner.size}`);
        graph.add(node, hop, { kind: "blank", value: inner.get(name).slice(2) });
      }
      node = inner.get(name);
    }
    graph.add(node, path.at(-1), numeral(Number(valueOf(view, type, offset))));
  }
  const ns = time && valueOf(view, time.type, time.offset);
  for (const subject of new Set(numbers.map((each) => each.subject))) graph.add(subject, RESULT_TIME, moment(ns));
  graph.timeS = secondsOf(ns);
  return graph;
}

/**
 * Return the facts about joints in a frame of a joint state, as in the description of a robot.
 *
 * @param {string} iri of the joint state
 * @param {import("./scene_state.js").JointState} state
 * @param {import("./scene_state.js").Values} values
 */
export function graphOfState(iri, state, values) {
  const graph = new Graph();
  const { positions, velocities = [], efforts } = values;
  state.joints.forEach((joint, index) => {
    const node = `_:j${index}`;
    graph.add(node, lf("ofJoint"), { kind: "iri", value: joint });
    for (const [name, all] of Object.entries({ position: positions, velocity: velocities, effort: efforts })) {
      if (index < all.length) graph.add(node, lf(name), numeral(all[index]));
    }
  });
  const time = moment(values.wallNs);
  graph.add(iri, RESULT_TIME, time);
  if (document.body.dataset.kind === "robot") graph.add(document.body.dataset.resource, lf("lastFrame"), time);
  graph.timeS = secondsOf(values.wallNs);
  return graph;
}

function numeral(value) {
  if (!Number.isFinite(value)) return { kind: "iri", value: UNKNOWN };
  return { kind: "literal", value: String(Number(value.toFixed(DECIMALS)) + 0), datatype: `${XSD}double` };
}

function secondsOf(ns) {
  return ns === undefined || ns < 0n ? undefined : Number(ns / NS_PER_US) / 1e6;
}

function moment(ns) {
  if (ns === undefined || ns < 0n) return { kind: "iri", value: UNKNOWN };
  return { kind: "literal", value: new Date(Number(ns / NS_PER_MS)).toISOString(), datatype: `${XSD}dateTime` };
}
