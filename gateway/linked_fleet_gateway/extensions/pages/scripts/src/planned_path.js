// The path of a motion that was planned: a robot that moves along it in the scene, by hand or in time.

import { say } from "./say.js";
import { drawing, ghost } from "./ghost.js";
import { RDF_TYPE, lf } from "./vocabulary.js";
import { positionsIn } from "./targets.js";

/** @typedef {{atTime: number, joints: Map<string, number>}} Waypoint s after the start; rad or m by the joint's IRI */

/**
 * Return what shows a planned path, if the rehearsal has one and the page a scene.
 *
 * @returns {HTMLElement|undefined}
 */
export function pathControls(graph) {
  return playBar(waypointsIn(graph));
}

/**
 * Return what shows a path, if the page has a scene. The element's `show` shows the robot at a time.
 *
 * @param {Waypoint[]} waypoints in the order of time
 * @returns {HTMLElement & {show: (seconds: number) => void}|undefined}
 */
export function playBar(waypoints) {
  if (waypoints.length < 2 || !drawing()) return undefined;
  const end = waypoints[waypoints.length - 1].atTime;
  const bar = Object.assign(document.createElement("p"), { className: "buttons path" });
  const slider = Object.assign(document.createElement("input"), { type: "range", min: "0", max: String(end), step: "any", value: String(end) });
  slider.setAttribute("aria-label", say("Time along the path in seconds"));
  const time = document.createElement("output");
  const play = Object.assign(document.createElement("button"), { type: "button", className: "quiet", textContent: say("Play the path") });
  const show = (seconds) => {
    slider.value = String(seconds);
    time.textContent = say("{seconds} s of {end} s", { seconds: seconds.toFixed(1), end: end.toFixed(1) });
    ghost(positionsAt(waypoints, seconds));
  };
  let playing = 0;
  const stop = () => cancelAnimationFrame(playing);
  const showOnly = (seconds) => {
    stop();
    show(seconds);
  };
  slider.addEventListener("input", () => showOnly(Number(slider.value)));
  play.addEventListener("click", () => {
    stop();
    const begun = performance.now();
    const step = (now) => {
      if (!bar.isConnected) return;
      const seconds = Math.min(Math.max((now - begun) / 1000, 0), end);
      show(seconds);
      if (seconds < end) playing = requestAnimationFrame(step);
    };
    playing = requestAnimationFrame(step);
  });
  time.textContent = `${end.toFixed(1)} s`;
  bar.append(play, slider, time);
  return Object.assign(bar, { show: showOnly });
}

/** @returns {Waypoint[]} those of a rehearsal */
function waypointsIn(graph) {
  const [root] = [...(graph?.subjects ?? [])].find(([, facts]) => facts.get(RDF_TYPE)?.some(({ value }) => value === lf("Rehearsal"))) ?? [];
  return root ? waypointsOf(graph, root) : [];
}

/** @returns {Waypoint[]} those that a node states, in the order of time */
export function waypointsOf(graph, node) {
  const found = graph.values(node, lf("waypoint")).map(({ value }) => `_:${value}`);
  const places = found.map((each) => ({ atTime: Number(graph.value(each, lf("atTime"))?.value), joints: positionsIn(graph, each) }));
  return places.filter(({ atTime }) => Number.isFinite(atTime)).sort((one, other) => one.atTime - other.atTime);
}

/** Return the positions at a time, between two waypoints on the straight line. */
export function positionsAt(waypoints, seconds) {
  const next = waypoints.findIndex(({ atTime }) => atTime >= seconds);
  if (next <= 0) return waypoints.at(next === 0 ? 0 : -1).joints;
  const [before, after] = [waypoints[next - 1], waypoints[next]];
  const share = (seconds - before.atTime) / (after.atTime - before.atTime);
  return new Map([...after.joints].map(([joint, end]) => {
    const start = before.joints.get(joint) ?? end;
    return [joint, start + share * (end - start)];
  }));
}
