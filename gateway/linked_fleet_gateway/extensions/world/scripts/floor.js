// The floor from above: the map, outlines of objects, and robots with their headings. It needs no WebGL and little of a phone.

import { say } from "../../pages/scripts/src/say.js";
import { robotCount } from "../../pages/scripts/src/format.js";
import { adopt } from "../../pages/scripts/src/region.js";
import { parse } from "../../pages/scripts/src/ntriples.js";
import { poseOf } from "../../pages/scripts/src/pose_of.js";
import { watch } from "../../pages/scripts/src/socket.js";
import { HAS_PART, lf, RDF_TYPE, TITLE } from "../../pages/scripts/src/vocabulary.js";
import { mapOf } from "./floor_map.js";
import { enable } from "./floor_upload.js";
import { Robot } from "./floor_robot.js";
import { heading, outline, placed } from "./floor_shapes.js";
import { draw, label, polygon, transform, words } from "./floor_svg.js";

const CONTAINS = "http://www.w3.org/ns/ldp#contains";
const INTERVAL_S = 0.2;
const MOST_ROBOTS = 40; // each needs two subscriptions
const MARGIN_M = 0.5;
const MARK_PX = 6; // of an object whose form is not drawn
const EMPTY = [-2, 2]; // of a plan without anything on it, in metre
const NARROW_PX = 360; // before the plan is laid out
const [FURTHEST, NEAREST] = [1, 16];

/** @typedef {{iri: string, title: string, zone: boolean, corners?: number[][], pose?: import("./floor_shapes.js").Pose}} Thing */

/** Draw the floor in this section, as `data-floor`, `data-world` and `data-objects` describe it. */
export function show(/** @type {HTMLElement} */ section) {
  new Floor(section).start();
  enable();
}

class Floor {
  constructor(section) {
    this.section = section;
    this.zoom = 1;
    /** @type {Map<string, Robot>} by IRI */
    this.robots = new Map();
    /** @type {Thing[]} */
    this.objects = [];
    this.svg = draw("svg", { role: "group", "aria-labelledby": "floor-said" });
    this.layers = Object.fromEntries(["map", "objects", "robots"].map((name) => [name, this.svg.appendChild(draw("g", { class: name }))]));
    const frame = section.querySelector(".floor-plan");
    frame.append(this.svg);
    frame.hidden = false;
    for (const [name, factor] of /** @type {const} */ ([["in", 2], ["out", 0.5], ["whole", 0]])) {
      section.querySelector(`[data-zoom=${name}]`).onclick = () => this.magnify(factor);
    }
  }

  start() {
    const { floor, objects } = this.section.dataset;
    const [map, container] = [floor, objects].map((path) => new URL(path, document.baseURI).href);
    watch(map, {}, (graph) => this.showMap(mapOf(graph, map)));
    watch(container, { interval: INTERVAL_S }, (graph) => this.showObjects(graph, container));
    adopt(() => this.meet().catch((error) => console.debug("the world cannot be had at present:", error)));
  }

  /** Follow the robots that are in the world at present. */
  async meet() {
    const answer = await fetch(this.section.dataset.world, { headers: { Accept: "application/n-triples" } });
    if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
    const graph = parse(await answer.text());
    const world = new URL(this.section.dataset.world, document.baseURI).href;
    const here = graph.values(world, HAS_PART).map(({ value }) => value).slice(0, MOST_ROBOTS);
    for (const [iri, robot] of this.robots) if (!here.includes(iri)) this.forget(iri, robot);
    for (const iri of here) if (!this.robots.has(iri)) this.robots.set(iri, new Robot(graph, iri, () => this.later()));
    this.later();
  }

  forget(iri, robot) {
    robot.end();
    this.robots.delete(iri);
  }

  showMap(map) {
    this.map = map;
    this.layers.map.replaceChildren();
    if (map) {
      const { width, height, picture, pose } = map;
      const where = { width, height, y: -height, transform: transform(pose.position, heading(pose)) };
      this.layers.map.append(draw("image", { href: picture, preserveAspectRatio: "none", ...where }));
    }
    this.fitted = undefined;
    this.later();
  }

  showObjects(graph, container) {
    const standing = graph.values(container, CONTAINS).filter(({ value: iri }) => !graph.value(iri, lf("heldBy")));
    this.objects = standing.map(({ value: iri }) => ({
      iri,
      title: graph.value(iri, TITLE)?.value ?? "object",
      zone: graph.values(iri, RDF_TYPE).some(({ value }) => value === lf("KeepOutZone")),
      corners: outline(graph, iri),
      pose: poseOf(graph, iri),
    }));
    this.later();
  }

