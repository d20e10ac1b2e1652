// The history of measured values, as recorded by the gateway (../README.md): tables in CSV.

const LONGEST_MS = 20000;
const MOST_PAGES = 4;
const EVERY_S = 0.2; // finer than a plot can show for minutes
const MOST_POINTS = 1500; // nor can it show more
const HEAD = /^(.*) \(([^()]*)\)$/;

/** @typedef {import("../../pages/scripts/src/past.js").Table} Table */

/** @returns {Promise<import("../../pages/scripts/src/past.js").Past|undefined>} a part of the history of a property, the latest without its end */
export async function recorded(iri, spanS, untilS = undefined) {
  const history = await historyOf(iri);
  return history ? { iri: history, table: await fetchPast(history, spanS, untilS) } : said(iri, spanS, untilS);
}

/** Return what a component said: its values are told when they change, and held until then. */
async function said(iri, spanS, untilS) {
  const { origin, pathname } = new URL(iri);
  const [, robot, ...below] = pathname.split("/");
  const record = `${origin}/${robot}/history/values`;
  const of = `of=${encodeURIComponent(below.map(decodeURIComponent).join("/"))}`;
  const after = await fetchSaid(`${record}?${of}&${part(spanS, untilS)}`);
  if (!after) return undefined;
  const begin = new Date((untilS === undefined ? after.askedMs : untilS * 1000) - spanS * 1000).toISOString();
  const before = await fetchSaid(`${record}?${of}&at=${encodeURIComponent(begin)}`);
  const all = [...(before?.rows ?? []).map(([, value]) => [Date.parse(begin) / 1000, value]), ...after.rows];
  if (!all.length) return undefined;
  return { iri: record, table: { names: ["value"], times: all.map(([time]) => time), columns: [all.map(([, value]) => value)], held: true } };
}

/** Return times and numbers, and when they were asked for by the clock of the gateway; undefined if nothing is kept. */
async function fetchSaid(/** @type {string} */ first) {
  const rows = [];
  let askedMs;
  for await (const { answer, text } of pagesOf(first)) {
    askedMs ??= Date.parse(answer.headers.get("date") ?? "") || Date.now();
    const [, ...lines] = text.split(/\r?\n/);
    for (const [time, , , value] of lines.filter(Boolean).map((each) => each.split(","))) {
      const number = value === "null" || value === "" ? NaN : Number(value);
      rows.push([Date.parse(time) / 1000, Number.isFinite(number) ? number : null]);
    }
  }
  return askedMs === undefined ? undefined : { rows, askedMs };
}

/** Yield the pages of a history in CSV. */
async function* pagesOf(/** @type {string | undefined} */ next) {
  for (let page = 0; next && page < MOST_PAGES; page++) {
    const answer = await fetch(next, { headers: { Accept: "text/csv" }, signal: AbortSignal.timeout(LONGEST_MS) });
    if (!answer.ok) return;
    yield { answer, text: await answer.text() };
    next = linksOf(answer).find(({ relation }) => relation === "next")?.target;
  }
}

/** Return the selection of a part, the latest one without its end, with no more points than a plot shows. */
function part(/** @type {number} */ spanS, /** @type {number | undefined} */ untilS) {
  const instant = (/** @type {number} */ seconds) => encodeURIComponent(new Date(seconds * 1000).toISOString());
  const span = untilS === undefined ? `last=PT${Math.ceil(spanS)}S` : `from=${instant(untilS - spanS)}&to=${instant(untilS)}`;
  return `${span}&every=PT${Math.max(EVERY_S, spanS / MOST_POINTS).toFixed(3)}S`;
}

/** @returns {Promise<string|undefined>} where the history of a measured property is, if it is remembered */
async function historyOf(iri) {
  const head = await fetch(iri, { method: "HEAD", signal: AbortSignal.timeout(LONGEST_MS) });
  return linksOf(head).find(({ relation, target }) => relation === "related" && /\/history$/.test(target))?.target;
}

/**
 * Return a part of a history, the latest one without its end.
 *
 * @param {string} iri of the history
 * @param {number} spanS
 * @param {number} [untilS]
 * @returns {Promise<Table>}
 */
export async function fetchPast(iri, spanS, untilS) {
  const table = { names: [], times: [], columns: [] };
  for await (const { text } of pagesOf(`${iri}?${part(spanS, untilS)}`)) read(text, table);
  return table;
}

export function linksOf(answer) {
  const found = (answer.headers.get("link") ?? "").matchAll(/<([^>]+)>; *rel="([^"]+)"/g);
  return [...found].map(([, target, relation]) => ({ target, relation }));
}

/** Names contain no commas or quotes: they are path segments. */
export function read(text, table) {
  const [head, ...lines] = text.split(/\r?\n/);
  const names = head.split(",").slice(1).map((each) => HEAD.exec(each)?.[1] ?? each);
  if (!table.names.length) {
    table.names = names;
    table.columns = names.map(() => []);
  }
  for (const line of lines) {
    if (!line) continue;
    const [time, ...values] = line.split(",");
    table.times.push(Date.parse(time) / 1000);
    table.columns.forEach((column, index) => column.push(values[index] ? Number(values[index]) : null));
  }
}
