// The charts of a board: lines of one unit in one chart, live or over hours, with what was measured under the pointer.

import uPlot from "uplot";

import { now as presentMs } from "../../pages/scripts/src/gateway_clock.js";
import { isCurrent, onCurrency } from "../../pages/scripts/src/agent_clock.js";
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
const SLOW_MS = 1000; // for who prefers less motion
const SPOKEN_MS = 2000;
const AGAIN_S = LIVE_S * 0.8; // live values cover what is newer than the history that was fetched
const MISSING = 3 / 500; // of a span without samples: there was none
const AHEAD_S = 1;
const BEHIND_S = 3; // the times of a robot and of the gateway are compared as exactly
const NOTED = 10; // frames of which the one that took the least time tells how far a clock differs
const STEPS = 1000; // of the slider
const STEP_S = 0.001; // times of a line differ, or two lines could not be in one table
const CLOSER = 0.5;
const DASHES = [[], [6, 4], [2, 3]];

/** @typedef {[number[], (number | null | undefined)[]]} Data */

export function start(/** @type {HTMLElement} */ section) {
  new Board(section);
}

class Board {
  constructor(/** @type {HTMLElement} */ section) {
    this.place = /** @type {HTMLElement} */ (section.querySelector(".board-charts"));
    /** @type {[number, number] | undefined} the times that somebody looks at */
    this.zoom = undefined;
    /** @type {Map<string, Line>} */
    this.lines = new Map();
    /** @type {Map<string, Chart>} by unit */
    this.charts = new Map();
    const span = /** @type {HTMLSelectElement} */ (section.querySelector("select[name=span]"));
    this.span = Number(span.value);
    /** @type {[number, number] | undefined} the times of the address, such as those of a timeline, which is followed no further */
    this.fixed = given();
    this.zoom = this.fixed;
    span.addEventListener("change", () => {
      this.span = Number(span.value);
      this.leave();
    });
    this.timeline = /** @type {HTMLAnchorElement | null} */ (section.querySelector("a[data-timeline]"));
    this.slider = /** @type {HTMLInputElement} */ (section.querySelector("input[data-scrub]"));
    this.told = /** @type {HTMLOutputElement} */ (section.querySelector("output.board-time"));
    this.slider.max = this.slider.value = String(STEPS);
    this.slider.addEventListener("input", () => this.scrub(this.slider.valueAsNumber / STEPS));
    this.follow = /** @type {HTMLButtonElement} */ (section.querySelector("button[data-follow]"));
    this.follow.hidden = !this.fixed;
    this.follow.addEventListener("click", () => this.leave());
    for (const [name, share] of [["closer", CLOSER], ["wider", 1 / CLOSER]]) section.querySelector(`button[data-${name}]`)?.addEventListener("click", () => this.widen(Number(share)));
    adopt(() => this.collect());
    let current = isCurrent();
    onCurrency(() => {
      if (current === isCurrent()) return;
      current = isCurrent();
      for (const line of this.lines.values()) line.series?.turn();
    });
    const slow = matchMedia("(prefers-reduced-motion: reduce)");
    let drawn = 0;
    setInterval(() => {
      const now = Date.now();
      if (document.hidden || (slow.matches && now - drawn < SLOW_MS)) return;
      drawn = now;
      this.draw();
    }, PERIOD_MS);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.arrange());
  }

  /** Take the lines of the list, which changes when somebody changes the board. */
  collect() {
    const rows = new Map([...document.querySelectorAll(".board-lines [data-line]")].map((each) => [each.getAttribute("data-line") ?? "", each]));
    for (const [iri, line] of this.lines) if (!rows.has(iri)) line.end();
    const ordered = [...rows].map(([iri, row], index) => {
      const line = this.lines.get(iri) ?? new Line(iri, this);
      line.row = row;
      line.colour = COLOURS[index % COLOURS.length];
      line.dash = DASHES[Math.floor(index / COLOURS.length) % DASHES.length];
      const mark = /** @type {HTMLElement} */ (row.querySelector("i"));
      mark.style.setProperty("--colour", line.colour);
      mark.dataset.dash = String(DASHES.indexOf(line.dash));
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
    this.zoom = zoom ?? this.fixed;
    this.follow.hidden = !this.zoom;
    this.draw();
  }

  /** Follow what is measured now. */
  leave() {
    if (this.fixed) history.replaceState(history.state, "", location.pathname);
    this.fixed = undefined;
    this.slider.value = String(STEPS);
    this.scrub(1);
    this.look(undefined);
    for (const line of this.lines.values()) line.reach(this.span);
  }

  /** Show what was measured at a time of all charts; at their end, what is measured last. */
  scrub(/** @type {number} */ share) {
    const [min, max] = this.window();
    const time = min + share * (max - min);
    this.at = share < 1 ? time : undefined;
    for (const chart of this.charts.values()) chart.point(this.at);
    const text = this.at === undefined ? "" : new Date(time * 1000).toISOString().replace("T", " ").slice(0, 19) + " UTC";
    this.told.textContent = text;
    this.slider.setAttribute("aria-valuetext", text || say("the end"));
    this.lead(min, max);
  }

  /** Lead to the same time on the timeline. */
  lead(/** @type {number} */ min, /** @type {number} */ max) {
    if (!this.timeline || !Number.isFinite(min)) return;
    const instant = (/** @type {number} */ seconds) => new Date(seconds * 1000).toISOString();
    const end = Math.max(max, min + 1);
    this.timeline.search = new URLSearchParams({ from: instant(min), until: instant(end) }).toString();
    this.timeline.hash = this.at === undefined ? "" : `at=${instant(this.at)}`;
  }

  /** Look at a part or a multiple of the time that is shown, up to its end. */
  widen(/** @type {number} */ share) {
    const [min, max] = this.window();
    this.look([max - (max - min) * share, max]);
  }

  /** @returns {[number, number]} the times that are shown */
  window() {
    if (this.zoom) return this.zoom;
    const lines = [...this.lines.values()];
    const now = Math.max(...lines.map((each) => each.now ?? -Infinity));
    const end = Number.isFinite(now) ? now : Math.max(...lines.map((each) => each.newest));
    return [end - this.span, end];
  }

  draw() {
    const [min, max] = this.window();
    this.lead(min, max);
    const isLive = isCurrent() && [...this.lines.values()].some((each) => each.now !== undefined);
    const ending = this.zoom ? new Date(max * 1000).toLocaleTimeString(document.documentElement.lang) : isLive ? say("now") : say("last");
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
    /** @type {number[]} */
    this.dash = [];
    /** @type {string | undefined} */
    this.unit = undefined;
    /** @type {Series | undefined} */
    this.series = undefined;
    /** @type {Data} what the history has of more than the last minutes */
    this.far = [[], []];
    this.offline = false;
    /** @type {number[]} how far the clock of the robot was ahead at the latest frames */
    this.apart = [];
    const robot = new URL(`/${new URL(iri).pathname.split("/")[1]}/`, iri).href;
    const gone = () => this.meet(true);
    this.ends = [
      watch(iri, { isAside: true, onGone: gone }, (graph) => this.take(graph)),
      watch(robot, { isAside: true, onGone: gone, depth: "this", interval: 0.5 }, (graph) => {
        this.meet(graph.value(robot, lf("presence"))?.value === lf("offline"));
        this.compare(graph.value(robot, lf("lastFrame"))?.value);
      }),
    ];
    this.reach(board.span);
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

  /** Fetch what the history has of more than the last minutes, and again before live values do not reach so far back. */
  async reach(/** @type {number} */ spanS) {
    clearTimeout(this.timer);
    if (this.board.fixed) {
      this.reachTo(this.board.fixed);
      return;
    }
    if (spanS !== this.reached) this.far = [[], []];
    this.reached = spanS;
    if (spanS <= LIVE_S || this.ended) return;
    this.timer = setTimeout(() => this.reach(spanS), AGAIN_S * 1000);
    if (document.hidden) return;
    try {
      const found = await past(this.iri, spanS);
      if (!found || spanS !== this.reached) return;
      const { times, columns } = broken(found.table, MISSING * spanS);
      this.far = [times, columns[0] ?? []];
      this.board.draw();
    } catch (error) {
      console.debug("there is no past to be drawn:", error);
    }
  }

  /** Fetch what the history has of the times of the board, by the clock of the robot. */
  async reachTo(/** @type {[number, number]} */ [begin, end]) {
    this.reached = undefined;
    try {
      const found = await past(this.iri, end - begin, end + this.ahead);
      if (!found || !this.board.fixed) return;
      const { times, columns } = broken(found.table, MISSING * (end - begin));
      this.far = [times, columns[0] ?? []];
      this.board.draw();
    } catch (error) {
      console.debug("there is no past to be drawn:", error);
    }
  }

  /** Compare the clock of the robot with that of the gateway, to which its latest frame has come right now. */
  compare(/** @type {string | undefined} */ frame) {
    const time = Date.parse(frame ?? "");
    if (Number.isNaN(time) || time === this.lastFrame) return;
    this.lastFrame = time;
    this.apart = [...this.apart, (time - presentMs()) / 1000].slice(-NOTED);
    const { ahead } = this;
    this.tellClock(ahead);
    if (this.board.fixed && Math.abs(ahead - (this.compared ?? 0)) > AHEAD_S) this.reachTo(this.board.fixed);
    this.compared = ahead;
  }

  /** Say that the clock of the robot differs, and that its values are drawn at the times of the gateway. */
  tellClock(/** @type {number} */ ahead) {
    const place = /** @type {HTMLElement | null | undefined} */ (this.row?.querySelector("[data-clock]"));
    if (!place) return;
    const seconds = Math.round(Math.abs(ahead));
    const text = !ahead ? "" : ahead > 0 ? say("its clock is {seconds} s ahead; drawn by the clock of the gateway", { seconds }) : say("its clock is {seconds} s behind; drawn by the clock of the gateway", { seconds });
    if (place.textContent !== text) place.textContent = text;
  }

  /** How far the agent's clock is ahead of that of the gateway, in seconds; 0 if they agree as far as one knows. */
  get ahead() {
    const ahead = (this.series?.clock.ahead ?? -Infinity) - (presentMs() - performance.now()) / 1000;
    const apart = Math.max(...this.apart);
    return ahead > AHEAD_S ? ahead : Number.isFinite(apart) && apart < -BEHIND_S ? apart : 0;
  }

  /** @returns {Data} */
  data() {
    /** @type {Data} */
    const near = !this.series ? [[], []] : this.offline ? [this.series.times, this.series.values] : /** @type {Data} */ (this.series.known());
    const [times, values] = this.board.fixed ? this.far : this.board.span > LIVE_S ? joined(this.far, near) : near;
    const { ahead } = this;
    return ahead ? [times.map((time) => time - ahead), values] : [times, values];
  }

  /** The present; undefined while the robot is away. */
  get now() {
    return this.offline || !isCurrent() || this.series?.clock.now === undefined ? undefined : presentMs() / 1000;
  }

  get newest() {
    return (this.series?.times.at(-1) ?? this.far[0].at(-1) ?? -Infinity) - this.ahead;
  }

  /** Show a number beside the name, or why there is none. */
  show(/** @type {number | null | undefined} */ value) {
    const shown = this.row?.querySelector("data");
    if (!shown) return;
    const text = Number.isFinite(value) ? `${number(/** @type {number} */ (value), this.unit)} ${this.unit}`.trim() : this.offline ? say("offline") : "–";
    if (shown.textContent === text) return;
    shown.textContent = text;
    shown.value = Number.isFinite(value) ? String(value) : "";
  }

  end() {
    this.ended = true;
    clearTimeout(this.timer);
    for (const end of this.ends) end();
  }
}

/** Return a longer past, with the live values that are newer. @returns {Data} */
function joined(/** @type {Data} */ [times, values], /** @type {Data} */ [newTimes, newValues]) {
  const end = times.at(-1) ?? -Infinity;
  const first = newTimes.findIndex((time) => time > end);
  return first < 0 ? [times, values] : [[...times, ...newTimes.slice(first)], [...values, ...newValues.slice(first)]];
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
    this.unit = unit;
    this.spoken = -Infinity;
    this.inSight = true;
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
    this.sight = new IntersectionObserver((entries) => (this.inSight = entries.at(-1)?.isIntersecting ?? true));
    this.sight.observe(this.canvas);
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
      series: [{}, ...this.lines.map(({ colour, dash }) => ({ stroke: colour, dash, width: 1.5, points: { show: false } }))],
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
    const latest = tables.map(([, values]) => values.at(-1));
    if (!this.pointed) this.lines.forEach((line, index) => line.show(isCurrent() ? latest[index] : undefined));
    this.speak(latest);
    if (!this.inSight || !Number.isFinite(max)) return;
    /** @type {any} */ (this.chart).ending = ending;
    this.chart.setData(uPlot.join(/** @type {any} */ (tables.map((each) => within(each, min)))), false);
    this.chart.setScale("x", { min, max });
    this.figure.dataset.points = String(this.chart.data[0].length);
  }

  /** Show what was measured at a time; without one, what is measured last. */
  point(/** @type {number | undefined} */ time) {
    const index = time === undefined ? -1 : this.chart.data[0].findLastIndex((each) => each <= time);
    this.read(index < 0 ? undefined : index);
    const left = time === undefined ? -10 : this.chart.valToPos(time, "x");
    this.chart.setCursor({ left, top: 0 }, false);
    if (time === undefined) this.pointed = false;
  }

  /** Show what was measured under the pointer; without a pointer, what is measured now. */
  read(/** @type {number | null | undefined} */ index) {
    this.pointed = index !== null && index !== undefined;
    if (!this.pointed) return;
    this.lines.forEach((line, at) => line.show(before(this.chart.data[at + 1], /** @type {number} */ (index))));
  }

  /** Tell what is drawn to those who do not see it, not more often than they can hear it. */
  speak(/** @type {(number | null | undefined)[]} */ latest) {
    if (performance.now() - this.spoken < SPOKEN_MS) return;
    this.spoken = performance.now();
    const told = this.lines.map(({ iri, unit }, index) => `${segments(iri).join(" ")} ${Number.isFinite(latest[index]) ? `${number(/** @type {number} */ (latest[index]), unit)} ${unit}` : "–"}`);
    const text = say("{value}, last {span} s", { value: told.join(", "), span: this.board.span });
    if (this.canvas.getAttribute("aria-label") !== text) this.canvas.setAttribute("aria-label", text);
  }

  end() {
    this.sizes.disconnect();
    this.sight.disconnect();
    this.chart.destroy();
    this.figure.remove();
  }
}

/** Return the points from right before a time on. @returns {Data} */
function within(/** @type {Data} */ [times, values], /** @type {number} */ min) {
  const first = Math.max(0, times.findIndex((time) => time >= min) - 1);
  let last = -Infinity;
  const ascending = times.slice(first).map((time) => (last = Math.max(time, last + STEP_S)));
  return [ascending, values.slice(first)];
}

/** Return the times that the address asks for, as that of a timeline does. @returns {[number, number] | undefined} */
function given() {
  const said = new URLSearchParams(location.search);
  const [from, until] = ["from", "until"].map((name) => Date.parse(said.get(name) ?? "") / 1000);
  return from < until ? [from, Math.min(until, presentMs() / 1000)] : undefined;
}

/** Return the value at a time: points of other lines between two points of a line have none of their own. */
function before(/** @type {any} */ values, /** @type {number} */ index) {
  let at = index;
  while (at > 0 && values[at] === undefined) at--;
  return values[at];
}
