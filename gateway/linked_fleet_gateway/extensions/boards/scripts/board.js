// The charts of a board: lines of one unit in one chart, live or over hours, with what was measured under the pointer.

import uPlot from "uplot";

import { number } from "../../pages/scripts/src/format.js";
import { key } from "../../pages/scripts/src/ntriples.js";
import { broken, past } from "../../pages/scripts/src/past.js";
import { axes, COLOURS, room, SPANS_S } from "../../pages/scripts/src/plot_options.js";
import { adopt } from "../../pages/scripts/src/region.js";
import { say } from "../../pages/scripts/src/say.js";
import { Series } from "../../pages/scripts/src/series.js";
import { watch } from "../../pages/scripts/src/socket.js";
import { lf, NUMERICAL_VALUE, segments, UNIT, unitSymbol } from "../../pages/scripts/src/vocabulary.js";

const LIVE_S = SPANS_S.at(-1);
const PERIOD_MS = 200;
const AT_MOST = 500; // requests of the past are as far apart as a point is wide
const LEAST_PAUSE_S = 5;
const AWAY = 3; // samples that are missing

/** @typedef {[number[], (number | null | undefined)[]]} Data */

export function start(/** @type {HTMLElement} */ section) {
  new Board(section);
}

class Board {
  constructor(/** @type {HTMLElement} */ section) {
    this.place = /** @type {HTMLElement} */ (section.querySelector(".board-charts"));
    this.span = 60;
    /** @type {[number, number] | undefined} the times that somebody looks at */
    this.zoom = undefined;
    /** @type {Map<string, Line>} */
    this.lines = new Map();
    /** @type {Map<string, Chart>} by unit */
    this.charts = new Map();
    const span = /** @type {HTMLSelectElement} */ (section.querySelector("select[name=span]"));
    span.addEventListener("change", () => {
      this.span = Number(span.value);
      this.look(undefined);
      for (const line of this.lines.values()) line.reach(this.span);
    });
    this.follow = /** @type {HTMLButtonElement} */ (section.querySelector("button[data-follow]"));
    this.follow.addEventListener("click", () => this.look(undefined));
    adopt(() => this.collect());
    setInterval(() => document.hidden || this.draw(), PERIOD_MS);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.arrange());
  }

  /** Take the lines of the list, which changes when somebody changes the board. */
  collect() {
    const rows = new Map([...document.querySelectorAll(".board-lines [data-line]")].map((each) => [each.getAttribute("data-line") ?? "", each]));
    for (const [iri, line] of this.lines) {
      if (rows.has(iri)) continue;
      line.end();
      this.lines.delete(iri);
    }
    const ordered = [...rows].map(([iri, row], index) => {
      const line = this.lines.get(iri) ?? new Line(iri, this);
      line.row = row;
      line.colour = COLOURS[index % COLOURS.length];
      /** @type {HTMLElement} */ (row.querySelector("i")).style.setProperty("--colour", line.colour);
      return /** @type {[string, Line]} */ ([iri, line]);
    });
    this.lines = new Map(ordered);
    this.arrange();
  }

  /** Have a chart for each unit. */
  arrange() {
    for (const chart of this.charts.values()) chart.end();
    this.charts.clear();
    const units = new Set([...this.lines.values()].flatMap(({ unit }) => (unit === undefined ? [] : [unit])));
    for (const unit of units) this.charts.set(unit, new Chart(this, unit, [...this.lines.values()].filter((each) => each.unit === unit)));
    this.draw();
  }

  look(/** @type {[number, number] | undefined} */ zoom) {
    this.zoom = zoom;
    this.follow.hidden = !zoom;
    this.draw();
  }

  draw() {
    const lines = [...this.lines.values()];
    const now = Math.max(...lines.map((each) => each.now ?? -Infinity));
    const newest = Math.max(...lines.map((each) => each.newest));
    const end = Number.isFinite(now) ? now : newest;
    const [min, max] = this.zoom ?? [end - this.span, end];
    const ending = this.zoom ? new Date(max * 1000).toLocaleTimeString() : Number.isFinite(now) ? "now" : "last";
    for (const chart of this.charts.values()) chart.draw(min, max, ending);
  }
}

