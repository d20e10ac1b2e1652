// What stood around a robot at an instant: other robots and the objects of the world, drawn as they were.

import { Group } from "three";

import { Moments } from "./moments.js";
import { parse } from "../../pages/scripts/src/ntriples.js";
import { poseOf } from "../../pages/scripts/src/pose_of.js";
import { say } from "../../pages/scripts/src/say.js";
import { linkAt } from "../../pages/scripts/src/scene_links.js";
import { build, complete, fetchModel, loadMeshes } from "../../pages/scripts/src/scene_model.js";
import { Motion } from "../../pages/scripts/src/scene_motion.js";
import { Objects, put } from "../../pages/scripts/src/scene_objects.js";
import { HAS_PART, lf, localName, TITLE, UNKNOWN } from "../../pages/scripts/src/vocabulary.js";

const MOST_OTHERS = matchMedia("(max-width: 40rem)").matches ? 2 : 4; // each needs a model and a history
const LONGEST_MS = 20000;
const MOST_KEPT = 20;
const LATE_S = 2; // what is written to disk may be as late
const CONTAINS = "http://www.w3.org/ns/ldp#contains";

/** @typedef {import("../../pages/scripts/src/ntriples.js").Graph} Graph */
/** @typedef {{graph: Graph, begin: number, end: number}} World what held from `begin` on and before `end`, in seconds since 1970 */

export class Surroundings extends Group {
  /**
   * @param {string} robot the IRI of the robot in the middle
   * @param {string} history that of its history
   * @param {any} scene the drawing of the robot
   */
  constructor(robot, history, scene) {
    super();
    this.of = robot;
    this.address = `${history}/world`;
    this.scene = scene;
    this.signal = scene.ending.signal;
    this.objects = new Objects(this.signal, () => scene.view?.invalidate(true));
    this.add(this.objects);
    /** @type {Map<string, Other>} by IRI */
    this.others = new Map();
    /** @type {World[]} */
    this.kept = [];
  }

  /** Fetch what stood there at a time. @returns {Promise<() => string>} a function that draws it, and returns what a reader must know of the drawing */
  async at(/** @type {number} */ time) {
    const world = await this.world(time);
    if (!world) return () => this.nothing(say("What stood around it at this time is not kept."));
    const { graph } = world;
    const place = poseOf(graph, graph.value(this.of, lf("placement"))?.value);
    if (!place) return () => this.nothing(say("It had no place in the world at this time, so nothing is drawn around it."));
    const all = graph.values(this.address, HAS_PART).map(({ value }) => value);
    const others = all.filter((iri) => iri !== this.of && graph.value(iri, lf("history")));
    const near = others.slice(0, MOST_OTHERS);
    for (const iri of near) if (!this.others.has(iri)) this.others.set(iri, new Other(graph, iri, this));
    const moments = await Promise.all(near.map((iri) => this.others.get(iri).at(time)));
    const then = new Map(near.map((iri, index) => [iri, moments[index]]));
    const beyond = others.length - near.length + Number(graph.value(this.address, lf("robotsNotDescribed"))?.value ?? 0);
    return () => this.draw(world, place, then, beyond);
  }

  nothing(text) {
    this.scene.among(this, undefined);
    return text;
  }

  draw(world, place, then, beyond) {
    const { graph } = world;
    for (const [iri, other] of this.others) other.show(poseOf(graph, graph.value(iri, lf("placement"))?.value), then.get(iri));
    if (this.drawn !== world) this.objects.show(graph, this.address);
    this.drawn = world;
    this.scene.among(this, place);
    this.objects.carry((iri) => this.linkOf(iri));
    return this.told(graph, [...then.keys()].map((iri) => this.others.get(iri)), beyond);
  }

