// The last minutes of each measured number: its history and then live values, drawn with uPlot while visible.

import uPlot from "uplot";

import { number } from "./format.js";
import { lastHeardMs } from "./heartbeat.js";
import { follow, reach } from "./live.js";
import { later, past } from "./past.js";
import { adopt } from "./region.js";
import { options, SPANS_S } from "./plot_options.js";
import { onConnection } from "./socket.js";
import { RESULT_TIME, UNKNOWN, localName } from "./vocabulary.js";

const LONGEST_S = SPANS_S.at(-1);
const PERIOD_MS = 100;
const SPOKEN_MS = 2000;
// Below this width, as in a table, there is no room for axes.
const NARROW_PX = 220;
// The history is fetched after the first live value, so that it reaches up to it; of a robot that sends none, it comes alone.
const FIRST_MS = 1000;

/** @type {Map<string, Series>} by subject and path: several plots share the data */
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
    if (!live) interrupt();
  });
  new MutationObserver(() => isOffline() && interrupt()).observe(document.body, { attributeFilter: ["data-presence"] });
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

function isOffline() {
  return document.body.dataset.presence === "offline";
}

function interrupt() {
  for (const each of series.values()) each.interrupt();
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
  for (const each of series.values()) each.take(graph);
}

/** Measured values by the agent's clock, as in the history. Nothing is drawn that was not measured. */
class Series {
  constructor(subject, path) {
    this.subject = subject;
    this.path = path;
    this.times = [];
    this.values = [];
    /** Time of the latest message, and of the present moment less that of this machine, both by the agent's clock. */
    this.heard = this.ahead = undefined;
    /** True if each frame is a message: without one nothing is known. */
    this.continuous = false;
    const first = new Promise((resolve) => (this.first = resolve));
    const patience = new Promise((resolve) => setTimeout(resolve, FIRST_MS));
    this.fill(Promise.race([first, patience])).catch((error) => console.debug("there is no past to be drawn:", error));
  }

  /** Put the history before the live values. */
  async fill(ready) {
    await ready;
    const found = await past(this.subject, LONGEST_S);
    if (!found) return;
    this.record = found.iri;
    const { names, times, columns } = found.table;
    const name = this.path.map(localName).join(".");
    const values = columns[Math.max(0, names.indexOf(name))] ?? [];
    const live = later(this.times, times.at(-1));
    this.times = [...times, ...this.times.slice(live)];
    this.values = [...times.map((_, index) => values[index] ?? null), ...this.values.slice(live)];
    for (const plot of plots.values()) if (plot.data === this) plot.remembered();
  }

  take(graph) {
    const term = reach(graph, this.subject, this.path)?.term;
    if (!term) return;
    const value = term.value === UNKNOWN ? null : Number(term.value);
    const time = timeOf(graph, this.subject);
    if (time === undefined) return;
    // The first message may be old: what it says is no measure of the clock.
    if (this.heard !== undefined && time > this.heard && !isOffline()) this.ahead = time - performance.now() / 1000;
    this.continuous ||= graph.continuous;
    const before = this.heard ?? -Infinity;
    if (time <= before) return;
    this.heard = time;
    this.first();
    if (this.times.length && value === this.values.at(-1)) return;
    // The former value held until the latest message that stated it.
    if (this.times.length && before > this.times.at(-1)) this.push(before, this.values.at(-1));
    this.push(time, value);
    let old = 0;
    while (this.times[old + 1] < time - LONGEST_S) old++;
    this.times.splice(0, old);
    this.values.splice(0, old);
  }

  /** End the line: nothing is drawn while there is no connection. */
  interrupt() {
    const end = this.end;
    if (this.times.length && this.values.at(-1) !== null) this.push(Math.max(end ?? 0, this.times.at(-1)), null);
  }

  push(time, value) {
    this.times.push(time);
    this.values.push(value);
  }

  /** The present time; undefined while no message has told the agent's clock. */
  get now() {
    return this.ahead === undefined ? undefined : performance.now() / 1000 + this.ahead;
  }

  /** Until when the latest value is known: a value without news has not changed while the gateway is heard. */
  get end() {
    if (this.continuous || !live || isOffline()) return this.heard;
    return this.ahead === undefined ? this.heard : Math.max(this.heard, lastHeardMs() / 1000 + this.ahead);
  }

  /** Times and values that are known. */
  known() {
    const { times, values, end } = this;
    const further = times.length && end > times.at(-1) && values.at(-1) !== null;
    return further ? [[...times, end], [...values, values.at(-1)]] : [times, values];
  }
}

/** @returns {number|undefined} when the value of a message was measured, in seconds since 1970 by the agent's clock */
function timeOf(graph, subject) {
  const stated = graph.timeS ?? Date.parse(graph.value(subject, RESULT_TIME)?.value) / 1000;
  return Number.isFinite(stated) ? stated : undefined;
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
    const choose = Object.assign(document.createElement("select"), { ariaLabel: "how far back the plot reaches" });
    for (const span of SPANS_S) choose.add(new Option(span < 60 ? `${span} s` : `${span / 60} min`, String(span), span === this.span, span === this.span));
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
    const now = this.data.now ?? times.at(-1) ?? Date.now() / 1000;
    /** @type {any} */ (this.chart).ending = this.current ? "now" : "last";
    this.chart.setData([times, values], false);
    this.chart.setScale("x", { min: now - this.span, max: now });
    this.figure.dataset.points = String(times.length);
    const nowMs = performance.now();
    if (nowMs - this.spoken > SPOKEN_MS) this.speak(now, nowMs);
  }

  /** True while values come. */
  get current() {
    return this.data.now !== undefined && live && !isOffline();
  }

  speak(now, spokenMs) {
    const { title = "value", unit = "" } = this.figure.dataset;
    const begin = now - this.span;
    const known = this.data.values.filter((value, index) => value !== null && this.data.times[index] >= begin);
    if (!known.length) known.push(...this.data.values.filter((value) => value !== null).slice(-1));
    const span = this.span === 60 ? "minute" : this.span < 60 ? `${this.span} s` : `${this.span / 60} minutes`;
    const text = known.length
      ? `from ${number(Math.min(...known))} to ${number(Math.max(...known))}, ${this.current || !isOffline() ? "now" : "at last"} ${number(known.at(-1))} ${unit}`
      : "nothing measured yet";
    this.spoken = known.length ? spokenMs : -Infinity;
    this.canvas.setAttribute("aria-label", `${title}, last ${span}: ${text}`.trim());
  }

  end() {
    this.chart.destroy();
    this.canvas.remove();
    this.bar?.remove();
  }
}