/** The numbers of one property, as long as its robot is there. */
class Line {
  constructor(/** @type {string} */ iri, /** @type {Board} */ board) {
    this.iri = iri;
    this.board = board;
    /** @type {Element | undefined} */
    this.row = undefined;
    this.colour = "";
    /** @type {string | undefined} */
    this.unit = undefined;
    /** @type {Series | undefined} */
    this.series = undefined;
    /** @type {Data} what the history has of more than the last minutes */
    this.far = [[], []];
    this.offline = false;
    const robot = new URL(`/${new URL(iri).pathname.split("/")[1]}/`, iri).href;
    this.ends = [
      watch(iri, {}, (graph) => this.take(graph)),
      watch(robot, { depth: "this", interval: 0.5 }, (graph) => this.meet(graph.value(robot, lf("presence"))?.value === lf("offline"))),
    ];
  }

  /** @param {import("../../pages/scripts/src/ntriples.js").Graph} graph */
  take(graph) {
    if (!this.series) {
      const found = scalarOf(graph, this.iri);
      if (!found) return;
      this.unit = found.unit;
      this.series = new Series(this.iri, [found.predicate, NUMERICAL_VALUE], () => this.remembered());
      this.board.arrange();
    }
    this.series.take(graph);
  }

  remembered() {
    if (this.offline) this.series?.interrupt();
    this.board.draw();
  }

  /** Nothing is drawn while the robot is away; the history has what it measured before it was lost. */
  meet(/** @type {boolean} */ offline) {
    if (offline === this.offline) return;
    this.offline = offline;
    if (offline) this.series?.interrupt();
    this.series?.fill(LIVE_S);
  }

  /** Fetch what the history has of the time, again and again if that is long. */
  async reach(/** @type {number} */ spanS) {
    clearTimeout(this.timer);
    this.far = [[], []];
    if (spanS <= LIVE_S || this.ended) return;
    try {
      const found = await past(this.iri, spanS);
      if (spanS !== this.board.span) return;
      const { times, columns } = broken(found?.table ?? { names: [], times: [], columns: [] }, (AWAY * spanS) / AT_MOST);
      this.far = [times, columns[0] ?? []];
    } catch (error) {
      console.debug("there is no past to be drawn:", error);
    }
    if (spanS !== this.board.span) return;
    this.timer = setTimeout(() => this.reach(spanS), Math.max(LEAST_PAUSE_S, spanS / AT_MOST) * 1000);
    this.board.draw();
  }

  /** @returns {Data} */
  data() {
    if (this.board.span > LIVE_S) return this.far;
    if (!this.series) return [[], []];
    return /** @type {Data} */ (this.offline ? [this.series.times, this.series.values] : this.series.known());
  }

  /** The present of its robot; undefined while that is away. */
  get now() {
    return this.offline ? undefined : this.series?.clock.now;
  }

  get newest() {
    return this.series?.times.at(-1) ?? this.far[0].at(-1) ?? -Infinity;
  }

  /** Show a number beside the name, or that there is none. */
  show(/** @type {number | null | undefined} */ value) {
    const output = this.row?.querySelector("output");
    if (output) output.textContent = Number.isFinite(value) ? `${number(/** @type {number} */ (value), this.unit)} ${this.unit}`.trim() : this.offline ? say("offline") : "–";
  }

  end() {
    this.ended = true;
    clearTimeout(this.timer);
    for (const end of this.ends) end();
  }
}

/** Return the predicate that leads to the number of a property, and its unit. */
function scalarOf(/** @type {import("../../pages/scripts/src/ntriples.js").Graph} */ graph, /** @type {string} */ iri) {
  for (const [predicate, values] of graph.subjects.get(iri) ?? []) {
    for (const value of values) {
      const node = key(value);
      if (value.kind === "literal" || !graph.value(node, NUMERICAL_VALUE)) continue;
      const unit = graph.value(node, UNIT)?.value;
      return { predicate, unit: unit ? unitSymbol(unit) : "" };
    }
  }
  return undefined;
}

