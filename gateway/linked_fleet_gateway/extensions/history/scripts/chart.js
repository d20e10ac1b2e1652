// Several joints of a robot in one chart: their history, followed by live values.

import { say } from "../../pages/scripts/src/say.js";
import uPlot from "uplot";

import { fetchPast } from "./past.js";
import { AgentClock, isCurrent, onCurrency, STILL_S } from "../../pages/scripts/src/agent_clock.js";
import { axes, COLOURS, room, SPANS_S } from "../../pages/scripts/src/plot_options.js";
import { broken, covered } from "../../pages/scripts/src/past.js";
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
    this.current = isCurrent();
    onCurrency(() => this.turn());
    onJoints((state, values) => this.take(state, values));
    setInterval(() => this.seen && !document.hidden && this.draw(), PERIOD_MS);
  }

  /** The robot or the gateway is gone, or is back: the history has what was measured meanwhile, up to the last frame. */
  turn() {
    if (this.current === isCurrent()) return;
    this.current = isCurrent();
    if (!this.current) this.push(this.times.at(-1), () => null);
    if (this.state) this.fill(this.state, LONGEST_S);
  }

  take(state, values) {
    if (this.state !== state) this.begin(state);
    const time = Number(values.wallNs ?? -1n) / NS_PER_S;
    if (!(time > 0)) return;
    this.clock.note(time);
    this.first();
    const last = this.times.at(-1) ?? -Infinity;
    if (time - last < SAMPLE_S) return;
    // After a pause nobody has told what was in it, but the history knows it.
    if (time - last > STILL_S && this.times.length) {
      this.push(last, () => null);
      this.fill(state, Math.ceil(time - last) + 1);
    }
    this.push(time, (name, _, joint) => number(values[QUANTITIES[name].key]?.[state.joints.indexOf(joint)]));
    this.forget(time - LONGEST_S);
  }

  /** Add a value to each line. */
  push(time, value) {
    if (time === undefined) return;
    this.times.push(time);
    for (const [joint, lines] of this.joints) {
      for (const [name, values] of Object.entries(lines)) values.push(value(name, values, joint));
    }
  }

  forget(before) {
    const old = this.times.findIndex((time) => time >= before);
    if (old < 50) return; // not one by one
    this.times.splice(0, old);
    for (const lines of this.joints.values()) for (const values of Object.values(lines)) values.splice(0, old);
  }

  begin(state) {
    this.state = state;
    this.clock = new AgentClock();
    this.times = [];
    this.joints = new Map(state.joints.map((joint) => [joint, { position: [], velocity: [], effort: [] }]));
    this.choices();
    this.renew();
    // The history is fetched after the first frame, so that it reaches up to it; of a robot that sends none, it comes alone.
    const first = new Promise((resolve) => (this.first = resolve));
    const patience = new Promise((resolve) => setTimeout(resolve, FIRST_MS));
    Promise.race([first, patience]).then(() => this.fill(state, LONGEST_S));
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

  /** Put the latest part of the history in place of what it covers. */
  async fill(state, spanS) {
    try {
      const table = await fetchPast(this.figure.dataset.history, spanS);
      if (state === this.state) this.replace(broken(table));
    } catch (error) {
      console.debug("there is no past to be drawn:", error);
    }
  }

  replace({ names, times, columns }) {
    const [older, live] = covered(this.times, times);
    this.times = [...this.times.slice(0, older), ...times, ...this.times.slice(live)];
    for (const [joint, lines] of this.joints) {
      const segment = joint.slice(joint.lastIndexOf("/") + 1);
      for (const [name, { columns: parts }] of Object.entries(QUANTITIES)) {
        const column = columns[names.findIndex((each) => parts.some((part) => each === `${segment}/${part}`))];
        const past = times.map((_, index) => column?.[index] ?? null);
        lines[name] = [...lines[name].slice(0, older), ...past, ...lines[name].slice(live)];
      }
    }
    if (times.length) this.clock.note(times.at(-1));
    if (!this.current) this.push(this.times.at(-1), () => null);
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

  /**
   * Times and values that are known: what has not changed is known until the gateway was heard last.
   *
   * @returns {import("uplot").AlignedData}
   */
  known() {
    const [lines, last] = [this.lines(), this.times.at(-1)];
    const end = this.clock.knownUntil(last);
    return end > last ? [[...this.times, end], ...lines.map((values) => [...values, values.at(-1)])] : [this.times, ...lines];
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
    const present = this.current ? this.clock.now : undefined;
    const now = present ?? this.times.at(-1) ?? 0;
    /** @type {any} */ (this.chart).ending = present === undefined ? "last" : "now";
    this.chart.setData(this.known(), false);
    this.chart.setScale("x", { min: now - this.span, max: now });
    const names = [...this.figure.querySelectorAll("label")].filter((label) => label.querySelector("input:checked"));
    const text = say("{quantity} of {value}, last {span} s", { quantity: this.quantity, value: names.map((each) => each.textContent.trim()).join(", ") || "no joint", span: this.span });
    if (this.canvas.getAttribute("aria-label") !== text) this.canvas.setAttribute("aria-label", text);
    this.figure.dataset.points = String(this.times.length);
  }
}

function number(/** @type {number|undefined} */ value) {
  return Number.isFinite(value) ? value : null;
}
