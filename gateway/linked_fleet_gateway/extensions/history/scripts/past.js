// The history of measured values, as recorded by the gateway (../README.md): tables in CSV.

const LONGEST_MS = 20000;
const MOST_PAGES = 4;
const EVERY_S = 0.2; // finer than a plot can show for minutes
const HEAD = /^(.*) \(([^()]*)\)$/;

/** @typedef {import("../../pages/scripts/src/past.js").Table} Table */

/** @returns {Promise<import("../../pages/scripts/src/past.js").Past|undefined>} the latest part of the history of a property */
export async function recorded(iri, spanS) {
  const history = await historyOf(iri);
  return history && { iri: history, table: await fetchPast(history, spanS) };
}

/** @returns {Promise<string|undefined>} where the history of a measured property is, if it is remembered */
async function historyOf(iri) {
  const head = await fetch(iri, { method: "HEAD", signal: AbortSignal.timeout(LONGEST_MS) });
  return linksOf(head).find(({ relation, target }) => relation === "related" && /\/history$/.test(target))?.target;
}

/**
 * Return the latest part of a history.
 *
 * @param {string} iri of the history
 * @param {number} spanS
 * @returns {Promise<Table>}
 */
export async function fetchPast(iri, spanS) {
  const table = { names: [], times: [], columns: [] };
  let next = `${iri}?last=PT${spanS}S&every=PT${EVERY_S}S`;
  for (let page = 0; next && page < MOST_PAGES; page++) {
    const answer = await fetch(next, { headers: { Accept: "text/csv" }, signal: AbortSignal.timeout(LONGEST_MS) });
    if (!answer.ok) break;
    read(await answer.text(), table);
    next = linksOf(answer).find(({ relation }) => relation === "next")?.target;
  }
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
