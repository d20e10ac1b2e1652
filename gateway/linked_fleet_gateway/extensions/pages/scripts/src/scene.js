// The robot in 3D: drawn from its URDF in its present pose, moving, with parts that lead to their pages.

import { say } from "./say.js";
import { Mesh, MeshBasicMaterial, SphereGeometry, Vector3 } from "three";

import { converted, number } from "./format.js";
import { wantedGhost } from "./ghost.js";
import { linkAt, poseIn, tipsOf } from "./scene_links.js";
import { build, complete, fetchModel, loadMeshes, meshesOf } from "./scene_model.js";
import { Ghost } from "./scene_ghost.js";
import { Motion } from "./scene_motion.js";
import { poseOf } from "./pose_of.js";
import { Objects, putInverse } from "./scene_objects.js";
import { Panel } from "./scene_panel.js";
import { load, Part, proximity, ramp } from "./scene_parts.js";
import { Picker } from "./scene_pick.js";
import { fetchBase, fetchState } from "./scene_state.js";
import { Target } from "./scene_target.js";
import { smooth, View } from "./scene_view.js";
import { watch } from "./socket.js";
import { lf } from "./vocabulary.js";

const INTERVAL_S = 0.033; // 30 Hz
const RESOLUTION = 1e-4; // rad or m; smaller changes are invisible
const PHONE = matchMedia("(max-width: 40rem)");
const MARK = 0.04; // of the robot's size
const AHEAD = "400px"; // prepares a section before it is scrolled into view

/**
 * Draw a robot in this section, that of the page or of `data-robot`, from `data-model` (its URDF), `data-state` (its joint state) and `data-pose` (where its
 * base is, if that floats), among the objects of `data-objects` once `data-placement` says where it stands. `data-phase` says how far it is: loading, ready or failed; `section.scene` is the drawing.
 * With `data-past` it follows no robot: `past` of the drawing sets what is shown.
 *
 * @param {HTMLElement} section
 */
export function show(section) {
  section.scene ??= new RobotScene(section);
}

class RobotScene {
  constructor(section) {
    this.section = section;
    this.mode = "appearance";
    this.offline = false;
    this.parts = [];
    this.efforts = new Map();
    this.unknown = new Set();
    this.ending = new AbortController();
    this.phase("loading");
    this.sight = new IntersectionObserver((entries) => this.seen(entries.at(-1).isIntersecting), { rootMargin: AHEAD });
    this.sight.observe(section);
  }

  phase(phase) {
    this.section.dataset.phase = phase;
    this.section.setAttribute("aria-busy", String(phase === "loading"));
  }

  seen(seen) {
    if (!this.section.isConnected) return this.dispose();
    if (seen && !this.started) this.start();
    this.inSight = seen;
    this.view?.show(seen);
    this.listen();
  }

  async start() {
    this.started = true;
    this.panel = new Panel(this.section, { onMode: (mode) => this.colourBy(mode), onFit: () => this.view.fit() });
    const context = this.panel.canvas.getContext("webgl2", { antialias: true, alpha: true, powerPreference: "low-power" });
    if (!context) return this.fail(say("This browser has no WebGL, which drawing the robot takes. All its parts are listed on this page."));
    this.panel.enter();
    try {
      this.view = new View(this.panel.canvas, context, (now) => this.animate(now));
      this.picker = new Picker(this.view, this.panel.label, { page, describe: (joint) => this.positionOf(joint) });
      this.panel.canvas.addEventListener("themechange", () => this.paint());
      await this.load();
    } catch (error) {
      if (!this.ending.signal.aborted) this.fail(say("The robot cannot be drawn: {message}", { message: error.message }));
    }
  }

  fail(reason) {
    this.stop?.();
    this.view?.dispose();
    this.view = undefined;
    this.panel.fail(reason);
    this.phase("failed");
  }

  /** Fetch model and state, and draw the robot, first without its meshes. */
  async load() {
    const { model } = this.section.dataset;
    const { signal } = this.ending;
    const [urdf] = await Promise.all([fetchModel(model, signal, this.isSmall), this.isPast ? undefined : this.describe()]);
    this.urdf = urdf;
    const { robot, meshes } = build(urdf, model);
    this.robot = robot;
    if (!this.isPast) this.pose();
    this.view.stage(robot);
    this.listen();
    if (this.isPast) this.past(this.then);
    this.missing = await loadMeshes(meshes, (done, of) => this.arrived(done, of), signal);
    if (signal.aborted || robot !== this.robot) return;
    complete(robot, this.view.colours.bone);
    this.gather();
    this.frame();
    this.phase("ready");
    this.ghost(wantedGhost());
    this.section.dispatchEvent(new Event("drawn"));
  }

