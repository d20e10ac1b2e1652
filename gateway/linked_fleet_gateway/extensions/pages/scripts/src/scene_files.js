// Mesh files from robots. They are parsed in the thread of the Stop button, so whatever would take long is refused first.

import { say } from "./say.js";
import { BufferGeometry, Float32BufferAttribute } from "three";
import { STLLoader } from "three/examples/jsm/loaders/STLLoader.js";

const MOST_BYTES = 32 * 2 ** 20;
const MOST_OBJECTS = 4096; // of one file, including repeated ones
export const MOST_CORNERS = 6e6; // of one robot, three to a triangle

/** @throws {Error} if the file in this response is too large */
export function checkSize(answer) {
  if (Number(answer.headers.get("content-length")) > MOST_BYTES) throw new Error(say("it is too large to be drawn here"));
}

/**
 * @param {ArrayBuffer} file in the binary or the textual form
 * @returns {BufferGeometry}
 * @throws {Error} if it is truncated
 */
export function stl(file) {
  const size = file.byteLength < 84 ? NaN : 84 + 50 * new DataView(file).getUint32(80, true);
  if (size === file.byteLength) return new STLLoader().parse(file);
  const head = new TextDecoder().decode(file.slice(0, 10));
  if (head.includes("solid")) return textual(new TextDecoder().decode(file));
  if (!(size < file.byteLength)) throw new Error(say("the file is shorter than it says"));
  return new STLLoader().parse(file);
}

/** Parse in one pass, for which three.js needs many. Normals follow from the corners. */
function textual(text) {
  const places = [];
  for (const [, x, y, z] of text.matchAll(/vertex\s+(\S+)\s+(\S+)\s+(\S+)/g)) places.push(Number(x), Number(y), Number(z));
  places.length -= places.length % 9;
  return new BufferGeometry().setAttribute("position", new Float32BufferAttribute(places, 3));
}

/** @throws {Error} if the text of an OBJ has more objects than can be drawn */
export function checkObj(text) {
  let objects = 0;
  for (const _ of text.matchAll(/^[ \t]*(?:[og]|usemtl)[ \t]/gm)) limit(++objects);
}

/**
 * @param {{nodes: Record<string, {nodes: string[], instanceNodes: string[], instanceGeometries: object[]}>}} library of a
 *   Collada file: nodes that repeat nodes that repeat nodes can make more of them than any machine has room for
 * @throws {Error} if it has more objects than can be drawn
 */
export function checkCollada({ nodes }) {
  const known = new Map();
  const size = (id) => {
    if (known.has(id)) return known.get(id);
    known.set(id, Infinity); // in case it contains itself
    const { nodes: own = [], instanceNodes = [], instanceGeometries = [] } = nodes[id] ?? {};
    const found = [...own, ...instanceNodes].reduce((sum, each) => sum + size(each), 1 + instanceGeometries.length);
    known.set(id, found);
    return found;
  };
  for (const id of Object.keys(nodes)) limit(size(id));
}

/** @throws {Error} if a file has more objects than can be drawn */
export function limit(objects) {
  if (objects > MOST_OBJECTS) throw new Error(say("it has more than {MOST_OBJECTS} objects", { MOST_OBJECTS }));
}

/** Counts the drawn objects and corners of a robot. */
export class Budget {
  #left = MOST_CORNERS;

  /**
   * @param {import("three").Object3D} object drawn so many times
   * @throws {Error} if there is more than can be drawn
   */
  spend(object, times) {
    let corners = 0;
    object.traverse((/** @type {any} */ { isMesh, geometry }) => isMesh && (corners += geometry.index?.count ?? geometry.attributes.position?.count ?? 0));
    if (corners * times > this.#left) throw new Error(say("the robot has more triangles than can be drawn here"));
    this.#left -= corners * times;
  }
}
