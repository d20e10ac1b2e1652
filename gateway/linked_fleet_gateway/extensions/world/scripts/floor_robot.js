// One robot on the plan of the floor.

import { say } from "../../pages/scripts/src/say.js";
import { parse } from "../../pages/scripts/src/ntriples.js";
import { poseOf } from "../../pages/scripts/src/pose_of.js";
import { watch } from "../../pages/scripts/src/socket.js";
import { lf, localName, RDF_TYPE } from "../../pages/scripts/src/vocabulary.js";
import { compose, footprint, heading, placed, stations } from "./floor_shapes.js";
import { at, draw, label, polygon, words } from "./floor_svg.js";

const INTERVAL_S = 0.2;
const SYMBOL_M = 0.25; // radius of a robot whose footprint is unknown
const SYMBOL = [[-SYMBOL_M, -SYMBOL_M], [SYMBOL_M, -SYMBOL_M], [SYMBOL_M, SYMBOL_M], [-SYMBOL_M, SYMBOL_M]];
const LEAST_PX = 8; // of the arrow that shows the heading

/** A robot on the floor: the placement of its odometry frame, the base in it, and its footprint. */
export class Robot {
  /**
   * @param {import("../../pages/scripts/src/ntriples.js").Graph} graph the description of the world
   * @param {string} iri
   * @param {() => void} changed is called when it must be drawn again
   */
  constructor(graph, iri, changed) {
    this.iri = iri;
    this.name = localName(iri);
    this.changed = changed;
    const link = (name) => graph.value(iri, lf(name))?.value;
    const [placement, base] = [link("placement"), link("pose")];
    this.floats = Boolean(base);
    /** @type {import("./floor_shapes.js").Pose|undefined} of the base in its odometry frame */
    this.base = undefined;
    /** @type {number[][]|undefined} of the footprint, in the frame of the base */
    this.corners = undefined;
    /** @type {import("./floor_shapes.js").Station[]} in the odometry frame */
    this.stations = [];
    this.ended = false;
    this.placement = poseOf(graph, placement);
    this.ends = [watch(placement, {}, (news) => this.take({ placement: poseOf(news, placement) }))];
    if (base) {
      this.ends.push(watch(base, { interval: INTERVAL_S }, (news) => this.take({ base: poseOf(news, base) })));
      this.findBase().catch((error) => console.debug(`the footprint of ${this.name} is unknown:`, error));
    }
  }

  /** Follow the footprint of the base, and its charging stations. */
  async findBase() {
    const answer = await fetch(this.iri, { headers: { Accept: "application/n-triples" } });
    if (!answer.ok) return;
    const graph = parse(await answer.text());
    const part = graph.having(RDF_TYPE, lf("Base"))[0];
    if (!part || this.ended) return;
    const property = await fetch(part, { headers: { Accept: "application/n-triples" } });
    const about = property.ok ? parse(await property.text()) : undefined;
    const [outline, docks] = ["footprint", "stations"].map((name) => about?.value(part, lf(name))?.value);
    if (outline) this.follow(outline, (news) => ({ corners: footprint(news, outline) }));
    if (docks) this.follow(docks, (news) => ({ stations: stations(news, docks) }));
  }

  follow(iri, read) {
    if (!this.ended) this.ends.push(watch(iri, { interval: 1 }, (news) => this.take(read(news))));
  }

  take(news) {
    Object.assign(this, news);
    this.changed();
  }

  end() {
    this.ended = true;
    for (const each of this.ends) each();
  }

  /** @returns {import("./floor_shapes.js").Pose|undefined} of its base in the world */
  pose() {
    if (!this.placement || (this.floats && !this.base)) return undefined;
    return this.floats ? compose(this.placement, this.base) : this.placement;
  }

  /** @returns {number[][]} corners of all that is drawn of it */
  outline() {
    return [this.pose(), ...this.charging().map(({ pose }) => pose)].flatMap((pose) => (pose ? placed(this.corners ?? SYMBOL, pose) : []));
  }

  /** @returns {import("./floor_shapes.js").Station[]} its stations, in the world */
  charging() {
    const frame = this.placement;
    return frame ? this.stations.map(({ name, pose }) => ({ name, pose: compose(frame, pose) })) : [];
  }

  /** @param {number} scale metres of a pixel */
  draw(scale) {
    const pose = this.pose();
    const charging = this.charging().flatMap((each) => [polygon(placed(this.corners ?? SYMBOL, each.pose), "station"), label(each.name, each.pose.position, scale)]);
    if (!pose) return charging;
    const front = Math.max(SYMBOL_M, ...(this.corners ?? []).map(([forward]) => forward));
    const tip = Math.max(front, LEAST_PX * scale);
    const group = at(pose.position, heading(pose));
    group.append(this.corners ? polygon(this.corners) : draw("circle", { class: "symbol", r: SYMBOL_M }));
    group.append(polygon([[1.4 * tip, 0], [0.6 * tip, 0.35 * tip], [0.6 * tip, -0.35 * tip]], "heading"));
    const link = draw("a", { href: this.iri, class: "robot" });
    link.append(group, label(this.name, pose.position, scale));
    return [...charging, link];
  }

  /** @returns {string[][]} rows of the table: name, address, what it is, place, heading */
  rows() {
    return [this.row(), ...this.charging().map(({ name, pose }) => [name, this.iri, say("charging station of {name}", { name: this.name }), words(pose.position), degrees(pose)])];
  }

  row() {
    const pose = this.pose();
    const what = !this.floats ? say("fixed") : this.corners ? say("base") : say("base, footprint unknown");
    if (!pose) return [this.name, this.iri, what, say("place unknown"), ""];
    return [this.name, this.iri, what, words(pose.position), degrees(pose)];
  }
}

function degrees(pose) {
  return `${Math.round((heading(pose) * 180) / Math.PI) || 0}°`;
}