  /**
   * Show where the robot would be.
   *
   * @param {{joints: Map<string, number>, refused: boolean}|undefined} wanted positions by the IRI of the joint
   */
  ghost(wanted) {
    if (this.section.dataset.phase !== "ready") return;
    if (wanted && this.translucent?.robot !== this.robot) {
      this.translucent?.dispose();
      this.translucent = new Ghost(this.robot, this.view.colours);
    }
    const named = wanted && new Map([...wanted.joints].map(([iri, position]) => [nameOf(iri) ?? iri, position]));
    this.translucent?.show(named, wanted?.refused);
    this.section.toggleAttribute("data-ghost", Boolean(wanted));
    this.view.invalidate();
  }

  /**
   * Mark where the robot would collide or come close to something; without a point, remove the mark.
   *
   * @param {number[]} [point] in the world, in metre
   * @param {boolean} [refused]
   */
  contact(point, refused = true) {
    this.contacted?.removeFromParent();
    this.contacted?.geometry.dispose();
    this.contacted?.material.dispose();
    this.contacted = undefined;
    this.section.toggleAttribute("data-contact", Boolean(point && this.around?.visible));
    if (point && this.around?.visible) {
      const look = new MeshBasicMaterial({ color: refused ? this.view.colours.refused : this.view.colours.highlight, depthTest: false, transparent: true, opacity: 0.85 });
      this.contacted = new Mesh(new SphereGeometry(MARK * this.view.size, 24, 12), look);
      this.contacted.renderOrder = 1;
      this.contacted.position.copy(this.around.localToWorld(new Vector3(...point)));
      this.view.scene.add(this.contacted);
    }
    this.view?.invalidate();
  }

  /**
   * Show a draggable target.
   *
   * @param {(pose: import("./scene_target.js").Pose, done: boolean) => void} onDrag
   */
  target(onDrag) {
    this.picker.quiet = () => target.busy;
    const target = new Target(this.view, this.robot, onDrag);
    return target;
  }

  /**
   * Return where a link is, in the frame of the robot's base. The drawing may be behind the latest frame, since it is
   * interpolated, and rests out of sight.
   *
   * @param {string} link
   * @param {import("./scene_state.js").Values} [values] of the latest frame
   * @returns {import("./scene_target.js").Pose|undefined}
   */
  poseOf(link, values) {
    if (values?.positions.length === this.names?.length) this.accept({ ...values, base: values.base ?? this.present.base }, false);
    this.motion?.step(Infinity);
    return this.robot && poseIn(this.robot, link);
  }

  /** @returns {string[]} the links without children, those farthest from the base by joints last */
  tips() {
    return this.robot ? tipsOf(this.robot) : [];
  }

  arrived(done, of) {
    this.panel.progress(done, of);
    this.gather();
    this.frame();
  }

  /** Show all of the robot, unless the user has moved the camera. */
  frame() {
    if (this.view.untouched) this.view.fit();
    else this.view.invalidate(true);
  }

  /** Fetch the joint state's description with its present values. */
  async describe() {
    const { state, pose } = this.section.dataset;
    const { signal } = this.ending;
    const [described, base] = await Promise.all([fetchState(state, signal), pose ? fetchBase(pose, signal) : undefined]);
    this.state = described;
    this.present = { ...described.present, base };
  }

  /** Show the robot as in its description. */
  pose() {
    this.names = this.state.joints.map(nameOf);
    this.motion = new Motion(this.robot, this.names);
    this.accept(this.present, false);
    this.motion.step(performance.now());
  }

  /** Find the meshes of each link; those that look as before stay as they are. */
  gather() {
    const before = new Map(this.parts.map((part) => [part.link, part]));
    this.parts = Object.values(this.robot.links).flatMap((link) => {
      const old = before.get(link);
      const meshes = meshesOf(link);
      if (old?.meshes.length === meshes.length) return [old];
      return meshes.length ? [new Part(link, meshes)] : [];
    });
    for (const part of before.values()) if (!this.parts.includes(part)) part.dispose();
    this.picker.set(this.parts);
    this.paint();
  }

