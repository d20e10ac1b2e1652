// A robot drawn from its frames: a sphere at each joint, bones along the kinematic chain.

import { CylinderGeometry, Group, Mesh, MeshStandardMaterial, SphereGeometry, Vector3 } from "three";

const SHARE = 0.012; // of the robot's reach is the radius of a joint's sphere
const UP = new Vector3(0, 1, 0);

/** Draw these links of the robot by their frames. */
export function skeleton(robot, links, colour) {
  if (!links.length) return;
  const radius = SHARE * reach(robot);
  const material = new MeshStandardMaterial({ color: colour, roughness: 0.5 });
  for (const link of links) {
    const drawn = new Group();
    const joints = link.children.filter((child) => child.isURDFJoint);
    if (link.parent?.jointType !== "fixed" || !joints.length) drawn.add(new Mesh(new SphereGeometry(radius, 24, 16), material));
    for (const joint of joints) {
      const mesh = bone(joint.position, radius / 2.5, material);
      if (mesh) drawn.add(mesh);
    }
    link.add(drawn);
  }
}

/** No bone to a joint at the same place as the one before. */
function bone(to, radius, material) {
  const length = to.length();
  if (length < radius / 10) return undefined;
  const mesh = new Mesh(new CylinderGeometry(radius, radius, length, 12), material);
  mesh.position.copy(to).multiplyScalar(0.5);
  mesh.quaternion.setFromUnitVectors(UP, to.clone().normalize());
  return mesh;
}

/** Return the distance between joints in metre; for a robot of one frame about 0.1. */
function reach(robot) {
  robot.updateMatrixWorld(true);
  const from = robot.getWorldPosition(new Vector3());
  const joints = Object.values(robot.joints).map((joint) => joint.getWorldPosition(new Vector3()).distanceTo(from));
  return Math.max(0.1, ...joints);
}
