// The objects in the world besides robots: obstacles and keep-out zones.

import { say } from "./say.js";
import { BoxGeometry, CylinderGeometry, DoubleSide, Group, Mesh, MeshStandardMaterial, Quaternion, SphereGeometry } from "three";

import { key } from "./ntriples.js";
import { length, MATHS, poseOf } from "./pose_of.js";
import { checkSize, stl } from "./scene_files.js";
import { lf, NUMERICAL_VALUE, RDF_TYPE, TITLE } from "./vocabulary.js";

const DRAFT = "_:n0";
const CONTAINS = "http://www.w3.org/ns/ldp#contains";

/** Apply a pose to an object of three.js. */
export function put(object, { position, orientation }) {
  object.position.set(...position);
  object.quaternion.copy(new Quaternion(...orientation).normalize());
}

/** Apply the inverse of a pose to an object of three.js. */
export function putInverse(object, pose) {
  put(object, pose);
  object.quaternion.invert();
  object.position.negate().applyQuaternion(object.quaternion);
}

/** The objects of a container, drawn; a mesh is added when it has been fetched. */
export class Objects extends Group {
  /** @param {() => void} changed is called when the scene must be drawn again */
  constructor(signal, changed) {
    super();
    this.signal = signal;
    this.changed = changed;
  }

  /** @param {import("./ntriples.js").Graph} graph of the container at `iri` */
  show(graph, iri) {
    for (const each of [...this.children]) if (!each.userData.draft) discard(each);
    for (const { value } of graph.values(iri, CONTAINS)) this.draw(graph, value, value);
    this.changed();
  }

  /**
   * Draw the draft of an object, or remove the draft.
   *
   * @param {import("./ntriples.js").Graph} [graph] about the node `_:n0`
   * @param {string} [instead] the object that the draft replaces
   */
  draft(graph, instead) {
    this.drafted = graph && { graph, instead };
    const former = this.children.filter(({ userData }) => userData.draft);
    if (graph) this.draw(graph, DRAFT, instead, former);
    else former.forEach(discard);
    this.arrange();
    this.changed();
  }

  /** Hide the object that the draft replaces, and what is held by a link that is not drawn. */
  arrange() {
    for (const each of this.children) {
      const { draft, iri, holder, carried } = each.userData;
      each.visible = (draft || iri !== this.drafted?.instead) && (!holder || Boolean(carried));
    }
  }

  /**
   * Move what links of robots hold with these.
   *
   * @param {(iri: string) => import("three").Object3D|undefined} linkAt the drawn link with an IRI
   */
  carry(linkAt) {
    const held = this.children.filter(({ userData }) => userData.holder);
    if (!held.length) return;
    this.updateWorldMatrix(true, false);
    for (const each of held) {
      const link = linkAt(each.userData.holder);
      each.userData.carried = Boolean(link);
      if (!link) continue;
      link.updateWorldMatrix(true, false);
      put(each, each.userData.pose);
      each.updateMatrix();
      const there = this.matrixWorld.clone().invert().multiply(link.matrixWorld).multiply(each.matrix);
      there.decompose(each.position, each.quaternion, each.scale);
    }
    this.arrange();
  }

  /**
   * @param {import("./ntriples.js").Graph} graph
   * @param {string} node that is described in it
   * @param {string} iri of the object
   * @param {any[]} former drawings that this one replaces
   */
  async draw(graph, node, iri, former = []) {
    const pose = poseOf(graph, node);
    const geometry = graph.value(node, lf("geometry"));
    if (!pose || !geometry) return;
    const zone = graph.values(node, RDF_TYPE).some(({ value }) => value === lf("KeepOutZone"));
    const mesh = new Mesh(undefined, material(zone));
    mesh.name = graph.value(node, TITLE)?.value ?? "";
    mesh.userData = { zone, iri, draft: node === DRAFT, pose, holder: graph.value(node, lf("heldBy"))?.value };
    if (mesh.userData.draft) Object.assign(mesh.material, { transparent: true, opacity: zone ? 0.35 : 0.75 });
    mesh.castShadow = mesh.receiveShadow = !zone;
    put(mesh, pose);
    former.forEach(discard);
    this.add(mesh);
    this.arrange();
    try {
      const made = form(graph, key(geometry)) ?? (await fetched(graph.value(key(geometry), lf("mesh"))?.value, this.signal));
      mesh.geometry.dispose();
      mesh.geometry = made;
      this.changed();
    } catch (error) {
      mesh.removeFromParent();
      // A draft may be incomplete.
      if (!this.signal.aborted && node !== DRAFT) console.warn(`${iri} is not drawn:`, error);
    }
  }
}

function discard(mesh) {
  mesh.removeFromParent();
  mesh.geometry.dispose();
  mesh.material.dispose();
}

function material(zone) {
  const look = zone ? { color: "#e5484d", transparent: true, opacity: 0.25, depthWrite: false } : { color: "#a98b67", roughness: 0.8 };
  return new MeshStandardMaterial({ side: DoubleSide, ...look });
}

/** Return a primitive, or nothing for a mesh. */
function form(graph, node) {
  const type = graph.value(node, RDF_TYPE)?.value;
  const scalar = (name) => extent(length(graph, graph.value(node, lf(name)), NUMERICAL_VALUE));
  const edge = (axis) => extent(length(graph, graph.value(node, lf("size")), MATHS + axis));
  if (type === lf("Sphere")) return new SphereGeometry(scalar("radius"), 32, 16);
  if (type === lf("Cylinder")) return new CylinderGeometry(scalar("radius"), scalar("radius"), scalar("length"), 32).rotateX(Math.PI / 2);
  if (type === lf("Box")) return new BoxGeometry(edge("x"), edge("y"), edge("z"));
  return undefined;
}

function extent(value) {
  if (!(value > 0)) throw new Error(say("its extent is unknown"));
  return value;
}

async function fetched(iri, signal) {
  if (!iri) throw new Error(say("it has no form that is known here"));
  const answer = await fetch(iri, { headers: { Accept: "model/stl" }, signal });
  if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
  checkSize(answer);
  const geometry = stl(await answer.arrayBuffer());
  geometry.computeVertexNormals();
  return geometry;
}
