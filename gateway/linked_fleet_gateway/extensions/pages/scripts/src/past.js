// Earlier values of measured properties, from an extension that records them.

/** @typedef {{names: string[], times: number[], columns: (number|null)[][]}} Table times in seconds since 1970; null is unknown */
/** @typedef {{iri: string, table: Table}} Past `iri`: of the record, which is also served as CSV */

/** @type {(iri: string, spanS: number) => Promise<Past|undefined>} */
let source = async () => undefined;

/** Set the function that reads the last `spanS` seconds of the property at `iri`; undefined if it is not recorded. */
export function provide(/** @type {typeof source} */ read) {
  source = read;
}

/** @returns {ReturnType<typeof source>} */
export function past(/** @type {string} */ iri, /** @type {number} */ spanS) {
  return source(iri, spanS);
}

/** Return the index of the first live time after the end of a history, which replaces what is before. */
export function later(/** @type {number[]} */ times, /** @type {number|undefined} */ end) {
  const found = end === undefined ? 0 : times.findIndex((time) => time > end);
  return found < 0 ? times.length : found;
}
