// The last minutes of each measured number: its history and then live values, drawn with uPlot while visible.

import uPlot from "uplot";

import { number } from "./format.js";
import { follow, reach } from "./live.js";
import { past } from "./past.js";
import { adopt } from "./region.js";
import { options, SPANS_S } from "./plot_options.js";
import { onConnection } from "./socket.js";
import { UNKNOWN, localName } from "./vocabulary.js";

const LONGEST_S = SPANS_S.at(-1);
const PERIOD_MS = 100;
const SPOKEN_MS = 2000;
// Below this width, as in a table, there is no room for axes.
const NARROW_PX = 220;
// A value that was constant until now did not change gradually since its last change.
const STILL_S = 0.3;

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
    if (!live || isOffline() || document.hidden || (slow.matches && now - last < 1000)) return;
    last = now;
    requestAnimationFrame(() => visible.forEach((figure) => plots.get(figure)?.draw(Date.now() / 1000)));
  }, PERIOD_MS);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => plots.forEach((plot) => plot.renew()));
}

/** Draw nothing for a robot that is offline or a gateway that is silent. */
function isOffline() {
  return document.body.dataset.presence === "offline";
}

function interrupt() {
  for (const each of series.values()) each.interrupt(Date.now() / 1000);
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
    this.fill().catch((error) => console.debug("there is no past to be drawn:", error));
  }

  /** Put the history before the live values. */
  async fill() {
    const found = await past(this.subject, LONGEST_S);
    if (!found) return;
    this.record = found.iri;
    const { names, times, columns } = found.table;
    const name = this.path.map(localName).join(".");
    const values = columns[Math.max(0, names.indexOf(name))];
    const begin = this.times[0] ?? Infinity;
    const older = times.findIndex((time) => time >= begin);
    const count = older < 0 ? times.length : older;
    this.times.unshift(...times.slice(0, count));
    this.values.unshift(...(values ?? []).slice(0, count));
    for (const plot of plots.values()) if (plot.data === this) plot.remembered();
  }

  take(graph, now) {
    const term = reach(graph, this.subject, this.path)?.term;
    if (!term) return;
    const value = term.value === UNKNOWN ? null : Number(term.value);
    if (this.times.length && value === this.values.at(-1)) return;
    if (this.times.length && now - this.times.at(-1) > STILL_S) this.push(now - STILL_S / 10, this.values.at(-1));
    this.push(now, value);
    let old = 0;
    while (this.times[old + 1] < now - LONGEST_S) old++;
    this.times.splice(0, old);
    this.values.splice(0, old);
  }

  /** End the line: nothing is drawn while there is no connection. */
  interrupt(now) {
    if (this.times.length && this.values.at(-1) !== null) this.push(now, null);
  }

  push(time, value) {
    this.times.push(time);
    this.values.push(value);
  }

  /** Continue to the present, since a value without news has not changed. */
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
    this.span = SPANS_S[1];
    this.canvas = document.createElement("div");
    this.canvas.className = "canvas";
    this.canvas.setAttribute("role", "img");
    figure.append(this.canvas);
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
      this.draw(Date.now() / 1000);
    };
    const csv = Object.assign(document.createElement("a"), { href: `${this.data.record}?as=csv`, textContent: "CSV", download: "" });
    this.bar = Object.assign(document.createElement("div"), { className: "plot-bar" });
    this.bar.append(choose, csv);
    this.figure.append(this.bar);
    this.draw(Date.now() / 1000);
  }

  renew() {
    this.chart?.destroy();
    const { width, height } = this.size();
    this.chart = new uPlot(options(width, height, width >= NARROW_PX), this.data.until(Date.now() / 1000), this.canvas);
    this.wide = width >= NARROW_PX;
    this.draw(Date.now() / 1000);
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
    this.chart.setScale("x", { min: now - this.span, max: now });
    this.figure.dataset.points = String(times.length);
    if (now * 1000 - this.spoken > SPOKEN_MS) this.speak(now * 1000);
  }

  speak(nowMs) {
    const { title = "value", unit = "" } = this.figure.dataset;
    const begin = nowMs / 1000 - this.span;
    const known = this.data.values.filter((value, index) => value !== null && this.data.times[index] >= begin);
    if (!known.length) known.push(...this.data.values.filter((value) => value !== null).slice(-1));
    const span = this.span === 60 ? "minute" : this.span < 60 ? `${this.span} s` : `${this.span / 60} minutes`;
    const text = known.length
      ? `from ${number(Math.min(...known))} to ${number(Math.max(...known))}, now ${number(known.at(-1))} ${unit}`
      : "nothing measured yet";
    this.spoken = known.length ? nowMs : 0;
    this.canvas.setAttribute("aria-label", `${title}, last ${span}: ${text}`.trim());
  }

  end() {
    this.chart.destroy();
    this.canvas.remove();
    this.bar?.remove();
  }
}
