// A second, translucent robot in a scene: where the robot would be.

import { Color, MeshStandardMaterial } from "three";

import { meshesOf } from "./scene_model.js";

const OPACITY = 0.4;

/** A copy of a robot that shares its geometries. */
export class Ghost {
  /** @param {import("urdf-loader").URDFRobot} robot */
  constructor(robot, colours) {
    this.robot = robot;
    this.colours = colours;
    // Links that do not move coincide with those of the robot, which is then seen instead.
    const behind = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 4 };
    this.material = new MeshStandardMaterial({ transparent: true, opacity: OPACITY, depthWrite: false, roughness: 0.8, ...behind });
    this.copy = copyOf(robot);
    this.copy.visible = false;
    for (const link of Object.values(this.copy.links)) {
      for (const mesh of meshesOf(link)) {
        mesh.material = this.material;
        mesh.castShadow = mesh.receiveShadow = false;
      }
    }
    robot.parent?.add(this.copy);
  }

  /**
   * @param {Map<string, number>|undefined} positions by name of the joint; the others stay where they are now
   * @param {boolean} refused
   */
  show(positions, refused) {
    this.copy.visible = Boolean(positions);
    if (!positions) return;
    this.material.color = new Color(refused ? this.colours.refused : this.colours.highlight);
    this.copy.position.copy(this.robot.position);
    this.copy.quaternion.copy(this.robot.quaternion);
    for (const [name, joint] of Object.entries(this.copy.joints)) {
      joint.ignoreLimits = true;
      if (joint.jointType === "fixed" || joint.mimicJoint) continue;
      joint.setJointValue(positions.get(name) ?? this.robot.joints[name].angle);
    }
  }

  dispose() {
    this.copy.removeFromParent();
    this.material.dispose();
  }
}

/** Data stored with objects of a scene, such as their parts, is not copied. */
function copyOf(robot) {
  const own = new Map();
  robot.traverse((each) => {
    own.set(each, each.userData);
    each.userData = {};
  });
  const copy = robot.clone();
  for (const [each, data] of own) each.userData = data;
  return copy;
}
