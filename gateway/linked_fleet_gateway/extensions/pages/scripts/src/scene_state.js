// Joint states: joints and their order, the layout of binary frames, and the values of a frame.

import { key, parse } from "./ntriples.js";

const LF = "https://w3id.org/linked-fleet#";
const MATHS = "http://vocab.arvida.de/2015/06/maths/vocab#";
const RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#";

// Frames are little-endian (agents/linked_fleet_agent/wire/PROTOCOL.md).
const TYPES = {
  char2: [2, (view, at) => String.fromCharCode(view.getUint8(at), view.getUint8(at + 1))],
  uint16: [2, (view, at) => view.getUint16(at, true)],
  uint32: [4, (view, at) => view.getUint32(at, true)],
  float32: [4, (view, at) => view.getFloat32(at, true)],
  uint64: [8, (view, at) => view.getBigUint64(at, true)],
  int64: [8, (view, at) => view.getBigInt64(at, true)],
  float64: [8, (view, at) => view.getFloat64(at, true)],
};

/**
 * @typedef {{position: number[], orientation: number[]}} Base of a robot in the world: metre, and a unit quaternion x y z w
 * @typedef {{positions: number[], velocities?: number[], efforts: number[], base?: Base, incarnation?: bigint, wallNs?: bigint}} Values
 *   of the joints of a state, in its order: rad or m, rad/s or m/s, N m or N; NaN is unknown
 */

/** The description of a robot's joint state: `joints` are IRIs in the order of its values, `present` those it states. */
export class JointState {
  constructor(graph, iri) {
    // Samples are described in the order of the frame's arrays.
    const samples = graph.values(iri, `${LF}sample`).map(key);
    this.joints = samples.map((sample) => graph.value(sample, `${LF}ofJoint`)?.value ?? "");
    /** @type {Values} */
    this.present = {
      positions: samples.map((sample) => number(graph.value(sample, `${LF}position`))),
      efforts: samples.map((sample) => number(graph.value(sample, `${LF}effort`))),
    };
    /** Local names of the units of the positions. */
    this.units = samples.map((sample) => graph.value(sample, `${LF}positionUnit`)?.value.replace(/^.*[/#]/, "") ?? "");
    this.fields = layout(graph, iri);
    this.length = Math.max(0, ...[...this.fields.values()].map(({ type, offset, count }) => offset + TYPES[type][0] * count));
  }

  /**
   * @param {ArrayBuffer} buffer
   * @returns {Values|undefined} undefined if the frame has another layout, possibly of another run of the agent
   */
  decode(buffer) {
    const positions = this.fields.get("positions");
    if (buffer.byteLength !== this.length || positions?.count !== this.joints.length) return undefined;
    const view = new DataView(buffer);
    const base = this.read(view, "base");
    return {
      positions: this.read(view, "positions"),
      velocities: this.read(view, "velocities"),
      efforts: this.read(view, "efforts"),
      base: base.length >= 7 ? { position: base.slice(0, 3), orientation: base.slice(3, 7) } : undefined,
      incarnation: this.read(view, "incarnation")[0],
      wallNs: this.read(view, "wall_ns")[0],
    };
  }

  read(view, name) {
    const field = this.fields.get(name);
    if (!field) return [];
    const [size, get] = TYPES[field.type];
    return Array.from({ length: field.count }, (_, i) => get(view, field.offset + i * size));
  }
}

/** @returns {Promise<JointState>} from the present description of the resource */
export async function fetchState(iri, signal) {
  return new JointState(await graphOf(iri, signal), iri);
}

/** @returns {Promise<Base>} of the pose of a floating base; what is unknown is NaN */
export async function fetchBase(iri, signal) {
  const graph = await graphOf(iri, signal);
  const read = (path, axes) => axes.map((axis) => number(graph.follow(iri, [path, axis])));
  const xyz = ["x", "y", "z"].map((axis) => MATHS + axis);
  return { position: read(`${LF}position`, xyz), orientation: read(`${LF}orientation`, [...xyz, `${LF}w`]) };
}

async function graphOf(iri, signal) {
  const answer = await fetch(iri, { headers: { Accept: "application/n-triples" }, signal });
  if (!answer.ok) throw new Error(`${iri}: ${answer.status} ${answer.statusText}`);
  return parse(await answer.text());
}

function number(term) {
  return term?.kind === "literal" && term.value.trim() ? Number(term.value) : NaN;
}

function layout(graph, iri) {
  const nodes = [];
  const seen = new Set();
  let cell = graph.value(iri, `${LF}frameLayout`);
  while (cell?.kind === "blank" && !seen.has(cell.value)) {
    seen.add(cell.value);
    nodes.push(graph.value(key(cell), `${RDF}first`));
    cell = graph.value(key(cell), `${RDF}rest`);
  }
  return new Map(layoutFields(graph, nodes).map((each) => [each.name, each]));
}

/**
 * Return the fields of a frame described by these nodes of a graph; unreadable ones are left out.
 *
 * @param {(import("./ntriples.js").Term|undefined)[]} nodes
 * @returns {{node: string, name: string, type: string, offset: number, count: number}[]}
 */
export function layoutFields(graph, nodes) {
  return nodes.flatMap((term) => {
    const node = term ? key(term) : "";
    const of = (name) => graph.value(node, LF + name)?.value;
    const [name, type, offset, count] = [of("fieldName"), of("fieldType"), Number(of("byteOffset")), Number(of("valueCount"))];
    return Object.hasOwn(TYPES, type) && offset >= 0 && count >= 0 ? [{ node, name, type, offset, count }] : [];
  });
}

/** Return the value of this type at this byte. */
export function valueOf(view, type, offset) {
  return TYPES[type][1](view, offset);
}
