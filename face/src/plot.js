// The last minute of each measured number, drawn with uPlot while it is on the screen.

import uPlot from "uplot";

import { number } from "./format.js";
import { follow, reach } from "./live.js";
import { adopt } from "./region.js";
import { onConnection } from "./socket.js";
import { UNKNOWN } from "./vocabulary.js";

const SPAN_S = 60;
const MARKS_S = [60, 45, 30, 15, 0];
const PERIOD_MS = 100;
const SPOKEN_MS = 2000;
// Below this width, as in a table, there is no room for axes.
const NARROW_PX = 220;
// A value that stood still until now did not rise all the way from when it last changed.
const STILL_S = 0.3;

/** @type {Map<string, Series>} by subject and path: several plots share what was seen */
const series = new Map();
/** @type {Map<Element, Plot>} */
const plots = new Map();
const visible = new Set();
let live = true;

const screen = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) visible[isIntersecting ? "add" : "delete"](target);
});
const sizes = new ResizeObserver((entries) => entries.forEach(({ target }) => plots.get(target)?.fit()));

export function start() {
  adopt(collect);
  follow(take);
  onConnection((state) => {
    live = state === "live";
    if (!live) for (const each of series.values()) each.interrupt(Date.now() / 1000);
  });
  const slow = matchMedia("(prefers-reduced-motion: reduce)");
  let last = 0;
  setInterval(() => {
    const now = Date.now();
    if (!live || document.hidden || (slow.matches && now - last < 1000)) return;
    last = now;
    requestAnimationFrame(() => visible.forEach((figure) => plots.get(figure)?.draw(Date.now() / 1000)));
  }, PERIOD_MS);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.forEach((plot) => plot.renew()));
}

function collect(root) {
  for (const figure of root.querySelectorAll("figure.plot[data-subject][data-path]")) {
    if (plots.has(figure)) continue;
    plots.set(figure, new Plot(figure, seriesOf(figure.dataset)));
    screen.observe(figure);
    sizes.observe(figure);
  }
  for (const [figure, plot] of plots) if (!figure.isConnected) forget(figure, plot);
}

function forget(figure, plot) {
  plots.delete(figure);
  visible.delete(figure);
  screen.unobserve(figure);
  sizes.unobserve(figure);
  plot.end();
}

function seriesOf({ subject, path }) {
  const name = `${subject} ${path}`;
  if (!series.has(name)) series.set(name, new Series(subject, path.split(/\s+/)));
  return series.get(name);
}

function take(graph) {
  const now = Date.now() / 1000;
  for (const each of series.values()) each.take(graph, now);
}

class Series {
  constructor(subject, path) {
    this.subject = subject;
    this.path = path;
    this.times = [];
    this.values = [];
  }

  take(graph, now) {
    const term = reach(graph, this.subject, this.path)?.term;
    if (!term) return;
    const value = term.value === UNKNOWN ? null : Number(term.value);
    if (this.times.length && value === this.values.at(-1)) return;
    if (this.times.length && now - this.times.at(-1) > STILL_S) this.push(now - STILL_S / 10, this.values.at(-1));
    this.push(now, value);
    let old = 0;
    while (this.times[old + 1] < now - SPAN_S) old++;
    this.times.splice(0, old);
    this.values.splice(0, old);
  }

  /** End the line: of what nobody heard nothing is drawn. */
  interrupt(now) {
    if (this.times.length) this.push(now, null);
  }

  push(time, value) {
    this.times.push(time);
    this.values.push(value);
  }

  /** Up to now, for a value that nobody spoke of has not changed. */
  until(now) {
    const { times, values } = this;
    return times.length ? [[...times, now], [...values, values.at(-1)]] : [[], []];
  }
}

class Plot {
  constructor(figure, data) {
    this.figure = figure;
    this.data = data;
    this.spoken = 0;
    figure.setAttribute("role", "img");
    this.canvas = document.createElement("div");
    this.canvas.className = "canvas";
    figure.append(this.canvas);
    this.renew();
  }

  renew() {
    this.chart?.destroy();
    const { width, height } = this.size();
    this.chart = new uPlot(options(width, height), this.data.until(Date.now() / 1000), this.canvas);
    this.wide = width >= NARROW_PX;
    this.speak(Date.now());
  }

  size() {
    const { clientWidth, clientHeight } = this.canvas;
    return { width: Math.max(clientWidth, 40), height: Math.max(clientHeight, 24) };
  }

  fit() {
    const size = this.size();
    if (size.width >= NARROW_PX !== this.wide) this.renew();
    else if (size.width !== this.chart.width || size.height !== this.chart.height) this.chart.setSize(size);
  }

  draw(now) {
    const [times, values] = this.data.until(now);
    this.chart.setData([times, values], false);
    this.chart.setScale("x", { min: now - SPAN_S, max: now });
    this.figure.dataset.points = String(times.length);
    if (now * 1000 - this.spoken > SPOKEN_MS) this.speak(now * 1000);
  }

  speak(nowMs) {
    const { title = "value", unit = "" } = this.figure.dataset;
    const known = this.data.values.filter((value) => value !== null);
    const text = known.length
      ? `from ${number(Math.min(...known))} to ${number(Math.max(...known))}, now ${number(known.at(-1))} ${unit}`
      : "nothing measured yet";
    this.spoken = known.length ? nowMs : 0;
    this.figure.setAttribute("aria-label", `${title}, last minute: ${text}`.trim());
  }

  end() {
    this.chart.destroy();
    this.canvas.remove();
  }
}

function colour(name, otherwise) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim() || otherwise;
}

function options(width, height) {
  const line = colour("--plot-line", colour("--accent", "#0b6e6e"));
  const text = colour("--plot-text", colour("--muted", "#767676"));
  const grid = { stroke: colour("--plot-grid", "#8883"), width: 1 };
  const axis = { stroke: text, grid, ticks: { show: false }, font: "11px system-ui" };
  const splits = ({ scales }) => MARKS_S.map((past) => scales.x.max - past);
  const ago = () => MARKS_S.map((past) => (past ? `-${past} s` : "now"));
  const wide = width >= NARROW_PX;
  return {
    width,
    height,
    legend: { show: false },
    cursor: { show: false },
    padding: wide ? [8, 16, 0, 0] : [2, 0, 2, 0],
    scales: { x: { time: false }, y: { range: (_, low, high) => room(low, high) } },
    series: [{}, { stroke: line, width: 1.5, points: { show: false }, fill: colour("--plot-fill", undefined) }],
    axes: wide
      ? [
          { ...axis, size: 20, splits, values: ago },
          { ...axis, size: 56, values: (_, splits) => splits.map(number), space: 26 },
        ]
      : [{ show: false }, { show: false }],
  };
}

/** So that noise of a joint at rest does not fill the plot. */
function room(low, high) {
  if (low === null || low === undefined) return [-1, 1];
  const half = Math.max((high - low) * 0.55, Math.abs(high + low) * 0.005, 1e-3);
  const middle = (low + high) / 2;
  return [middle - half, middle + half];
}
