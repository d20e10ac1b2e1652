// The world in 3D: all robots that have a place in it, moving, and the objects among them.

import { Group, Vector3 } from "three";

import { build, complete, fetchModel, loadMeshes, meshesOf } from "./scene_model.js";
import { Motion } from "./scene_motion.js";
import { Objects, poseOf, put } from "./scene_objects.js";
import { Part } from "./scene_parts.js";
import { fetchBase, fetchState } from "./scene_state.js";
import { smooth, View } from "./scene_view.js";
import { watch } from "./socket.js";

const INTERVAL_S = 0.033; // 30 Hz
const ESCAPED = /~([0-9A-F]{2})/g;

/**
 * Draw the world in this section, from `data-objects` and from the robots that the page lists (`data-stands`).
 * `data-phase` says how far it is: loading, ready or failed; `section.scene` is the drawing.
 *
 * @param {HTMLElement} section
 */
export function show(section) {
  section.scene ??= new WorldScene(section);
}

class WorldScene {
  constructor(section) {
    this.section = section;
    this.ending = new AbortController();
    this.all = new Group();
    this.phase("loading");
    this.robots = [...document.querySelectorAll("[data-stands]")].map((each) => new Standing(each.dataset, this));
    this.objects = new Objects(this.ending.signal, () => this.frame());
    this.all.add(this.objects, ...this.robots.map(({ place }) => place));
    this.start();
  }

  phase(phase) {
    this.section.dataset.phase = phase;
    this.section.setAttribute("aria-busy", String(phase === "loading"));
  }

  async start() {
    const frame = document.createElement("div");
    frame.className = "scene-view";
    const canvas = Object.assign(document.createElement("canvas"), { tabIndex: 0 });
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "3D drawing of the robots that are placed in the world, and of the objects in it");
    frame.append(canvas);
    const context = canvas.getContext("webgl2", { antialias: true, alpha: true, powerPreference: "low-power" });
    if (!context) return this.phase("failed"); // the page says what takes its place
    for (const each of [...this.section.children]) each.hidden = true;
    this.section.append(frame);
    this.view = new View(canvas, context, (now) => this.animate(now));
    this.view.stage(this.all);
    this.follow();
    await Promise.all(this.robots.map((robot) => robot.load(this.ending.signal).catch((error) => this.lacks(robot, error))));
    this.frame();
    this.phase("ready");
  }

  lacks(robot, error) {
    console.warn(`${robot.name} is not drawn:`, error);
  }

  /** Follow what stands where. */
  follow() {
    const iri = new URL(this.section.dataset.objects, document.baseURI).href;
    watch(iri, { interval: 0.2 }, (graph) => this.objects.show(graph, iri));
    for (const robot of this.robots) robot.follow();
  }

  /** All of the world is in the view as long as nobody has chosen another. */
  frame() {
    if (this.view?.untouched ?? true) this.view?.fit();
    else this.view.invalidate(true);
  }

  animate(now) {
    const moved = this.robots.map((robot) => robot.step(now)).some(Boolean);
    if (moved) this.view.moved(now);
    return this.robots.some(({ motion }) => motion?.moving);
  }

  /** @returns {Record<string, [number, number, number]>} by title where each object is drawn, and each robot that is */
  standing() {
    const things = [...this.objects.children, ...this.robots.filter(({ place }) => place.visible).map(({ place }) => place)];
    return Object.fromEntries(things.map((each) => [each.name, each.getWorldPosition(new Vector3()).toArray()]));
  }
}

/** One robot; `place` is where it stands, and is not shown as long as nobody knows. */
class Standing {
  /** @param {DOMStringMap} data of the element of the page that names it */
  constructor({ stands, model, state, pose, placement }, world) {
    this.world = world;
    this.name = stands;
    this.model = model;
    this.state = state;
    this.pose = pose;
    this.placement = placement;
    this.place = new Group();
    this.place.name = stands;
    this.place.visible = false;
  }

  async load(signal) {
    const [urdf, state, base] = await Promise.all([
      fetchModel(this.model, signal),
      fetchState(new URL(this.state, document.baseURI).href, signal),
      this.pose ? fetchBase(new URL(this.pose, document.baseURI).href, signal) : undefined,
    ]);
    const { robot, meshes } = build(urdf, this.model);
    this.motion = new Motion(robot, state.joints.map(nameOf));
    this.motion.accept({ ...state.present, base }, performance.now(), false);
    this.motion.step(performance.now());
    this.place.add(robot);
    watch(this.state, { protocol: "lf.frame", interval: INTERVAL_S }, (frame) => this.take(state.decode(frame)));
    await loadMeshes(meshes, () => {}, signal);
    complete(robot, this.world.view.colours.bone);
    this.parts = Object.values(robot.links).flatMap((link) => {
      const shapes = meshesOf(link);
      return shapes.length ? [new Part(link, shapes)] : [];
    });
    this.world.frame();
  }

  follow() {
    const iri = new URL(this.placement, document.baseURI).href;
    watch(iri, {}, (graph) => {
      const pose = poseOf(graph, iri);
      this.place.visible = Boolean(pose);
      if (pose) put(this.place, pose);
      this.world.frame();
    });
  }

  take(values) {
    if (!values) return; // of another run of the agent: the page, loaded anew, has its description
    this.motion.accept(values, performance.now(), smooth());
    this.world.view.invalidate();
  }

  step(now) {
    return this.motion?.step(now) ?? false;
  }
}

/** The name of a joint, as the last segment of its IRI spells it. */
function nameOf(iri) {
  const segment = iri.slice(iri.lastIndexOf("/") + 1);
  return decodeURIComponent(segment.replace(ESCAPED, "%$1"));
}
