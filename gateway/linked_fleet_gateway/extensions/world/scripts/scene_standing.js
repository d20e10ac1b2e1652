// One robot in the drawing of the world.

import { Box3, Group, Vector3 } from "three";

import { build, complete, fetchModel, loadMeshes, meshesOf } from "../../pages/scripts/src/scene_model.js";
import { linkAt } from "../../pages/scripts/src/scene_links.js";
import { Motion } from "../../pages/scripts/src/scene_motion.js";
import { poseOf } from "../../pages/scripts/src/pose_of.js";
import { put } from "../../pages/scripts/src/scene_objects.js";
import { Part } from "../../pages/scripts/src/scene_parts.js";
import { fetchBase, fetchState } from "../../pages/scripts/src/scene_state.js";
import { smooth } from "../../pages/scripts/src/scene_view.js";
import { watch } from "../../pages/scripts/src/socket.js";
import { lf, localName, TITLE } from "../../pages/scripts/src/vocabulary.js";

const INTERVAL_S = 0.033; // 30 Hz
const ESCAPED = /~([0-9A-F]{2})/g;

/** `place` is the robot's placement; it is not shown while that is unknown. */
export class Standing {
  /**
   * @param {import("../../pages/scripts/src/ntriples.js").Graph} graph the description of the world
   * @param {string} iri
   */
  constructor(graph, iri, world) {
    const link = (name) => graph.value(iri, lf(name))?.value;
    this.world = world;
    this.iri = iri;
    this.name = localName(iri);
    this.title = graph.value(iri, TITLE)?.value ?? this.name;
    this.model = link("model");
    this.state = link("jointState");
    this.pose = link("pose");
    this.placement = link("placement");
    this.place = new Group();
    this.place.name = this.name;
    this.place.userData.iri = iri;
    this.ends = [];
    this.height = 0.5;
    this.offline = false;
    this.met = false;
    this.stand(poseOf(graph, this.placement));
  }

  /** Draw it from now on, after its presence is known as far as possible. */
  meet() {
    this.met = true;
    return this.wake();
  }

  /** @param {string} state */
  presence(state) {
    const back = this.offline && state !== "offline";
    this.offline = state === "offline";
    if (back && !this.parts) this.begun = undefined;
    this.wake();
  }

  /** Fetch the model once the robot is placed and online: its meshes come from its agent. */
  wake() {
    if (!this.met || this.offline || !(this.stood || this.drafted || this.lent)) return undefined;
    this.begun ??= this.load(this.world.ending.signal).catch((error) => this.world.lacks(this, error));
    return this.begun;
  }

  async load(signal) {
    const [urdf, state, base] = await Promise.all([
      fetchModel(this.model, signal, true), // among others a robot is small
      fetchState(this.state, signal),
      this.pose ? fetchBase(this.pose, signal) : undefined,
    ]);
    const { robot, meshes } = build(urdf, this.model);
    this.robot = robot;
    this.motion = new Motion(robot, state.joints.map(nameOf));
    this.motion.accept({ ...state.present, base }, performance.now(), false);
    this.motion.step(performance.now());
    this.decode = (frame) => state.decode(frame);
    this.place.add(robot);
    this.listen(this.world.inSight);
    await loadMeshes(meshes, () => {}, signal);
    complete(robot, this.world.view.colours.bone);
    this.parts = Object.values(robot.links).flatMap((link) => {
      const shapes = meshesOf(link);
      return shapes.length ? [new Part(link, shapes)] : [];
    });
    this.measure();
    this.world.frame();
  }

  /** Follow its placement and its motions while it is visible. */
  listen(wanted) {
    if (!wanted) {
      for (const end of this.ends.splice(0)) end();
      this.moves = false;
      return;
    }
    if (!this.ends.length) this.ends.push(watch(this.placement, {}, (graph) => this.stand(poseOf(graph, this.placement))));
    if (this.decode && !this.moves) {
      this.moves = true;
      this.ends.push(watch(this.state, { protocol: "lf.frame", interval: INTERVAL_S }, (frame) => this.take(this.decode(frame))));
    }
  }

  /** @param {import("../../pages/scripts/src/scene_target.js").Pose} [pose] */
  stand(pose) {
    this.stood = pose;
    this.arrange();
    this.world.lineUp();
  }

  /** Show it at a place that is lent to it while it has none of its own. */
  lend(pose) {
    if (Boolean(this.lent) === Boolean(pose)) return;
    this.lent = pose;
    this.arrange();
  }

  /** Show it at a draft placement; without a pose, at its own. */
  draft(pose) {
    this.drafted = pose;
    this.arrange();
  }

  arrange() {
    this.wake();
    const pose = this.drafted ?? this.stood ?? this.lent;
    this.place.visible = Boolean(pose);
    if (pose) put(this.place, pose);
    this.place.updateMatrixWorld(true);
    if (this.drafted) this.world.view?.invalidate(true);
    else this.world.frame();
  }

  take(values) {
    if (!values) return; // from another run of the agent: the reloaded page has its description
    this.motion.accept(values, performance.now(), smooth());
    this.world.view.invalidate();
  }

  step(now) {
    return this.motion?.step(now) ?? false;
  }

  /** @returns {import("three").Object3D|undefined} the drawn link with an IRI, while the robot is shown */
  linkAt(iri) {
    return this.place.visible ? linkAt(this.robot, this.iri, iri) : undefined;
  }

  /** @returns {Vector3} the position of its base, which may move */
  base() {
    return (this.robot ?? this.place).getWorldPosition(new Vector3());
  }

  /** @returns {Vector3|undefined} the place of its label above it */
  top() {
    if (!this.place.visible) return undefined;
    const base = this.base();
    return base.setZ(base.z + this.height);
  }

  /** Return the height above its base in the present pose, once it is complete. */
  measure() {
    const box = new Box3().setFromObject(this.robot);
    if (!box.isEmpty()) this.height = box.max.z - this.base().z;
  }

  dispose() {
    this.listen(false);
    this.place.removeFromParent();
    for (const part of this.parts ?? []) part.dispose();
  }
}

/** Return the name of a joint, as in the last segment of its IRI. */
function nameOf(iri) {
  const segment = iri.slice(iri.lastIndexOf("/") + 1);
  return decodeURIComponent(segment.replace(ESCAPED, "%$1"));
}