class Chart {
  /** @param {Board} board @param {string} unit @param {Line[]} lines */
  constructor(board, unit, lines) {
    this.board = board;
    this.lines = lines;
    this.figure = document.createElement("figure");
    const caption = document.createElement("figcaption");
    caption.textContent = unit ? say("in {unit}", { unit }) : say("without a unit");
    this.canvas = document.createElement("div");
    this.canvas.className = "canvas";
    this.canvas.setAttribute("role", "img");
    this.figure.append(caption, this.canvas);
    board.place.append(this.figure);
    Object.assign(this.figure, { plot: this });
    this.pointed = false;
    this.chart = new uPlot(this.options(), /** @type {import("uplot").AlignedData} */ ([[], ...lines.map(() => [])]), this.canvas);
    this.sizes = new ResizeObserver(() => this.fit());
    this.sizes.observe(this.canvas);
  }

  /** @returns {import("uplot").Options} */
  options() {
    const { board } = this;
    return {
      ...this.size(),
      legend: { show: false },
      cursor: {
        y: false,
        drag: { x: true, y: false, setScale: false },
        points: { size: 6 },
        sync: { key: "board" },
        bind: { dblclick: () => () => (board.look(undefined), null) },
      },
      padding: [8, 16, 0, 0],
      scales: { x: { time: false }, y: { range: (_, low, high) => room(low, high) } },
      series: [{}, ...this.lines.map(({ colour }) => ({ stroke: colour, width: 1.5, points: { show: false } }))],
      axes: axes(),
      hooks: {
        setSelect: [
          (plot) => {
            const { left, width } = plot.select;
            if (width > 3) board.look([plot.posToVal(left, "x"), plot.posToVal(left + width, "x")]);
            if (width) plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
          },
        ],
        setCursor: [(plot) => this.read(plot.cursor.idx)],
      },
    };
  }

  size() {
    return { width: Math.max(this.canvas.clientWidth, 40), height: Math.max(this.canvas.clientHeight, 40) };
  }

  fit() {
    const { width, height } = this.size();
    if (width !== this.chart.width || height !== this.chart.height) this.chart.setSize({ width, height });
  }

  draw(/** @type {number} */ min, /** @type {number} */ max, /** @type {string} */ ending) {
    const tables = this.lines.map((each) => each.data());
    const joined = uPlot.join(/** @type {any} */ (tables));
    /** @type {any} */ (this.chart).ending = ending;
    this.chart.setData(joined, false);
    if (Number.isFinite(max)) this.chart.setScale("x", { min, max });
    this.figure.dataset.points = String(joined[0].length);
    if (!this.pointed) this.lines.forEach((line, index) => line.show(last(tables[index][1])));
    this.speak();
  }

  /** Show what was measured under the pointer; without a pointer, what is measured now. */
  read(/** @type {number | null | undefined} */ index) {
    this.pointed = index !== null && index !== undefined;
    if (!this.pointed) return;
    this.lines.forEach((line, at) => line.show(before(this.chart.data[at + 1], /** @type {number} */ (index))));
  }

  speak() {
    const names = this.lines.map(({ iri }) => segments(iri).join(" ")).join(", ");
    const text = say("{value}, last {span} s", { value: names, span: this.board.span });
    if (this.canvas.getAttribute("aria-label") !== text) this.canvas.setAttribute("aria-label", text);
  }

  end() {
    this.sizes.disconnect();
    this.chart.destroy();
    this.figure.remove();
  }
}

function last(/** @type {(number | null | undefined)[]} */ values) {
  return values.at(-1);
}

/** Return the value at a time: points of other lines between two points of a line have none of their own. */
function before(/** @type {any} */ values, /** @type {number} */ index) {
  let at = index;
  while (at > 0 && values[at] === undefined) at--;
  return values[at];
}
