// The numbers of one property: its history, and live values after it.

import { AgentClock, isCurrent, STILL_S } from "./agent_clock.js";
import { reach } from "./live.js";
import { broken, covered, past } from "./past.js";
import { SPANS_S } from "./plot_options.js";
import { RESULT_TIME, UNKNOWN, localName } from "./vocabulary.js";

const LONGEST_S = SPANS_S.at(-1);
// The history is fetched after the first live value, so that it reaches up to it; of a robot that sends none, it comes alone.
const FIRST_MS = 1000;
// The longest time between a change and the message about it.
const NEWS_S = 0.1;

/** Measured values by the agent's clock, as in the history. Nothing is drawn that was not measured. */
export class Series {
  /**
   * @param {string} subject of the property
   * @param {string[]} path from there to the number
   * @param {() => void} [onHistory] called when the history is there
   */
  constructor(subject, path, onHistory = () => {}) {
    this.subject = subject;
    this.onHistory = onHistory;
    this.path = path;
    this.times = [];
    this.values = [];
    this.clock = new AgentClock();
    /** Time of the latest message. */
    this.stated = -Infinity;
    const first = new Promise((resolve) => (this.first = resolve));
    const patience = new Promise((resolve) => setTimeout(resolve, FIRST_MS));
    Promise.race([first, patience]).then(() => this.fill(LONGEST_S));
  }

  /** Put the latest part of the history in place of what it covers. */
  async fill(spanS) {
    try {
      const found = await past(this.subject, spanS);
      if (found) this.replace(found.iri, broken(found.table));
    } catch (error) {
      console.debug("there is no past to be drawn:", error);
    }
  }

  replace(record, { names, times, columns }) {
    this.record = record;
    const name = this.path.map(localName).join(".");
    const values = columns[Math.max(0, names.indexOf(name))] ?? [];
    const [older, live] = covered(this.times, times);
    this.times = [...this.times.slice(0, older), ...times, ...this.times.slice(live)];
    this.values = [...this.values.slice(0, older), ...times.map((_, index) => values[index] ?? null), ...this.values.slice(live)];
    if (times.length) this.clock.note(times.at(-1));
    if (!isCurrent()) this.interrupt();
    this.onHistory();
  }

  take(graph) {
    const term = reach(graph, this.subject, this.path)?.term;
    const time = term && timeOf(graph, this.subject);
    if (time === undefined || time <= this.stated) return;
    const before = this.stated;
    this.stated = time;
    this.clock.note(time);
    this.first();
    // A message may come later than a history that covers it.
    if (time > (this.times.at(-1) ?? -Infinity)) this.add(before, time, term.value === UNKNOWN ? null : Number(term.value));
  }

  add(before, time, value) {
    const [last, held] = [this.times.at(-1), this.values.at(-1)];
    if (last !== undefined && value === held) return;
    if (last !== undefined) this.bridge(last, held, before, time);
    this.push(time, value);
    let old = 0;
    while (this.times[old + 1] < time - LONGEST_S) old++;
    this.times.splice(0, old);
    this.values.splice(0, old);
  }

  /** Draw what was between two messages: after a pause nobody has told, but the history knows it. */
  bridge(last, held, before, time) {
    if (time - before <= STILL_S) {
      if (before > last) this.push(before, held);
    } else if (this.record) {
      this.push(last, null);
      this.fill(Math.ceil(time - last) + 1);
    } else this.push(Math.max(last, time - NEWS_S), held); // a value that is not recorded changes when it says so
  }

  /** The robot or the gateway is gone, or is back: the history has what was measured meanwhile, up to the last frame. */
  turn() {
    if (!isCurrent()) this.interrupt();
    this.fill(LONGEST_S);
  }

  /** End the line: nothing is drawn while nothing is known. */
  interrupt() {
    if (this.times.length && this.values.at(-1) !== null) this.push(this.times.at(-1), null);
  }

  push(time, value) {
    this.times.push(time);
    this.values.push(value);
  }

  /** Times and values that are known: what has not changed is known until the gateway was heard last. */
  known() {
    const { times, values } = this;
    const end = this.clock.knownUntil(Math.max(this.stated, times.at(-1)));
    const further = end > times.at(-1) && values.at(-1) !== null;
    return further ? [[...times, end], [...values, values.at(-1)]] : [times, values];
  }
}

/** @returns {number|undefined} when the value of a message was measured, in seconds since 1970 by the agent's clock */
function timeOf(graph, subject) {
  const stated = graph.timeS ?? Date.parse(graph.value(subject, RESULT_TIME)?.value) / 1000;
  return Number.isFinite(stated) ? stated : undefined;
}
