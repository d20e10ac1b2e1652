// The links of a drawn robot: their poses, and which of them are its tips.

import { Quaternion, Vector3 } from "three";

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

/** @returns {string[]} the links without children, those farthest from the base by joints last */
export function tipsOf(robot) {
  const moved = (object) => object.isURDFJoint && object.jointType !== "fixed";
  const depth = (object) => (object.parent ? depth(object.parent) + Number(moved(object)) : 0);
  const leaf = (link) => !link.children.some((child) => child.isURDFJoint);
  const links = Object.values(robot.links).filter(leaf);
  return links.sort((one, other) => depth(one) - depth(other)).map((link) => link.urdfName);
}
