// The links of a drawn robot: their poses, and which of them are its tips.

import { Quaternion, Vector3 } from "three";

const ESCAPED = /~([0-9A-F]{2})/g;
const LINK_MARK = /~link$/; // of a link that has the name of a joint

/** @returns {import("./scene_target.js").Pose|undefined} where a link is drawn, in the frame of the robot's base */
export function poseIn(robot, link) {
  const object = Object.hasOwn(robot.links, link) ? robot.links[link] : undefined;
  if (!object) return undefined;
  robot.updateMatrixWorld(true);
  const local = robot.matrixWorld.clone().invert().multiply(object.matrixWorld);
  const [position, orientation] = [new Vector3(), new Quaternion()];
  local.decompose(position, orientation, new Vector3());
  return { position: position.toArray(), orientation: orientation.toArray() };
}

/**
 * @param {any} robot that is drawn, if it is
 * @param {string} root the IRI of the robot
 * @param {string} iri
 * @returns {import("three").Object3D|undefined} the drawn link with this IRI
 */
export function linkAt(robot, root, iri) {
  if (!robot || !iri.startsWith(root)) return undefined;
  const segment = iri.slice(root.length).replace(LINK_MARK, "");
  const name = decodeURIComponent(segment.replace(ESCAPED, "%$1"));
  return Object.hasOwn(robot.links, name) ? robot.links[name] : undefined;
}

/** @returns {string[]} the links without children, those farthest from the base by joints last */
export function tipsOf(robot) {
  const moved = (object) => object.isURDFJoint && object.jointType !== "fixed";
  const depth = (object) => (object.parent ? depth(object.parent) + Number(moved(object)) : 0);
  const leaf = (link) => !link.children.some((child) => child.isURDFJoint);
  const links = Object.values(robot.links).filter(leaf);
  return links.sort((one, other) => depth(one) - depth(other)).map((link) => link.urdfName);
}
