// Earlier values of measured properties, from an extension that records them.

/** @typedef {{names: string[], times: number[], columns: (number|null)[][], held?: boolean}} Table times in seconds since 1970; null is unknown; values that are `held` last until the next one */
/** @typedef {{iri: string, table: Table}} Past `iri`: of the record, which is also served as CSV */

// Without samples for longer than this the robot was away; older samples of a large fleet are further apart.
const AWAY_S = 2;
const STEP_S = 0.001; // times of a line differ

/** @type {(iri: string, spanS: number, untilS?: number) => Promise<Past|undefined>} */
let source = async () => undefined;

/** Set the function that reads `spanS` seconds of the property at `iri` up to a time, or the last ones; undefined if it is not recorded. */
export function provide(/** @type {typeof source} */ read) {
  source = read;
}

/** @returns {ReturnType<typeof source>} */
export function past(/** @type {string} */ iri, /** @type {number} */ spanS, /** @type {number | undefined} */ untilS = undefined) {
  return source(iri, spanS, untilS);
}

/** Return how many points precede a history, and the index of the first point after it: it replaces those between. */
export function covered(/** @type {number[]} */ times, /** @type {number[]} */ history) {
  const [begin = Infinity, end = -Infinity] = [history[0], history.at(-1)];
  const first = (isIt) => {
    const found = times.findIndex(isIt);
    return found < 0 ? times.length : found;
  };
  return [first((time) => time >= begin), history.length ? first((time) => time > end) : times.length];
}

/** Return the table with unknown values after each sample that no other followed in time: no line is drawn there. */
export function broken(/** @type {Table} */ { names, times, columns, held }, awayS = AWAY_S) {
  if (held) return stepped({ names, times, columns });
  const newest = times.at(-1) ?? 0;
  const isBreak = (index) => times[index + 1] - times[index] > Math.max(AWAY_S, awayS) + (newest - times[index + 1]);
  const spread = (values, filler) => values.flatMap((value, index) => (isBreak(index) ? [value, filler(value)] : [value]));
  return { names, times: spread(times, (time) => time), columns: columns.map((values) => spread(values, () => null)) };
}

/** Return the table with the value that was held right before each change, so that no slope is drawn. */
function stepped(/** @type {Table} */ { names, times, columns }) {
  const twice = (values, held) => values.flatMap((value, index) => (index ? [held(index), value] : [value]));
  return { names, times: twice(times, (index) => times[index] - STEP_S), columns: columns.map((values) => twice(values, (index) => values[index - 1])) };
}
