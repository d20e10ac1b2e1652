// The world in 3D: all robots that have a place in it, moving, and the objects among them.

import { say } from "../../pages/scripts/src/say.js";
import { Group, Vector3 } from "three";

import { adopt } from "../../pages/scripts/src/region.js";
import { Labels } from "./scene_labels.js";
import { poseOf } from "../../pages/scripts/src/pose_of.js";
import { Objects } from "../../pages/scripts/src/scene_objects.js";
import { Contacts } from "./scene_contacts.js";
import { FloorMap } from "./scene_map.js";
import { Chooser } from "./scene_choice.js";
import { Standing } from "./scene_standing.js";
import { Target } from "../../pages/scripts/src/scene_target.js";
import { View } from "../../pages/scripts/src/scene_view.js";
import { parse } from "../../pages/scripts/src/ntriples.js";
import { watch } from "../../pages/scripts/src/socket.js";
import { HAS_PART, lf } from "../../pages/scripts/src/vocabulary.js";

const AHEAD = "200px"; // prepares a section before it is scrolled into view
const MOST_ROBOTS = 40; // each needs a model and a stream of frames
const ABOVE_FLOOR_M = 0.2;
const APART_M = 2; // robots without a place, in rows
const IN_A_ROW = 5;

/**
 * Draw the world in this section, as `data-world` describes it, with the objects of `data-objects`.
 * `data-phase` says how far it is: loading, ready or failed; `section.scene` is the drawing. A click goes
 * to what is clicked, or, with `data-arranged`, is the event `chosen`; a double click has the camera follow a robot.
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
    /** @type {Map<string, Standing>} by IRI */
    this.robots = new Map();
    this.objects = new Objects(this.ending.signal, () => this.frame());
    this.contacts = new Contacts(); // beside the world: a mark is nothing to be fitted into the view or to be clicked
    this.floor = new FloorMap(() => this.view?.invalidate(true));
    this.all.add(this.objects);
    /** @type {HTMLElement|undefined} */
    this.left = undefined;
    this.undrawn = 0;
    this.phase("loading");
    this.start().catch((error) => this.fail(error));
  }

  phase(phase) {
    this.section.dataset.phase = phase;
    this.section.setAttribute("aria-busy", String(phase === "loading"));
  }

  async start() {
    const frame = Object.assign(document.createElement("div"), { className: "scene-view" });
    const canvas = Object.assign(document.createElement("canvas"), { tabIndex: 0 });
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", say("3D drawing of the robots that are placed in the world, and of the objects in it. F: follow the next robot"));
    canvas.setAttribute("aria-keyshortcuts", "f");
    frame.append(canvas);
    const context = canvas.getContext("webgl2", { antialias: true, alpha: true, powerPreference: "low-power" });
    if (!context) return this.phase("failed"); // the page has a replacement text
    for (const each of /** @type {HTMLElement[]} */ ([...this.section.children])) each.hidden = true;
    this.section.append(frame);
    this.view = new View(canvas, context, (now) => this.animate(now));
    this.view.seen = false;
    this.view.stage(this.all);
    this.view.scene.add(this.contacts, this.floor);
    this.said = Object.assign(document.createElement("p"), { className: "hidden" });
    this.said.setAttribute("role", "status");
    frame.append(this.said);
    this.labels = new Labels(frame, this.view, (iri) => this.follow(iri));
    canvas.addEventListener("keydown", (event) => this.key(event), { signal: this.view.ending.signal });
    this.chooser = new Chooser(this.view, {
      meshes: () => this.meshes(),
      chosen: (iri) => this.choose(iri),
      followed: (iri) => this.robots.has(iri) && this.follow(iri),
    });
    this.sight = new IntersectionObserver((entries) => this.seen(entries.at(-1).isIntersecting), { rootMargin: AHEAD });
    this.sight.observe(this.section);
    await this.meet();
    this.frame();
    this.phase("ready");
    this.section.dispatchEvent(new Event("drawn"));
    adopt(() => this.meet().catch((error) => console.debug("the world cannot be had at present:", error)));
  }

  fail(error) {
    console.warn("the world is not drawn:", error);
    for (const each of /** @type {HTMLElement[]} */ ([...this.section.children])) each.hidden = each.matches(".scene-view");
    this.view?.dispose();
    this.phase("failed");
  }

  /** Draw the robots that are in the world at present, and no others. */
  async meet() {
    const answer = await fetch(this.section.dataset.world, { headers: { Accept: "application/n-triples" }, signal: this.ending.signal });
    if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
    const graph = parse(await answer.text());
    const world = answer.url || this.section.dataset.world;
    const all = graph.values(world, HAS_PART).map(({ value }) => value);
    const described = all.filter((iri) => graph.value(iri, lf("model")));
    const placed = (iri) => Boolean(poseOf(graph, graph.value(iri, lf("placement"))?.value));
    const drawable = [...described.filter(placed), ...described.filter((iri) => !placed(iri))].slice(0, MOST_ROBOTS);
    for (const [iri, robot] of this.robots) if (!drawable.includes(iri)) this.forget(iri, robot);
    const fresh = drawable.filter((iri) => !this.robots.has(iri)).map((iri) => new Standing(graph, iri, this));
    for (const robot of fresh) {
      this.robots.set(robot.iri, robot);
      this.all.add(robot.place);
      this.labels.add(robot);
    }
    this.undrawn = described.length - drawable.length;
    this.lineUp();
    this.listen();
    await this.labels.first;
    await Promise.all(fresh.map((robot) => robot.meet()));
  }

  /** Where no robot has a place in the world, show them side by side, except on the page where they get their places. */
  lineUp() {
    const all = [...this.robots.values()];
    const without = all.filter(({ stood }) => !stood);
    const aside = !("arranged" in this.section.dataset) && without.length > 0 && without.length === all.length;
    all.forEach((robot, index) => {
      const place = [APART_M * (index % IN_A_ROW), -APART_M * Math.floor(index / IN_A_ROW), 0];
      robot.lend(aside ? { position: place, orientation: [0, 0, 0, 1] } : undefined);
    });
    this.section.toggleAttribute("data-aside", aside);
    this.tellLeft(this.undrawn, without.length, aside);
  }

  /** Show how many robots are not drawn, above the limit or without a placement, or that their places mean nothing. */
  tellLeft(count, unplaced, aside) {
    if (!this.labels) return;
    if (!this.left) this.labels.box.after((this.left = Object.assign(document.createElement("p"), { className: "scene-badge" })));
    const without = aside ? say("Nobody has placed the robots: they are shown side by side. ") : say("Without a place in the world: {unplaced} of the robots", { unplaced });
    const said = [count && say("{count} more robots are not drawn", { count }), unplaced && without].filter(Boolean).join(" · ");
    this.left.hidden = !said;
    const link = Object.assign(document.createElement("a"), { href: this.section.dataset.world, textContent: say("Place them") });
    this.left.replaceChildren(said, ...(aside ? [link] : []));
  }

  forget(iri, robot) {
    robot.dispose();
    this.labels.remove(robot);
    this.robots.delete(iri);
  }

  lacks(robot, error) {
    if (!this.ending.signal.aborted) console.warn(`${robot.name} is not drawn:`, error);
  }

  /** Neither draw nor follow what is not visible. */
  seen(seen) {
    if (!this.section.isConnected) return this.dispose();
    this.inSight = seen;
    this.view.show(seen);
    this.listen();
  }

  listen() {
    const iri = new URL(this.section.dataset.objects, document.baseURI).href;
    if (this.inSight) this.stop ??= watch(iri, { interval: 0.2 }, (graph) => this.objects.show(graph, iri));
    else this.stop = this.stop?.();
    if (this.inSight) this.stopMap ??= this.followMap();
    else this.stopMap = this.stopMap?.();
    if (this.inSight) this.stopContacts ??= this.followContacts();
    else this.stopContacts = this.stopContacts?.();
    for (const robot of this.robots.values()) robot.listen(this.inSight);
  }

  /** @returns {(() => void)|undefined} a function that ends it; undefined on pages without a map */
  followMap() {
    const { map } = this.section.dataset;
    if (!map) return undefined;
    const iri = new URL(map, document.baseURI).href;
    return watch(iri, {}, (graph) => this.floor.show(graph, iri));
  }

  /** @returns {(() => void)|undefined} a function that ends it; undefined on pages without a list of refused motions */
  followContacts() {
    const { collisions } = this.section.dataset;
    if (!collisions) return undefined;
    const iri = new URL(collisions, document.baseURI).href;
    return watch(iri, {}, (graph) => {
      this.contacts.show(graph, iri, this.view.colours.refused);
      this.section.dataset.contacts = String(this.contacts.children.length);
      this.view.invalidate();
    });
  }

  /** Show all of the world, unless the user has moved the camera. */
  frame() {
    if (this.view?.untouched ?? true) this.view?.fit();
    else this.view.invalidate(true);
  }

  animate(now) {
    const robots = [...this.robots.values()];
    const moved = robots.map((robot) => robot.step(now)).some(Boolean);
    if (moved) this.view.moved(now);
    this.objects.carry((iri) => robots.map((robot) => robot.linkAt(iri)).find(Boolean));
    this.chase();
    this.labels?.place();
    return robots.some(({ motion }) => motion?.moving);
  }

  /** Choose a thing on a page with its forms; on any other page, open the page of the thing. */
  choose(iri) {
    if ("arranged" in this.section.dataset) this.section.dispatchEvent(new CustomEvent("chosen", { detail: iri }));
    else location.assign(iri);
  }

  /** F follows one robot after the other, and then none. */
  key(event) {
    if (event.key !== "f" || event.ctrlKey || event.metaKey || event.altKey) return;
    const shown = [...this.robots.values()].filter(({ place }) => place.visible);
    this.follow(shown[shown.indexOf(this.followed) + 1]?.iri);
    event.preventDefault();
  }

  /** Keep a robot in the middle of the view; without one, show all of the world again. */
  follow(iri) {
    this.followed = this.robots.get(iri);
    this.before = this.followed?.base();
    this.section.dataset.following = this.followed?.name ?? "";
    this.leave?.remove();
    this.said.textContent = this.followed ? "" : say("All of the world is in view");
    if (!this.followed) return this.view.fit();
    this.view.untouched = false;
    this.view.approach(this.followed.place);
    const text = say("Following {title} · show all", { title: this.followed.title });
    this.leave = Object.assign(document.createElement("button"), { type: "button", className: "scene-following", textContent: text });
    this.leave.onclick = () => this.follow();
    this.labels.box.after(this.leave);
    this.said.textContent = text;
  }

  chase() {
    if (!this.followed) return;
    const now = this.followed.base();
    this.view.shift(now.clone().sub(this.before));
    this.before = now;
  }

  /** @returns {object[]} the meshes that can be chosen, each with `userData.iri` or below a group that has one */
  meshes() {
    return [this.objects, ...[...this.robots.values()].filter(({ place }) => place.visible).map(({ place }) => place)];
  }

  /** @returns {number[]} the point on the floor at which the camera looks, slightly above it */
  middle() {
    const { x, y } = this.view.controls.target;
    return [x, y, ABOVE_FLOOR_M];
  }

  /** Show a draggable target in the frame of the world. */
  target(onDrag) {
    const target = new Target(this.view, this.all, onDrag);
    this.chooser.quiet = () => target.busy;
    return target;
  }

  /**
   * Draw a draft, or remove it.
   *
   * @param {import("../../pages/scripts/src/ntriples.js").Graph} [graph] about the node `_:n0`
   * @param {string} [iri] of the object or the robot
   * @param {boolean} [robot] whether it is a robot, of which only the placement changes
   */
  draft(graph, iri, robot = false) {
    this.moving?.draft();
    this.moving = robot ? this.robots.get(iri) : undefined;
    this.moving?.draft(poseOf(graph, "_:n0"));
    this.objects.draft(robot ? undefined : graph, iri);
  }

  /** @returns {Record<string, [number, number, number]>} by title, the drawn position of each object and robot */
  standing() {
    const places = [...this.robots.values()].map(({ place }) => place);
    const things = [...this.objects.children, ...places].filter(({ visible }) => visible);
    return Object.fromEntries(things.map((each) => [each.name, each.getWorldPosition(new Vector3()).toArray()]));
  }

  dispose() {
    this.ending.abort();
    this.sight.disconnect();
    this.inSight = false;
    this.listen();
    this.view?.dispose();
    delete this.section.scene;
  }
}
