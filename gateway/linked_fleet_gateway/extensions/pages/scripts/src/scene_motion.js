// Applies joint positions to the robot, interpolating between frames.

import { Quaternion, Vector3 } from "three";

const SLOWEST_MS = 120; // after a longer pause between two frames the robot is not interpolated
const FULL_TURN = 2 * Math.PI;

/** Brings a robot from one pose to the next. Positions in rad or m; NaN leaves a joint where it is. */
export class Motion {
  /**
   * @param {import("urdf-loader").URDFRobot} robot
   * @param {(string|undefined)[]} joints names, in the order of later values
   */
  constructor(robot, joints) {
    this.robot = robot;
    this.joints = joints.map((name) => (name !== undefined && Object.hasOwn(robot.joints, name) ? robot.joints[name] : undefined));
    // A mimicking joint is set after the one it follows, which sets it as well.
    this.order = [...this.joints.keys()].sort((a, b) => this.mimics(a) - this.mimics(b));
    this.target = this.joints.map(() => NaN);
    this.base = undefined;
    this.steps = undefined;
    this.last = -Infinity;
    this.period = SLOWEST_MS;
  }

  mimics(index) {
    return Number(Boolean(/** @type {any} */ (this.joints[index])?.mimicJoint));
  }

  /** Set the latest values; with `smooth` false the robot jumps there. */
  accept({ positions, base }, now, smooth) {
    this.target = positions;
    const known = base && [...base.position, ...base.orientation].every(Number.isFinite);
    this.base = known ? { position: new Vector3(...base.position), orientation: new Quaternion(...base.orientation).normalize() } : undefined;
    const gap = now - this.last;
    this.last = now;
    this.period = Math.min(SLOWEST_MS, 0.7 * this.period + 0.3 * gap);
    const { position, quaternion } = this.robot;
    this.steps = {
      from: this.joints.map((joint) => joint?.angle),
      base: { position: position.clone(), orientation: quaternion.clone() },
      start: now,
      length: smooth ? this.period : 0,
    };
  }

  /** @returns {boolean} whether anything moved; `moving` says whether more movement follows */
  step(now) {
    if (!this.steps) return false;
    const { from, base, start, length } = this.steps;
    const share = length > 0 ? Math.min(1, Math.max(0, (now - start) / length)) : 1;
    let moved = false;
    for (const index of this.order) {
      const [joint, target] = [this.joints[index], this.target[index]];
      if (joint && Number.isFinite(target)) moved = joint.setJointValue(between(joint, from[index], target, share)) || moved;
    }
    if (this.base) moved = this.place(base, share) || moved;
    if (share === 1) this.steps = undefined;
    return moved;
  }

  place(from, share) {
    const { robot } = this;
    const before = [...robot.position.toArray(), ...robot.quaternion.toArray()];
    robot.position.lerpVectors(from.position, this.base.position, share);
    robot.quaternion.slerpQuaternions(from.orientation, this.base.orientation, share);
    return [...robot.position.toArray(), ...robot.quaternion.toArray()].some((value, i) => value !== before[i]);
  }

  get moving() {
    return this.steps !== undefined;
  }

  /** Names of the joints with unknown positions. */
  get unknown() {
    return this.joints.filter((joint, i) => joint && !Number.isFinite(this.target[i])).map((joint) => joint.urdfName);
  }
}

function between(joint, from, to, share) {
  if (share === 1) return to;
  const way = to - from;
  return from + share * (joint.jointType === "continuous" ? way - FULL_TURN * Math.round(way / FULL_TURN) : way);
}
