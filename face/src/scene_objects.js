// What stands in the world besides robots: obstacles, and the zones that robots keep out of.

import { BoxGeometry, CylinderGeometry, DoubleSide, Group, Mesh, MeshStandardMaterial, Quaternion, SphereGeometry } from "three";

import { key } from "./ntriples.js";
import { checkSize, stl } from "./scene_files.js";
import { lf, NUMERICAL_VALUE, RDF_TYPE, TITLE } from "./vocabulary.js";

const MATHS = "http://vocab.arvida.de/2015/06/maths/vocab#";
const CONTAINS = "http://www.w3.org/ns/ldp#contains";

/**
 * @param {import("./ntriples.js").Graph} graph
 * @param {string} iri of what stands somewhere
 * @returns {{position: number[], orientation: number[]}|undefined} in metre; nothing while it is unknown
 */
export function poseOf(graph, iri) {
  const read = (path, axes) => axes.map((axis) => number(graph.follow(iri, [lf(path), axis])));
  const xyz = ["x", "y", "z"].map((axis) => MATHS + axis);
  const [position, orientation] = [read("position", xyz), read("orientation", [...xyz, lf("w")])];
  return [...position, ...orientation].every(Number.isFinite) ? { position, orientation } : undefined;
}

/** Put an object of three.js where something stands. */
export function put(object, { position, orientation }) {
  object.position.set(...position);
  object.quaternion.copy(new Quaternion(...orientation).normalize());
}

/** Put an object of three.js, in whose frame something stands, as it is seen from there. */
export function putInverse(object, pose) {
  put(object, pose);
  object.quaternion.invert();
  object.position.negate().applyQuaternion(object.quaternion);
}

/** The objects that a container describes, drawn; what is a mesh comes when it has been fetched. */
export class Objects extends Group {
  /** @param {() => void} changed is called when there is something else to be drawn */
  constructor(signal, changed) {
    super();
    this.signal = signal;
    this.changed = changed;
  }

  /** @param {import("./ntriples.js").Graph} graph of the container at `iri` */
  show(graph, iri) {
    for (const each of /** @type {any[]} */ ([...this.children])) {
      each.removeFromParent();
      each.geometry.dispose();
      each.material.dispose();
    }
    for (const { value } of graph.values(iri, CONTAINS)) this.draw(graph, value);
    this.changed();
  }

  async draw(graph, iri) {
    const pose = poseOf(graph, iri);
    const geometry = graph.value(iri, lf("geometry"));
    if (!pose || !geometry) return;
    const zone = graph.values(iri, RDF_TYPE).some(({ value }) => value === lf("KeepOutZone"));
    const mesh = new Mesh(undefined, material(zone));
    mesh.name = graph.value(iri, TITLE)?.value ?? "";
    mesh.userData.zone = zone;
    mesh.castShadow = mesh.receiveShadow = !zone;
    put(mesh, pose);
    this.add(mesh);
    try {
      const made = form(graph, key(geometry)) ?? (await fetched(graph.value(key(geometry), lf("mesh"))?.value, this.signal));
      mesh.geometry.dispose();
      mesh.geometry = made;
      this.changed();
    } catch (error) {
      mesh.removeFromParent();
      if (!this.signal.aborted) console.warn(`${iri} is not drawn:`, error);
    }
  }
}

function material(zone) {
  const look = zone ? { color: "#e5484d", transparent: true, opacity: 0.25, depthWrite: false } : { color: "#a98b67", roughness: 0.8 };
  return new MeshStandardMaterial({ side: DoubleSide, ...look });
}

/** A primitive, or nothing for a mesh. */
function form(graph, node) {
  const type = graph.value(node, RDF_TYPE)?.value;
  const scalar = (name) => number(graph.follow(node, [lf(name), NUMERICAL_VALUE]));
  if (type === lf("Sphere")) return new SphereGeometry(scalar("radius"), 32, 16);
  if (type === lf("Cylinder")) return new CylinderGeometry(scalar("radius"), scalar("radius"), scalar("length"), 32).rotateX(Math.PI / 2);
  if (type === lf("Box")) return new BoxGeometry(...["x", "y", "z"].map((axis) => number(graph.follow(node, [lf("size"), MATHS + axis]))));
  return undefined;
}

async function fetched(iri, signal) {
  if (!iri) throw new Error("it has no form that is known here");
  const answer = await fetch(iri, { headers: { Accept: "model/stl" }, signal });
  if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
  checkSize(answer);
  const geometry = stl(await answer.arrayBuffer());
  geometry.computeVertexNormals();
  return geometry;
}

function number(term) {
  return term?.kind === "literal" && term.value.trim() ? Number(term.value) : NaN;
}