  /** Whether few triangles are enough: on a phone, where data are dear, or where several robots are drawn. */
  get isSmall() {
    return PHONE.matches || Boolean(/** @type {any} */ (navigator).connection?.saveData) || this.isPast;
  }

  get isPast() {
    return "past" in this.section.dataset;
  }

  /**
   * Show the robot as it was. Without values nothing is known of it, and it is not drawn.
   *
   * @param {import("./scene_state.js").Values & {names: string[]}|undefined} values with the names of their joints
   */
  past(values) {
    this.then = values;
    if (!this.robot) return;
    const known = Boolean(values?.names.every((name) => Object.hasOwn(this.robot.joints, name)));
    this.robot.visible = known;
    this.section.toggleAttribute("data-nothing", !known);
    if (known) {
      if (this.motion?.robot !== this.robot || this.names.join("\n") !== values.names.join("\n")) {
        this.names = values.names;
        this.motion = new Motion(this.robot, this.names);
      }
      this.accept(values, false);
      this.motion.step(performance.now());
      this.picker.refresh();
    }
    this.view?.invalidate(true);
  }

  /**
   * Draw things around the robot, which are in the frame of the world; without its pose there, do not.
   *
   * @param {import("three").Group & {carry: (linkAt: (iri: string) => any) => void}} things
   * @param {import("./scene_target.js").Pose|undefined} pose
   */
  among(things, pose) {
    if (!this.view) return;
    if (things.parent !== this.view.scene) this.view.scene.add((this.around = things));
    things.visible = Boolean(pose);
    if (pose) putInverse(things, pose);
    this.view.invalidate(true);
  }

  /** Follow the robot while it is visible. */
  listen() {
    if (this.isPast) return;
    if (!this.inSight) {
      this.stop?.();
      this.stop = undefined;
    } else if (!this.stop && this.motion) {
      const resource = this.resource();
      const frames = watch(this.section.dataset.state, { protocol: "lf.frame", interval: INTERVAL_S }, (frame) => this.take(frame));
      const presence = watch(resource, { depth: "this" }, (graph) => this.presence(graph.value(resource, lf("presence"))?.value));
      const around = this.surround();
      this.stop = () => [frames, presence, ...around].forEach((end) => end());
    }
  }

  /** Return the IRI of the robot, of which other pages than its own state it. */
  resource() {
    return this.section.dataset.robot ?? document.body.dataset.resource;
  }

  /** Follow the objects around it, which are not drawn while its own placement is unknown. */
  surround() {
    const { objects, placement } = this.section.dataset;
    if (!objects || !placement) return [];
    const [container, place] = [objects, placement].map((each) => new URL(each, document.baseURI).href);
    if (!this.objects) {
      this.around = this.objects = new Objects(this.ending.signal, () => this.view?.invalidate(true));
      this.objects.visible = false;
      this.view.scene.add(this.objects);
    }
    return [
      watch(container, { interval: 0.2 }, (graph) => this.objects.show(graph, container)),
      watch(place, {}, (graph) => {
        const pose = poseOf(graph, place);
        this.around.visible = Boolean(pose);
        if (pose) putInverse(this.around, pose);
        this.view?.invalidate(true);
      }),
    ];
  }

  take(frame) {
    if (!this.section.isConnected) return this.dispose();
    const values = this.state.decode(frame);
    const another = this.incarnation !== undefined && values?.incarnation !== this.incarnation;
    if (!values || another) return this.renew();
    this.incarnation = values.incarnation;
    this.accept(values, smooth());
  }

  accept(values, smoothly) {
    this.motion.accept(values, performance.now(), smoothly);
    this.efforts = new Map(this.names.map((name, i) => [name, values.efforts[i]]));
    this.fresh = true;
    this.marked();
    this.view.invalidate();
  }

  presence(presence) {
    const offline = presence === lf("offline");
    if (this.offline && !offline) this.renew();
    this.offline = offline;
    this.marked();
  }

  /** Another run of the agent may have another model. */
  async renew() {
    if (this.renewing) return;
    this.renewing = true;
    try {
      const urdf = await fetchModel(this.section.dataset.model, this.ending.signal, this.isSmall);
      await this.describe();
      this.incarnation = undefined;
      if (urdf === this.urdf && !this.missing?.length) this.pose();
      else await this.load();
    } catch (error) {
      if (!this.ending.signal.aborted) console.warn("the robot's description cannot be had at present:", error);
    } finally {
      this.renewing = false;
    }
  }

