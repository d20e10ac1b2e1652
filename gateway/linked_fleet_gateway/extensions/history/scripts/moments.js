// What robots were at each instant: samples of a history or a recording, fetched in parts and kept.

import { linksOf, read } from "./past.js";

const LONGEST_MS = 20000;
const PART_S = 60;
const MOST_PARTS = 20;
const MOST_PAGES = 4;
// A sample holds until the next one, but no longer than this: of a robot that rests another one is kept until then.
const HELD_S = 12;
const HELD_OF_RECORDING_S = 2;
const JOINT = /^(.+)\/(rotation|translation|position|velocity|effort)$/;
const ROWS = { velocity: "velocities", effort: "efforts" };
const AXES = ["position.x", "position.y", "position.z", "orientation.x", "orientation.y", "orientation.z", "orientation.w"];

/** @typedef {import("../../pages/scripts/src/past.js").Table} Table */
/** @typedef {import("../../pages/scripts/src/scene_state.js").Values & {names: string[], slides: boolean[]}} Then what joints were, with their names, and whether each slides */

/** Reads `/…/history`, or a whole recording if `isWhole`. */
export class Moments {
  constructor(/** @type {string} */ address, /** @type {boolean} */ isWhole) {
    this.address = address;
    this.isWhole = isWhole;
    /** @type {Map<number, Promise<Part>>} by their beginning in seconds */
    this.parts = new Map();
  }

  /** @returns {Promise<Then|undefined>} what was at a time, in seconds since 1970; undefined if nothing is known */
  async at(/** @type {number} */ time) {
    return (await this.part(time)).at(time);
  }

  /** @returns {Promise<Map<string, string>>} the values of components at a time, as JSON by path */
  async valuesAt(/** @type {number} */ time) {
    return (await this.part(time)).valuesAt(time);
  }

  /** @returns {Promise<[number, number]|undefined>} the times of the first and the last sample of a whole recording */
  async range() {
    const { times } = (await this.part(0)).table;
    return times.length ? [times[0], times.at(-1)] : undefined;
  }

  part(/** @type {number} */ time) {
    const begin = this.isWhole ? 0 : Math.floor(time / PART_S) * PART_S;
    let found = this.parts.get(begin);
    // What is still going on is fetched again when more of it may be there.
    if (!found || this.growing?.begin === begin) {
      if (!found || time > this.growing.until) {
        this.growing = !this.isWhole && (begin + PART_S) * 1000 > Date.now() ? { begin, until: Date.now() / 1000 - 2 } : undefined;
        found = this.isWhole ? this.whole() : this.fetch(begin);
        this.parts.set(begin, found);
        found.catch(() => this.parts.delete(begin));
        if (this.parts.size > MOST_PARTS) this.parts.delete(this.parts.keys().next().value);
      }
    }
    return found;
  }

  async whole() {
    return new Part(await tableAt(`${this.address}?as=csv`), HELD_OF_RECORDING_S, []);
  }

  async fetch(/** @type {number} */ begin) {
    const span = `from=${instant(begin - HELD_S)}&to=${instant(begin + PART_S)}`;
    const [table, before, values] = await Promise.all([
      tableAt(`${this.address}?${span}`),
      valuesAt(`${this.address}/values?at=${instant(begin)}`),
      valuesAt(`${this.address}/values?from=${instant(begin)}&to=${instant(begin + PART_S)}`),
    ]);
    return new Part(table, HELD_S, [...before, ...values]);
  }
}

/** @typedef {{time: number, path: string, value: string}} Said */

class Part {
  /** @param {Table} table @param {number} heldS @param {Said[]} values */
  constructor(table, heldS, values) {
    this.table = table;
    this.heldS = heldS;
    this.values = values;
    this.columns = table.names.map((name) => JOINT.exec(name));
    const segments = [...new Set(this.columns.flatMap((found) => (found ? [found[1]] : [])))];
    this.names = segments.map(decodeURIComponent);
    const column = (segment, wanted) => this.columns.findIndex((found) => found?.[1] === segment && wanted(found[2]));
    this.slides = segments.map((segment) => table.names.includes(`${segment}/translation`));
    this.rows = segments.map((segment) => ({
      positions: column(segment, (kind) => !(kind in ROWS)),
      velocities: column(segment, (kind) => kind === "velocity"),
      efforts: column(segment, (kind) => kind === "effort"),
    }));
    this.base = AXES.map((axis) => table.names.indexOf(`pose.${axis}`));
  }

  at(time) {
    const { times, columns } = this.table;
    const index = times.findLastIndex((each) => each <= time);
    if (index < 0 || time - times[index] > this.heldS || columns.every((column) => column[index] === null)) return undefined;
    const value = (column) => columns[column]?.[index] ?? NaN;
    const of = (kind) => this.rows.map((row) => value(row[kind]));
    const base = this.base.map(value);
    return {
      names: this.names,
      slides: this.slides,
      positions: of("positions"),
      velocities: of("velocities"),
      efforts: of("efforts"),
      base: this.base[0] < 0 ? undefined : { position: base.slice(0, 3), orientation: base.slice(3) },
    };
  }

  valuesAt(time) {
    const found = new Map();
    for (const each of this.values) if (each.time <= time) found.set(each.path, each.value);
    for (const [path, value] of found) if (value === "null") found.delete(path);
    return found;
  }
}

function instant(/** @type {number} */ seconds) {
  return encodeURIComponent(new Date(seconds * 1000).toISOString());
}

async function tableAt(/** @type {string} */ address) {
  const table = { names: [], times: [], columns: [] };
  let next = address;
  for (let page = 0; next && page < MOST_PAGES; page++) {
    const answer = await answerOf(next);
    const later = { names: [], times: [], columns: [] };
    read(await answer.text(), later);
    // Other joints are another robot: what follows is a page of its own.
    if (page && later.names.join() !== table.names.join()) break;
    if (!page) Object.assign(table, later);
    else {
      table.times.push(...later.times);
      table.columns.forEach((column, index) => column.push(...later.columns[index]));
    }
    next = linksOf(answer).find(({ relation }) => relation === "next")?.target;
  }
  return table;
}

/** @returns {Promise<Said[]>} the values at an address; none where none are kept */
async function valuesAt(/** @type {string} */ address) {
  const answer = await answerOf(address, [404]);
  if (!answer.ok) return [];
  const [, ...rows] = rowsOf(await answer.text());
  return rows.filter(([, , kind]) => kind === "value").map(([time, path, , value]) => ({ time: Date.parse(time) / 1000, path, value }));
}

async function answerOf(address, others = []) {
  const answer = await fetch(address, { headers: { Accept: "text/csv" }, signal: AbortSignal.timeout(LONGEST_MS) });
  if (!answer.ok && !others.includes(answer.status)) throw new Error(`${answer.status} ${answer.statusText}`);
  return answer;
}

/** @returns {string[][]} of CSV (RFC 4180) */
export function rowsOf(/** @type {string} */ text) {
  const rows = [[]];
  for (const [, quoted, plain, end] of text.matchAll(/(?:"((?:[^"]|"")*)"|([^,\r\n"]*))(,|\r?\n|$)/g)) {
    if (!end && quoted === undefined && !plain && !rows.at(-1).length) break;
    rows.at(-1).push(quoted === undefined ? plain : quoted.replaceAll('""', '"'));
    if (!end) break;
    if (end !== ",") rows.push([]);
  }
  return rows.filter((row) => row.length);
}
