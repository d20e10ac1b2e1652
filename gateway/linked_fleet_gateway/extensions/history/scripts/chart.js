// Several joints of a robot in one chart: their history, followed by live values.

import uPlot from "uplot";

import { fetchPast } from "./past.js";
import { axes, COLOURS, room, SPANS_S } from "../../pages/scripts/src/plot_options.js";
import { later } from "../../pages/scripts/src/past.js";
import { onJoints } from "../../pages/scripts/src/robot_state.js";

const QUANTITIES = {
  position: { key: "positions", columns: ["rotation", "translation"] },
  velocity: { key: "velocities", columns: ["velocity"] },
  effort: { key: "efforts", columns: ["effort"] },
};
const AT_FIRST = 3;
const PERIOD_MS = 200;
const SAMPLE_S = 0.09;
const FIRST_MS = 1000;
const LONGEST_S = SPANS_S.at(-1);
const NS_PER_S = 1e9;

export function start(figure) {
  new Chart(figure);
}

class Chart {
  constructor(figure) {
    this.figure = figure;
    this.span = SPANS_S[1];
    this.quantity = "position";
    this.times = [];
    /** @type {Map<string, Record<string, (number|null)[]>>} by joint, the values of each quantity */
    this.joints = new Map();
    this.chosen = new Set();
    this.canvas = Object.assign(document.createElement("div"), { className: "canvas" });
    this.canvas.setAttribute("role", "img");
    figure.prepend(this.canvas);
    Object.assign(figure, { plot: this });
    figure.querySelector("select[name=span]").addEventListener("change", ({ target }) => this.show({ span: Number(target.value) }));
    figure.querySelector("select[name=quantity]").addEventListener("change", ({ target }) => this.show({ quantity: target.value }));
    this.sight = new IntersectionObserver((entries) => (this.seen = entries.at(-1).isIntersecting));
    this.sight.observe(figure);
    new ResizeObserver(() => this.fit()).observe(this.canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.renew());
    onJoints((state, values) => this.take(state, values));
    setInterval(() => this.seen && !document.hidden && this.draw(), PERIOD_MS);
  }

  get stale() {
    const { connection, presence } = document.body.dataset;
    return connection !== "live" || presence === "offline";
  }

  take(state, values) {
    if (this.state !== state) this.begin(state);
    const time = Number(values.wallNs ?? -1n) / NS_PER_S;
    if (!(time > 0)) return;
    // Between two frames the agent's clock advances like that of this machine.
    if (!this.stale) this.ahead = time - performance.now() / 1000;
    if (time - (this.times.at(-1) ?? 0) < SAMPLE_S) return;
    this.times.push(time);
    this.first();
    state.joints.forEach((joint, index) => {
      const lines = this.joints.get(joint);
      for (const [name, { key }] of Object.entries(QUANTITIES)) {
        const value = values[key]?.[index];
        lines[name].push(Number.isFinite(value) ? value : null);
      }
    });
    this.forget(time - LONGEST_S);
  }

  forget(before) {
    const old = this.times.findIndex((time) => time >= before);
    if (old < 50) return; // not one by one
    this.times.splice(0, old);
    for (const lines of this.joints.values()) for (const values of Object.values(lines)) values.splice(0, old);
  }

  begin(state) {
    this.state = state;
    this.times = [];
    this.joints = new Map(state.joints.map((joint) => [joint, { position: [], velocity: [], effort: [] }]));
    this.choices();
    this.renew();
    // The history is fetched after the first frame, so that it reaches up to it; of a robot that sends none, it comes alone.
    const first = new Promise((resolve) => (this.first = resolve));
    const patience = new Promise((resolve) => setTimeout(resolve, FIRST_MS));
    Promise.race([first, patience]).then(() => this.fill(state)).catch((error) => console.debug("there is no past to be drawn:", error));
  }

  choices() {
    const names = new Map([...document.querySelectorAll('a[data-part-kind="joint"]')].map((each) => [each.href, each.dataset.part]));
    const all = [...this.joints.keys()];
    if (!all.some((joint) => this.chosen.has(joint))) this.chosen = new Set(all.slice(0, AT_FIRST));
    const boxes = all.map((joint, index) => {
      const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: this.chosen.has(joint) });
      box.onchange = () => {
        this.chosen[box.checked ? "add" : "delete"](joint);
        this.renew();
      };
      const swatch = document.createElement("i");
      swatch.style.setProperty("--colour", COLOURS[index % COLOURS.length]);
      const label = document.createElement("label");
      label.append(box, " ", swatch, ` ${names.get(joint) ?? joint}`);
      return label;
    });
    this.figure.querySelector("fieldset").replaceChildren(...boxes);
  }

  /** Put the history before the live values. */
  async fill(state) {
    const { names, times, columns } = await fetchPast(this.figure.dataset.history, LONGEST_S);
    if (state !== this.state) return;
    const live = later(this.times, times.at(-1));
    this.times = [...times, ...this.times.slice(live)];
    for (const [joint, lines] of this.joints) {
      const segment = joint.slice(joint.lastIndexOf("/") + 1);
      for (const [name, { columns: parts }] of Object.entries(QUANTITIES)) {
        const column = columns[names.findIndex((each) => parts.some((part) => each === `${segment}/${part}`))];
        lines[name] = [...times.map((_, index) => column?.[index] ?? null), ...lines[name].slice(live)];
      }
    }
    this.figure.dataset.remembered = String(times.length);
    this.draw();
  }

  show(change) {
    Object.assign(this, change);
    this.renew();
  }

  lines() {
    return [...this.joints].filter(([joint]) => this.chosen.has(joint)).map(([, lines]) => lines[this.quantity]);
  }

  renew() {
    this.chart?.destroy();
    const all = [...this.joints.keys()];
    const line = (joint) => ({ stroke: COLOURS[all.indexOf(joint) % COLOURS.length], width: 1.5, points: { show: false } });
    const { clientWidth: width, clientHeight: height } = this.canvas;
    /** @type {import("uplot").Options} */
    const layout = {
      width: Math.max(width, 40),
      height: Math.max(height, 40),
      legend: { show: false },
      cursor: { show: false },
      padding: [8, 16, 0, 0],
      scales: { x: { time: false }, y: { range: (_, low, high) => room(low, high) } },
      series: [{}, ...all.filter((joint) => this.chosen.has(joint)).map(line)],
      axes: axes(),
    };
    this.chart = new uPlot(layout, [this.times, ...this.lines()], this.canvas);
    this.draw();
  }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (this.chart && width > 40 && (width !== this.chart.width || height !== this.chart.height)) this.chart.setSize({ width, height });
  }

  draw() {
    if (!this.chart) return;
    // The lines end with the latest frame: what came after it is unknown.
    const now = this.ahead === undefined ? (this.times.at(-1) ?? 0) : performance.now() / 1000 + this.ahead;
    /** @type {any} */ (this.chart).ending = this.stale || this.ahead === undefined ? "last" : "now";
    this.chart.setData([this.times, ...this.lines()], false);
    this.chart.setScale("x", { min: now - this.span, max: now });
    const names = [...this.figure.querySelectorAll("label")].filter((label) => label.querySelector("input:checked"));
    const text = `${this.quantity} of ${names.map((each) => each.textContent.trim()).join(", ") || "no joint"}, last ${this.span} s`;
    if (this.canvas.getAttribute("aria-label") !== text) this.canvas.setAttribute("aria-label", text);
    this.figure.dataset.points = String(this.times.length);
  }
}