  /** Draw once, however many messages have come. */
  later() {
    this.pending ??= requestAnimationFrame(() => {
      this.pending = undefined;
      this.draw();
    });
  }

  draw() {
    const robots = [...this.robots.values()];
    this.fit(robots);
    const { left, right, low, high } = this.fitted;
    // Metres of a pixel: the plan is as wide or as high as its frame.
    const scale = Math.max((right - left) / (this.svg.clientWidth || NARROW_PX), (high - low) / (this.svg.clientHeight || NARROW_PX));
    this.layers.objects.replaceChildren(...this.objects.flatMap((each) => drawnObject(each, scale)));
    this.layers.robots.replaceChildren(...robots.flatMap((each) => each.draw(scale)));
    this.tell(robots);
  }

  /** Show all; anew only when something has left the plan, so that it does not move under a finger. */
  fit(robots) {
    const { width = 0, height = 0, pose } = this.map ?? {};
    const corners = pose ? placed([[0, 0], [width, 0], [width, height], [0, height]], pose) : [];
    const things = this.objects.flatMap(({ corners: own, pose: at }) => own ?? (at ? [at.position] : []));
    const points = [...corners, ...things, ...robots.flatMap((each) => each.outline())];
    if (this.fitted && points.every((each) => this.shows(each))) return;
    const [xs, ys] = [0, 1].map((axis) => (points.length ? points.map((each) => each[axis]) : EMPTY));
    const [left, low] = [Math.min(...xs) - MARGIN_M, Math.min(...ys) - MARGIN_M];
    this.fitted = { left, low, right: Math.max(...xs) + MARGIN_M, high: Math.max(...ys) + MARGIN_M };
    const { right, high } = this.fitted;
    this.svg.setAttribute("viewBox", `${left} ${-high} ${right - left} ${high - low}`);
  }

  shows([x, y]) {
    const { left, low, right, high } = this.fitted;
    return left <= x && x <= right && low <= y && y <= high;
  }

  magnify(factor) {
    this.zoom = factor ? Math.min(NEAREST, Math.max(FURTHEST, this.zoom * factor)) : 1;
    this.svg.style.width = `${100 * this.zoom}%`;
    this.svg.style.maxHeight = this.zoom > 1 ? "none" : "";
    this.section.querySelector("[data-zoom=out]").disabled = this.section.querySelector("[data-zoom=whole]").disabled = this.zoom <= FURTHEST;
    this.section.querySelector("[data-zoom=in]").disabled = this.zoom >= NEAREST;
    this.later();
  }

  /** Say in words what is drawn, for those who do not see it. */
  tell(robots) {
    const named = this.map ? say("Map {title}", { title: this.map.title }) : say("No map of the floor");
    const drawn = robotCount(robots.length);
    const things = this.objects.length === 1 ? say("1 object") : say("{count} objects", { count: this.objects.length });
    const said = `${named}, ${drawn}, ${things}`;
    const caption = this.section.querySelector("#floor-said");
    if (caption.textContent !== said) caption.textContent = said;
    const rows = [...robots.flatMap((each) => each.rows()), ...this.objects.map(rowOf)];
    const text = JSON.stringify(rows);
    if (text === this.told) return;
    this.told = text;
    this.section.querySelector("tbody").replaceChildren(...rows.map(tableRow));
    this.section.dataset.phase = "ready";
  }
}

/** @param {Thing} thing @param {number} scale */
function drawnObject({ title, zone, corners, pose }, scale) {
  if (!pose) return [];
  const kind = zone ? "zone" : "obstacle";
  const [x, y] = pose.position;
  const size = MARK_PX * scale;
  const mark = [[x - size, y], [x, y - size], [x + size, y], [x, y + size]];
  return [polygon(corners ?? mark, kind), label(title, pose.position, scale)];
}

/** @param {Thing} thing */
function rowOf({ title, iri, zone, corners, pose }) {
  const kind = zone ? say("keep-out zone") : say("obstacle");
  return [title, iri, corners ? kind : say("{kind}, form not drawn", { kind }), pose ? words(pose.position) : say("place unknown"), ""];
}

/** @param {string[]} cells */
function tableRow([name, iri, what, where, looks]) {
  const row = document.createElement("tr");
  const link = Object.assign(document.createElement("a"), { href: iri, textContent: name });
  const head = Object.assign(document.createElement("th"), { scope: "row" });
  head.append(link);
  row.append(head, ...[what, where, looks].map((textContent) => Object.assign(document.createElement("td"), { textContent })));
  return row;
}
