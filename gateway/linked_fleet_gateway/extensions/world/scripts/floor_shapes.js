// Things seen from above: outlines and headings on the floor. Metre and radian, in the world.

import { key } from "../../pages/scripts/src/ntriples.js";
import { length, MATHS, poseOf } from "../../pages/scripts/src/pose_of.js";
import { lf, NUMERICAL_VALUE, RDF_TYPE } from "../../pages/scripts/src/vocabulary.js";

const ROUND = 24; // corners of a circle
const REST = "http://www.w3.org/1999/02/22-rdf-syntax-ns#rest";
const FIRST = "http://www.w3.org/1999/02/22-rdf-syntax-ns#first";
const NIL = "http://www.w3.org/1999/02/22-rdf-syntax-ns#nil";

/** @typedef {{position: number[], orientation: number[]}} Pose */

/** @returns {number[]} a vector turned by a unit quaternion */
export function turned(/** @type {number[]} */ [x, y, z], /** @type {number[]} */ [a, b, c, w]) {
  const [u, v, t] = [2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)];
  return [x + w * u + b * t - c * v, y + w * v + c * u - a * t, z + w * t + a * v - b * u];
}

/** @param {Pose} frame @param {Pose} pose in the frame @returns {Pose} */
export function compose(frame, pose) {
  const [a, b, c, w] = frame.orientation;
  const [x, y, z, s] = pose.orientation;
  const there = turned(pose.position, frame.orientation);
  return {
    position: frame.position.map((value, axis) => value + there[axis]),
    orientation: [w * x + a * s + b * z - c * y, w * y - a * z + b * s + c * x, w * z + a * y - b * x + c * s, w * s - a * x - b * y - c * z],
  };
}

/** @param {Pose} pose @returns {number} the direction of its x axis seen from above */
export function heading({ orientation }) {
  const [x, y] = turned([1, 0, 0], orientation);
  return Math.atan2(y, x);
}

/** @param {number[][]} corners in the frame of the pose @param {Pose} pose @returns {number[][]} x and y of each in the world */
export function placed(corners, { position, orientation }) {
  return corners.map((corner) => {
    const [x, y] = turned([corner[0], corner[1], corner[2] ?? 0], orientation);
    return [position[0] + x, position[1] + y];
  });
}

/**
 * @param {import("../../pages/scripts/src/ntriples.js").Graph} graph
 * @param {string} iri of an object of the world
 * @returns {number[][]|undefined} the corners of its outline; undefined if its place or form is unknown here, as that of a mesh
 */
export function outline(graph, iri) {
  const pose = poseOf(graph, iri);
  const geometry = graph.value(iri, lf("geometry"));
  const corners = pose && geometry && form(graph, key(geometry));
  return corners?.flat().every(Number.isFinite) ? hull(placed(corners, pose)) : undefined;
}

function form(graph, node) {
  const type = graph.value(node, RDF_TYPE)?.value;
  const scalar = (name) => length(graph, graph.value(node, lf(name)), NUMERICAL_VALUE);
  if (type === lf("Box")) {
    const [x, y, z] = ["x", "y", "z"].map((axis) => length(graph, graph.value(node, lf("size")), MATHS + axis) / 2);
    return [-z, z].flatMap((up) => [[-x, -y, up], [x, -y, up], [x, y, up], [-x, y, up]]);
  }
  if (type === lf("Cylinder")) return [-1, 1].flatMap((end) => circle(scalar("radius"), (end * scalar("length")) / 2));
  if (type === lf("Sphere")) return [...circle(scalar("radius"), 0), ...circle(scalar("radius"), 0).map(([x, y]) => [x, 0, y]), ...circle(scalar("radius"), 0).map(([x, y]) => [0, x, y])];
  return undefined;
}

function circle(radius, z) {
  return Array.from({ length: ROUND }, (_, index) => {
    const angle = (2 * Math.PI * index) / ROUND;
    return [radius * Math.cos(angle), radius * Math.sin(angle), z];
  });
}

/** Return the convex hull of points, counterclockwise (Andrew's monotone chain). */
export function hull(points) {
  const sorted = [...points].sort(([a, b], [c, d]) => a - c || b - d);
  return [...half(sorted), ...half(sorted.reverse())];
}

function half(points) {
  const found = [];
  for (const point of points) {
    while (found.length > 1 && turn(found.at(-2), found.at(-1), point) <= 0) found.pop();
    found.push(point);
  }
  return found.slice(0, -1);
}

function turn([a, b], [c, d], [e, f]) {
  return (c - a) * (f - b) - (d - b) * (e - a);
}

/** @typedef {{name: string, pose: Pose}} Station */

/**
 * @param {import("../../pages/scripts/src/ntriples.js").Graph} graph
 * @param {string} iri of the property `footprint` of a base
 * @returns {number[][]|undefined} its corners in the frame of the base
 */
export function footprint(graph, iri) {
  const corners = items(graph, iri).map((item) => ["x", "y"].map((name) => scalar(graph, item, name)));
  return corners.length > 2 && corners.flat().every(Number.isFinite) ? corners : undefined;
}

/**
 * @param {import("../../pages/scripts/src/ntriples.js").Graph} graph
 * @param {string} iri of the property `stations` of a base
 * @returns {Station[]} where the base stands when it is docked, in its odometry frame
 */
export function stations(graph, iri) {
  const found = items(graph, iri).map((item) => {
    const [x, y, turn] = ["x", "y", "heading"].map((name) => scalar(graph, item, name));
    const pose = { position: [x, y, 0], orientation: [0, 0, Math.sin(turn / 2), Math.cos(turn / 2)] };
    return { name: graph.value(item, lf("stationName"))?.value ?? "", pose };
  });
  return found.filter(({ pose }) => [...pose.position, ...pose.orientation].every(Number.isFinite));
}

/** Return the keys of the items of a list that is the value of a property. */
function items(graph, iri) {
  const found = [];
  for (let list = graph.value(iri, lf("value")); list && list.value !== NIL; list = graph.value(key(list), REST)) {
    const item = graph.value(key(list), FIRST);
    if (!item) return [];
    found.push(key(item));
  }
  return found;
}

function scalar(graph, node, name) {
  return length(graph, graph.value(node, lf(name)), NUMERICAL_VALUE);
}