  /** Return sentences about what is drawn, and about what is not, or not as it was. */
  told(/** @type {Graph} */ graph, /** @type {Other[]} */ others, beyond) {
    const title = (iri) => graph.value(iri, TITLE)?.value ?? localName(iri);
    const things = graph.values(this.address, CONTAINS).map(({ value }) => value);
    const drawn = new Set(this.objects.children.filter(({ visible }) => visible).map(({ userData }) => userData.iri));
    const isKnown = (iri) => graph.value(iri, lf("geometry"));
    const [seen, held] = [things.filter((iri) => drawn.has(iri)), things.filter((iri) => !drawn.has(iri) && isKnown(iri))];
    const boxes = seen.filter((iri) => graph.value(iri, lf("shapeNotKept")));
    const titles = (iris) => iris.map(title).join(", ");
    const named = (robots) => robots.map((each) => each.title).join(", ");
    const shown = others.filter(({ place }) => place.visible);
    const failed = others.filter((each) => each.failed);
    const silent = others.filter((each) => !each.failed && !each.place.visible);
    const around = [named(shown), titles(seen)].filter(Boolean).join(", ");
    const unreadable = [named(failed), titles(things.filter((iri) => !isKnown(iri)))].filter(Boolean).join(", ");
    return [
      around && say("Around it, as they were: {names}.", { names: around }),
      silent.length && say("Not heard at this time, and not drawn: {names}.", { names: named(silent) }),
      boxes.length && say("Drawn as boxes of their size, because their shapes of this time are not kept: {names}.", { names: titles(boxes) }),
      held.length && say("Not drawn, because it is unknown where they were held: {names}.", { names: titles(held) }),
      unreadable && say("Cannot be drawn: {names}.", { names: unreadable }),
      beyond > 0 && say("{count} more robots of the world are not drawn.", { count: beyond }),
    ].filter(Boolean).join(" ");
  }

  /** Move what the drawn robots hold with their links. */
  carry(/** @type {(iri: string) => any} */ ofRobot) {
    this.ofRobot = ofRobot;
    this.objects.carry((iri) => this.linkOf(iri));
  }

  linkOf(iri) {
    return this.ofRobot?.(iri) ?? [...this.others.values()].map((each) => each.linkAt(iri)).find(Boolean);
  }

  /** @returns {Promise<World|undefined>} */
  async world(/** @type {number} */ time) {
    const known = this.kept.find(({ begin, end }) => begin <= time && time < end);
    if (known) return known;
    const asked = Date.now() / 1000;
    const address = `${this.address}?at=${encodeURIComponent(new Date(time * 1000).toISOString())}`;
    const signal = AbortSignal.any([this.signal, AbortSignal.timeout(LONGEST_MS)]);
    const answer = await fetch(address, { headers: { Accept: "application/n-triples" }, signal });
    if (answer.status === 404) return undefined;
    if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
    const graph = parse(await answer.text());
    const [begin, end] = ["from", "to"].map((name) => graph.value(this.address, lf(name))?.value);
    if (!begin || begin === UNKNOWN) return undefined;
    const world = { graph, begin: Date.parse(begin) / 1000, end: end ? Date.parse(end) / 1000 : asked - LATE_S };
    this.kept.push(world);
    if (this.kept.length > MOST_KEPT) this.kept.shift();
    return world;
  }
}

/** Another robot, which is not drawn while nothing is known of it. */
class Other {
  constructor(/** @type {Graph} */ graph, /** @type {string} */ iri, /** @type {Surroundings} */ around) {
    this.iri = iri;
    this.around = around;
    this.title = localName(iri);
    this.place = new Group();
    this.place.visible = false;
    this.moments = new Moments(graph.value(iri, lf("history")).value, false);
    this.failed = false;
    this.ready = this.load(graph.value(iri, lf("model")).value).catch((error) => this.fail(error));
    around.add(this.place);
  }

  async load(/** @type {string} */ model) {
    const { signal, scene } = this.around;
    const { robot, meshes } = build(await fetchModel(model, signal, true), model);
    this.robot = robot;
    this.place.add(robot);
    loadMeshes(meshes, () => scene.view?.invalidate(true), signal).then(() => complete(robot, scene.view.colours.bone), (error) => this.fail(error));
  }

  fail(error) {
    this.failed = true;
    if (!this.around.signal.aborted) console.warn(`${this.iri} is not drawn:`, error);
  }

  /** @returns {Promise<import("./moments.js").Then|undefined>} */
  async at(time) {
    await this.ready;
    if (this.failed) return undefined;
    return this.moments.at(time).catch(() => undefined);
  }

  /** @param {import("../../pages/scripts/src/scene_target.js").Pose|undefined} place @param {import("./moments.js").Then|undefined} then */
  show(place, then) {
    const known = Boolean(place && then && this.robot && !this.failed && then.names.every((name) => Object.hasOwn(this.robot.joints, name)));
    this.place.visible = known;
    if (!known) return;
    put(this.place, place);
    if (this.names !== then.names.join("\n")) {
      this.names = then.names.join("\n");
      this.motion = new Motion(this.robot, then.names);
    }
    this.motion.accept({ positions: then.positions, base: then.base }, performance.now(), false);
    this.motion.step(performance.now());
  }

  linkAt(iri) {
    return this.place.visible ? linkAt(this.robot, this.iri, iri) : undefined;
  }
}