  /** Show faults and unknown values, in the drawing and in words. */
  marked() {
    this.unknown = new Set(this.motion?.unknown);
    this.panel.mark({ offline: this.offline, unknown: [...this.unknown] });
    const title = this.robot?.robotName || say("the robot");
    const value = this.isPast ? say(" as it was") : this.offline ? say(", offline, as it was last seen") : say(" in its present pose");
    this.panel.name(say("3D drawing of {title}{value}", { title, value }));
    const faint = [...this.unknown].join("\n");
    if (faint !== this.faint) this.fade();
    this.faint = faint;
  }

  fade() {
    for (const part of this.parts) part.faint(Boolean(part.joint && this.unknown.has(part.joint.urdfName)));
    this.view?.invalidate();
  }

  animate(now) {
    if (!this.motion) return false;
    const moved = this.motion.step(now);
    this.around?.carry((iri) => linkAt(this.robot, this.resource(), iri));
    if (moved) this.view.moved(now);
    if (moved) this.picker.refresh();
    if ((moved || this.fresh) && this.mode !== "appearance") this.tint();
    this.fresh = false;
    return this.motion.moving;
  }

  colourBy(mode) {
    this.mode = mode;
    this.paint();
  }

  paint() {
    if (this.mode === "appearance") for (const part of this.parts) part.colour(undefined);
    else this.tint();
    this.fade();
    this.panel.explain(this.mode, this.most ?? "");
    this.view?.invalidate();
  }

  /** Colour each link by its joint. */
  tint() {
    let [highest, where] = [-1, ""];
    for (const part of this.parts) {
      const share = part.joint ? this.share(part.joint) : NaN;
      part.colour(Number.isFinite(share) ? ramp(share) : this.view.colours.none);
      if (share > highest) [highest, where] = [share, part.joint.urdfName];
    }
    this.most = where && say("most: {where}, {percent} %", { where, percent: Math.round(highest * 100) });
    this.panel.explain(this.mode, this.most);
  }

  share(joint) {
    if (this.mode === "effort") return load(joint, this.efforts.get(joint.urdfName) ?? NaN);
    return this.unknown.has(joint.urdfName) ? NaN : proximity(joint, joint.angle);
  }

  positionOf(joint) {
    if (joint.jointType === "fixed") return { value: "", text: "fixed" };
    if (this.unknown.has(joint.urdfName)) return { value: "", text: say("position unknown") };
    const unit = joint.jointType === "prismatic" ? "m" : "rad";
    const position = Math.round(joint.angle / RESOLUTION) * RESOLUTION;
    return { value: String(position), text: `${number(position)} ${unit} (${converted(position, unit)})` };
  }

  /** @returns {Record<string, number>} the drawn position of each joint, in rad or m */
  positions() {
    const joints = Object.values(this.robot?.joints ?? {}).filter(({ jointType }) => jointType !== "fixed");
    return Object.fromEntries(joints.map((joint) => [joint.urdfName, joint.angle]));
  }

  /** @returns {[number, number, number]|undefined} the drawn position of a link's frame, in metre; z is up */
  worldOf(link) {
    const object = Object.hasOwn(this.robot?.links ?? {}, link) ? this.robot.links[link] : undefined;
    return object?.getWorldPosition(new Vector3()).toArray();
  }

  /** @returns {string|undefined} the link drawn at a place of the window, in CSS pixels */
  linkAt(clientX, clientY) {
    return this.picker?.at({ clientX, clientY })?.link.urdfName;
  }

  dispose() {
    this.ending.abort();
    this.sight.disconnect();
    this.stop?.();
    this.stop = undefined;
    for (const part of this.parts) part.dispose();
    this.translucent?.dispose();
    this.view?.dispose();
    this.panel?.leave();
    delete this.section.scene;
  }
}

/** Link the parts of the drawing with their names on the page. */
function page(kind, name) {
  const known = document.querySelector(`a[data-part="${CSS.escape(name)}"][data-part-kind="${kind}"]`);
  return known?.href;
}

function nameOf(iri) {
  for (const each of document.querySelectorAll('a[data-part-kind="joint"]')) if (each.href === iri) return each.dataset.part;
  return undefined;
}
