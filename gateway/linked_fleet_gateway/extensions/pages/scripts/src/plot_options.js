// How plots look: axes, room around a line, colours of the page's style.

import { number } from "./format.js";

/** The time spans of the picker in seconds; by default the gateway records five minutes. */
export const SPANS_S = [10, 60, 300];
// Distinguishable in both themes and with most forms of colour blindness (after Okabe and Ito).
export const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8a7a00", "#7f7f7f"];
const MARKS = 4;

export function colour(name, otherwise) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim() || otherwise;
}

/** Options of a plot with one line. @returns {import("uplot").Options} */
export function options(width, height, wide) {
  const line = { stroke: colour("--plot", "#0b6e6e"), width: 1.5, points: { show: false } };
  return {
    width,
    height,
    legend: { show: false },
    cursor: { show: false },
    padding: wide ? [8, 16, 0, 0] : [2, 0, 2, 0],
    scales: { x: { time: false }, y: { range: (_, low, high) => room(low, high) } },
    series: [{}, line],
    axes: wide ? axes() : [{ show: false }, { show: false }],
  };
}

/** Time before now, and the value. @returns {import("uplot").Axis[]} */
export function axes() {
  const grid = { stroke: colour("--line", "#8883"), width: 1 };
  const axis = { stroke: colour("--soft", "#767676"), grid, ticks: { show: false }, font: "11px system-ui" };
  const length = ({ scales }) => scales.x.max - scales.x.min;
  const marks = (plot) => Array.from({ length: MARKS + 1 }, (_, index) => plot.scales.x.max - (length(plot) * (MARKS - index)) / MARKS);
  const ago = (plot, splits) => splits.map((each) => before(plot.scales.x.max - each, length(plot), plot.ending));
  return [
    { ...axis, size: 20, splits: marks, values: ago },
    { ...axis, size: 56, values: (_, splits) => splits.map((each) => number(each)), space: 26 },
  ];
}

function before(seconds, span, ending = "now") {
  if (seconds < 0.01) return ending;
  return span > 120 ? `-${number(Number((seconds / 60).toFixed(1)))} min` : `-${number(Number(seconds.toFixed(1)))} s`;
}

/** Keep the noise of a joint at rest from filling the plot. @returns {[number, number]} */
export function room(low, high) {
  if (low === null || low === undefined) return [-1, 1];
  const half = Math.max((high - low) * 0.55, Math.abs(high + low) * 0.005, 1e-3);
  const middle = (low + high) / 2;
  return [middle - half, middle + half];
}
