// The last minutes of each measured number: its history and then live values, drawn with uPlot while visible.

import { say } from "./say.js";
import uPlot from "uplot";

import { isCurrent, onCurrency } from "./agent_clock.js";
import { number } from "./format.js";
import { follow } from "./live.js";
import { adopt } from "./region.js";
import { options, SPANS_S } from "./plot_options.js";
import { Series } from "./series.js";

const PERIOD_MS = 100;
const SPOKEN_MS = 2000;
// Below this width, as in a table, there is no room for axes.
const NARROW_PX = 220;

/** @type {Map<string, Series>} by subject and path: several plots share the data */
const series = new Map();
/** @type {Map<Element, Plot>} */
const plots = new Map();
const visible = new Set();
let current;

const screen = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) visible[isIntersecting ? "add" : "delete"](target);
});
const sizes = new ResizeObserver((entries) => entries.forEach(({ target }) => plots.get(target)?.fit()));

export function start() {
  current = isCurrent();
  adopt(collect);
  follow(take);
  onCurrency(() => {
    if (current === isCurrent()) return;
    current = isCurrent();
    for (const each of series.values()) each.turn();
  });
  const slow = matchMedia("(prefers-reduced-motion: reduce)");
  let last = 0;
  setInterval(() => {
    const now = Date.now();
    if (document.hidden || (slow.matches && now - last < 1000)) return;
    last = now;
    requestAnimationFrame(() => visible.forEach((figure) => plots.get(figure)?.draw()));
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
  if (!series.has(name)) series.set(name, new Series(subject, path.split(/\s+/), () => remembered(name)));
  return series.get(name);
}

function remembered(name) {
  for (const plot of plots.values()) if (plot.data === series.get(name)) plot.remembered();
}

function take(graph) {
  for (const each of series.values()) each.take(graph);
}

class Plot {
  constructor(figure, data) {
    this.figure = figure;
    this.data = data;
    this.spoken = -Infinity;
    this.span = SPANS_S[1];
    this.canvas = document.createElement("div");
    this.canvas.className = "canvas";
    this.canvas.setAttribute("role", "img");
    figure.append(this.canvas);
    Object.assign(figure, { plot: this });
    this.renew();
    if (data.record) this.remembered();
  }

  /** Show the choice of the drawn time span and the download of the history. */
  remembered() {
    if (this.bar || !this.wide) return;
    const choose = Object.assign(document.createElement("select"), { ariaLabel: say("how far back the plot reaches") });
    for (const span of SPANS_S) choose.add(new Option(span < 60 ? `${span} s` : say("{value} min", { value: span / 60 }), String(span), span === this.span, span === this.span));
    choose.onchange = () => {
      this.span = Number(choose.value);
      this.draw();
    };
    const csv = Object.assign(document.createElement("a"), { href: `${this.data.record}?as=csv`, textContent: "CSV", download: "" });
    this.bar = Object.assign(document.createElement("div"), { className: "plot-bar" });
    this.bar.append(choose, csv);
    this.figure.append(this.bar);
    this.draw();
  }

  renew() {
    this.chart?.destroy();
    const { width, height } = this.size();
    this.chart = new uPlot(options(width, height, width >= NARROW_PX), this.data.known(), this.canvas);
    this.wide = width >= NARROW_PX;
    this.draw();
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

  draw() {
    const [times, values] = this.data.known();
    // Without live values the plot ends at the latest one, and says so.
    const present = current ? this.data.clock.now : undefined;
    const now = present ?? times.at(-1) ?? Date.now() / 1000;
    /** @type {any} */ (this.chart).ending = present === undefined ? "last" : "now";
    this.chart.setData([times, values], false);
    this.chart.setScale("x", { min: now - this.span, max: now });
    this.figure.dataset.points = String(times.length);
    const nowMs = performance.now();
    if (nowMs - this.spoken > SPOKEN_MS) this.speak(now, nowMs);
  }

  speak(now, spokenMs) {
    const { title = "value", unit = "" } = this.figure.dataset;
    const begin = now - this.span;
    const known = this.data.values.filter((value, index) => value !== null && this.data.times[index] >= begin);
    if (!known.length) known.push(...this.data.values.filter((value) => value !== null).slice(-1));
    const span = this.span === 60 ? say("minute") : this.span < 60 ? `${this.span} s` : say("{value} minutes", { value: this.span / 60 });
    const text = known.length
      ? say("from {number} to {number2}, {value} {number22} {unit}", { number: number(Math.min(...known)), number2: number(Math.max(...known)), value: current ? "now" : "at last", number22: number(known.at(-1)), unit })
      : say("nothing measured yet");
    this.spoken = known.length ? spokenMs : -Infinity;
    this.canvas.setAttribute("aria-label", say("{title}, last {span}: {text}", { title, span, text }).trim());
  }

  end() {
    this.chart.destroy();
    this.canvas.remove();
    this.bar?.remove();
  }
}
