// A draggable target in the scene: the gizmo of three.js on a point with an orientation.

import { AxesHelper, Group, Quaternion, Vector3 } from "three";
import { TransformControls } from "three/examples/jsm/controls/TransformControls.js";

const LENGTH = 0.25; // of the robot's size
const SIZE = 0.8;

/** @typedef {{position: number[], orientation: number[]}} Pose metre, and a unit quaternion x y z w */

export class Target {
  /**
   * @param {import("./scene_view.js").View} view
   * @param {import("three").Object3D} robot in whose frame the pose is
   * @param {(pose: Pose, done: boolean) => void} onDrag
   */
  constructor(view, robot, onDrag) {
    this.view = view;
    this.point = new Group();
    this.point.add(new AxesHelper(LENGTH * (view.size || 1)));
    robot.add(this.point);
    this.controls = new TransformControls(view.camera, view.canvas);
    this.controls.setSize(SIZE);
    this.controls.setSpace("local");
    this.controls.attach(this.point);
    this.controls.addEventListener("change", () => view.invalidate());
    this.controls.addEventListener("objectChange", () => onDrag(this.pose, false));
    this.controls.addEventListener("dragging-changed", ({ value }) => {
      view.controls.enabled = !value;
      view.untouched = false;
      if (!value) onDrag(this.pose, true);
    });
    this.helper = this.controls.getHelper();
    view.scene.add(this.helper);
    view.invalidate();
  }

  /** Return whether the gizmo is under the pointer, so that a click is not meant for a part of the robot. */
  get busy() {
    return this.controls.dragging || this.controls.axis !== null;
  }

  /** @param {"translate"|"rotate"} mode */
  set mode(mode) {
    this.controls.setMode(mode);
    this.view.invalidate();
  }

  /** @returns {Pose} in the frame of the robot's base */
  get pose() {
    return { position: this.point.position.toArray(), orientation: this.point.quaternion.toArray() };
  }

  /** @param {Pose} pose */
  set pose({ position, orientation }) {
    this.point.position.copy(new Vector3(...position));
    this.point.quaternion.copy(new Quaternion(...orientation).normalize());
    this.view.invalidate();
  }

  dispose() {
    this.controls.detach();
    this.controls.dispose();
    this.helper.removeFromParent();
    this.point.removeFromParent();
    this.view.invalidate();
  }
}
